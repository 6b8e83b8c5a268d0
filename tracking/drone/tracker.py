"""People in drone video: the flow of people with action features (thesis chapter 5).

One tracker covers three methods: the flow tracker without action features, with those of single frames (SAF), and
with those of several frames (MAF), which are averaged along the tracks of the flow before (`ActionCost`). The
camera's motion comes from the images, with how far it may be off. Each reported track has the probabilities of
actions in its frames, single and averaged over windows (eq. 5.3).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tsuiseki.tracking.association.costs import window_means
from tsuiseki.tracking.association.learnt_costs import CostNetwork
from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.drone.settings import DroneSettings
from tsuiseki.tracking.features.camera_motion import STANDS_STILL, CameraStep
from tsuiseki.tracking.features.camera_path import CameraPath
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.printed_flow import PrintedFlow
from tsuiseki.tracking.types import Detections, FloatArray, Track
from tsuiseki.tracking.types.tracks import ActingTrack


class DroneTracker:
    """The cheapest set of tracks, with a cost also of the actions along them.

    Args:
        settings: of the flow and of what is reported.
        frame_rate: frames a second.
        size: width and height of the image, so that leaving it differs from a miss; None where not known.
        costs: by how much costs learnt on whole tracks differ from the settings', by default not at all; or the
            thesis's flow in place of that of the settings, which leaves the camera's motion in.
        pictures: the camera's motion comes with the frames, from pictures; otherwise the boxes tell it.
        drop_straddling: see `FlowTracker`.
    """

    def __init__(
        self,
        settings: DroneSettings | None = None,
        frame_rate: float = 25.0,
        size: tuple[int, int] | None = None,
        costs: CostNetwork | PrintedFlow | None = None,
        *,
        pictures: bool = True,
        drop_straddling: bool = False,
    ) -> None:
        self.settings = settings or DroneSettings()
        self._path = CameraPath() if pictures else None
        self._flow: FlowTracker | PrintedFlow
        if isinstance(costs, PrintedFlow):
            self._flow = costs
        else:
            self._flow = FlowTracker(
                self.settings.flow,
                frame_rate=frame_rate,
                size=size,
                camera=self._path,
                changes=costs,
                drop_straddling=drop_straddling,
            )
        self._frame_rate = frame_rate

    def update(self, detections: Detections, motion: CameraStep | None = None) -> None:
        """Take the next frame.

        Args:
            detections: with appearance features where they are known, and with probabilities of actions in all frames
                or in none.
            motion: of the camera since the frame before, by pictures; None for a camera that stands still.
        """
        if self._path is not None:
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

    def network(self) -> SolvedNetwork | None:
        """What the tracks were chosen from when they were last asked for."""
        return self._flow.network() if isinstance(self._flow, FlowTracker) else None

    def facts(self) -> dict[str, Any]:
        """What ``run.json`` tells of the tracker, as of the last time that the tracks were asked for."""
        return self._flow.facts()


def acting_track(track: Track, actions: FloatArray | None, half: int) -> ActingTrack:
    """A track with what the person does in each of its frames; where it was not detected, as in between.

    Args:
        track: observed in D frames.
        actions: ``(D, A)`` probabilities in those; None where nothing recognised them.
        half: frames of the window before and after.
    """
    if actions is None:
        return ActingTrack(track)
    frames = track.frames[track.observed]
    single = np.stack([np.interp(track.frames, frames, column) for column in actions.T], axis=1)
    mine, at = np.zeros(len(frames), np.int64), np.zeros(len(track), np.int64)
    multi = window_means(frames, mine, actions, track.frames, at, (half, half))
    return ActingTrack(track, single, np.where(np.isnan(multi), single, multi))
