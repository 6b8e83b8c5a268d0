"""People in drone video: the flow of people with action features (thesis chapter 5).

One tracker covers three methods: the flow tracker without action features, with those of single frames (SAF), and with
those of several frames (MAF), which are averaged along the tracks of the flow before; see `action_cost`. The camera's
motion comes from the images, with how far it may be off.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tsuiseki.tracking.association.action_cost import ActionCost
from tsuiseki.tracking.association.flow.cost_network import CostChanges
from tsuiseki.tracking.association.flow.flow_window import FlowCosts
from tsuiseki.tracking.association.flow.link_cost import LinkCost
from tsuiseki.tracking.association.score_calibration import DetectionCost
from tsuiseki.tracking.association.tracklets.chain_motion import MotionNoise
from tsuiseki.tracking.drone.acting import acting_track
from tsuiseki.tracking.features.motion.camera_motion import STANDS_STILL
from tsuiseki.tracking.features.motion.camera_path import CameraPath
from tsuiseki.tracking.features.motion.camera_trajectory import CameraStep
from tsuiseki.tracking.people.flow import FlowSettings, FlowTracker
from tsuiseki.tracking.people.flow_input import InputSettings
from tsuiseki.tracking.types import Detections, Track
from tsuiseki.tracking.types.tracks import ActingTrack

# Measured on generated clips with a detector of drawn people: its boxes of people from above are off by more than those
# of a street, above all in their widths, and people are lower there than tall, so that they move by more of their
# heights.
DRONE_MOTION = MotionNoise((0.08, 0.25, 0.13), (0.5, 0.8, 0.3), (2.5, 0.2, 0.2))
DRONE_FLOW = FlowSettings(
    input=InputSettings(
        detection=DetectionCost(offset=3.0, weight=0.5, least=0.02, interval=0.5), any_speed=False, unscored=0.4
    ),
    costs=FlowCosts(
        link=LinkCost(
            motion=DRONE_MOTION,
            reach=(0.6, 0.6),
            speed=(6.0, 6.0),
            size=0.8,
            neutral=(0.10, 0.07),
            action=ActionCost(weight=(10.0, 25.0), neutral=(0.05, 0.04), least=0.3),
        ),
        entry=7.0,
        exit=7.0,
        places=None,
    ),
)


@dataclass(frozen=True)
class DroneSettings:
    """Settings of the drone tracker.

    Attributes:
        flow: of the flow tracker.
        window: λ of the actions that are reported, seconds.
    """

    flow: FlowSettings = field(default_factory=lambda: DRONE_FLOW)
    window: float = 0.5

    def __post_init__(self) -> None:
        if not 0 <= self.window < np.inf:
            raise ValueError(f"expected a window from 0, got {self.window}")


class DroneTracker:
    """The cheapest set of tracks, priced also by the actions along them.

    Args:
        settings: of the flow and of what is reported.
        frame_rate: frames a second.
        size: width and height of the image, so that leaving it is told from being missed; None where not known.
        changes: by how much costs learnt on whole tracks differ from the settings'; by default not at all.
    """

    def __init__(
        self,
        settings: DroneSettings | None = None,
        frame_rate: float = 25.0,
        size: tuple[int, int] | None = None,
        changes: CostChanges | None = None,
    ) -> None:
        self.settings = settings or DroneSettings()
        self._path = CameraPath()
        self._flow = FlowTracker(
            self.settings.flow, frame_rate=frame_rate, size=size, camera=self._path, changes=changes
        )
        self._frame_rate = frame_rate

    def update(self, detections: Detections, motion: CameraStep | None = None) -> None:
        """Take the next frame.

        Args:
            detections: with appearance features where they are known, and with probabilities of actions in all frames
                or in none.
            motion: of the camera since the frame before; None for a camera that stands still.
        """
        self._path.follow(motion or CameraStep(STANDS_STILL))
        self._flow.update(detections)

    def tracks(self) -> list[Track]:
        """The tracks of all frames so far, by id; as they are if the video ends here."""
        return self._flow.tracks()

    def people(self) -> list[ActingTrack]:
        """The same with what each person does."""
        tracks = self._flow.tracks()
        half = round(self.settings.window / 2 * self._frame_rate)
        return [acting_track(track, doing, half) for track, doing in zip(tracks, self._flow.actions, strict=True)]

    def facts(self) -> dict[str, Any]:
        """What ``run.json`` tells of the tracker, as of the last time that the tracks were asked for."""
        return self._flow.facts()
