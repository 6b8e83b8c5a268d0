"""All targets of a video at once, by minimum-cost flow (thesis 2.3.2, eq. 2.11-2.17)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tsuiseki.tracking.association.costs import ScoreCost, TransitionCost
from tsuiseki.tracking.association.flow_window import FlowWindow
from tsuiseki.tracking.association.inference_times import InferenceTimes
from tsuiseki.tracking.association.learnt_costs import CostNetwork
from tsuiseki.tracking.association.smoothing import fill_gaps
from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.bounds import changed
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.camera_path import CameraPath, CameraTrajectory, FrameRuns
from tsuiseki.tracking.features.standing_camera import StandingCamera
from tsuiseki.tracking.interchange import BadBoxes, DetectionsLike, as_detections
from tsuiseki.tracking.people.delayed_flow import DelayedFlow
from tsuiseki.tracking.people.flow_input import FlowInput, FlowSettings, refuse_heaps
from tsuiseki.tracking.people.whole_flow import WholeFlow
from tsuiseki.tracking.types import FloatArray, Targets, Track

__all__ = ["FlowSettings", "FlowTracker"]
FLOW = FlowSettings()


class FlowTracker:
    """The cheapest set of tracks that explains all detections.

    What a score is worth is learnt from the video (`video_evidence`), and the camera's motion is taken out
    (`camera_from_boxes`). The flow over detections is solved exactly (`network_flow`), in turn with the costs of its
    links by the motion along its tracks (`flow_rounds`). Its tracks are joined over longer gaps (`join`), weak ones
    are dropped, and gaps filled. Without a ``delay`` all this waits for the end (`whole_flow`); with one every frame is
    answered so much later and the answer is final (`delayed_flow`).

    Args:
        settings: costs and stages; what is given by name goes before.
        transition: learnt costs of pairs of detections, taken beside the motion; by default none.
        observation: learnt costs of scores, taken for their calibration; by default the video calibrates them.
        frame_rate: frames a second, those that are skipped among them; on average where times are given.
        stride: mean frames from one inference to the next, where frames are skipped.
        size: width and height of the image, so that leaving it differs from a miss; None where not known.
        camera: its motion from images, or where it stands still by them, boxes telling the rest; it gets each frame
            before its detections come here. None takes the boxes.
        seed: taken as by all trackers; nothing is drawn.
        changes: by how much costs learnt on whole tracks differ from the settings'; by default not at all.
        delay: seconds from a frame to its answer, 0 or more; None answers at the end.
        drop_straddling: without a delay, drop tracks most of whose detections lie on the boxes of others; see
            `straddling_tracks`.
        min_time: tracks of fewer seconds of detections are dropped, 0.16 by default.
        fill: longest gap that is filled, 2 seconds by default; 0 fills none.
        smoothing: smooth boxes by as much as suits the video, as by default; False reports them as detected.

    With a delay or with ``changes`` all places are taken alike, whatever ``settings.costs.places`` says: the one
    answers before all tracks could be solved twice, the others were learnt so.

    Raises:
        RequestError: the frame rate is not above 0, the stride below 1, or the delay below 0.
        ValidationError: a setting that is given by name is out of its bounds.

    >>> tracker = FlowTracker(frame_rate=10.0, delay=0.5)
    >>> for t in range(9):
    ...     people = tracker.update([[t, 0, t + 20, 50, 0.9]])
    >>> people.frame, people.ids
    (3, array([1]))
    """

    def __init__(
        self,
        settings: FlowSettings = FLOW,
        transition: TransitionCost | None = None,
        observation: ScoreCost | None = None,
        frame_rate: float = 25.0,
        size: tuple[int, int] | None = None,
        camera: CameraPath | StandingCamera | None = None,
        seed: int = 0,
        changes: CostNetwork | None = None,
        delay: float | None = None,
        drop_straddling: bool = False,
        stride: float = 1.0,
        min_time: float | None = None,
        fill: float | None = None,
        smoothing: bool | None = None,
    ) -> None:
        if not (0 < frame_rate < np.inf and 1 <= stride < np.inf):
            raise RequestError(f"expected a frame rate above 0 and a stride from 1, got {frame_rate} and {stride}")
        if delay is not None and not 0 <= delay < np.inf:
            raise RequestError(f"expected `delay` of 0 seconds or more, got {delay:g}")
        settings = changed(settings, FlowSettings, locals())
        if delay is not None or changes is not None:
            settings = settings.alike()
        self.settings = settings
        self.delay = delay
        standing = camera if isinstance(camera, StandingCamera) else None
        path = camera if isinstance(camera, CameraPath) else None
        flow_input = FlowInput(settings.input, InferenceTimes(frame_rate, stride), size, path, standing, observation)
        frame_rate = flow_input.frame_rate
        window = FlowWindow(settings.costs, frame_rate, size, transition, changes)
        self._flow: WholeFlow | DelayedFlow
        if delay is None:
            self._flow = WholeFlow(settings, flow_input, window, drop_straddling)
        else:
            self._flow = DelayedFlow(settings, flow_input, window, round(delay * frame_rate))
        self._ended = self._flow
        self._count = self._used = 0
        self._reported: list[Track] = []
        self.bad = BadBoxes()

    def __repr__(self) -> str:
        late = "answers at the end" if self.delay is None else f"answers {self.delay:g} s later"
        return f"<FlowTracker: {self._flow.input.inferences.frame} frames, {late}>"

    @property
    def camera(self) -> CameraTrajectory:
        """Where the frames lie, as of the last time that the tracks were asked for."""
        return self._ended.input.camera

    @property
    def duplicates(self) -> int:
        """Boxes left out because they lay on another, as of the last time that the tracks were asked for."""
        return self._ended.input.duplicates

    @property
    def actions(self) -> list[FloatArray | None]:
        """``(D, A)`` probabilities at the detections of each of ``tracks()``, as of the last time that it was asked.

        Raises:
            RequestError: there is a delay, which forgets them.
        """
        if not isinstance(self._ended, WholeFlow):
            raise RequestError("expected a flow without a delay, which forgets what people do; leave `delay` out")
        return self._ended.actions

    def follow(self, camera: StandingCamera) -> None:
        """Ask another one where the camera stood still; before the first frame."""
        self._flow.input.standing = camera if self.settings.input.follow_camera else None

    def numbers_of(self, runs: FrameRuns) -> list[list[int]]:
        """First and last frame of each run of inferences, counted from 1."""
        return FrameRuns(self._flow.input.inferences.frames(np.array([*runs], dtype=np.int64)).tolist()).from_one()

    def facts(self) -> dict[str, Any]:
        """What ``run.json`` tells of the tracker, as of the last time that the tracks were asked for."""
        camera = self.camera
        return {
            "delay": self.delay,
            # False once a decision was made that frames to come might have changed.
            "exact": self._flow.window.flow.exact,
            "entry_and_exit_by_place": self.settings.costs.places,
            "camera_from": camera.source,
            "camera_stood_still": self._ended.input.stood_still,
            "camera_unknown": self.numbers_of(camera.unknown),
            "duplicates": self.duplicates,
            "detections": self._count,
            "detections_rejected": self._count - self._used,
            "typical_speed": round(self._ended.input.evidence.speed(), 3),
            "tracks_finished_early": self._ended.finished_early if isinstance(self._ended, WholeFlow) else 0,
        }

    def update(self, detections: DetectionsLike, time: float | None = None) -> Targets | None:
        """Take the detections of the next frame; with a delay, the people of the frame so long before.

        Raises:
            RequestError: see `Clock.now`.
        """
        detections = as_detections(detections, counted=self.bad)
        refuse_heaps(detections)
        inferences = self._flow.input.inferences
        self._flow.input.meet(time)
        self._count += len(detections)
        targets = self._flow.update(detections)
        if targets is None or inferences.all:
            return targets
        return replace(targets, frame=int(inferences.frames(np.array(targets.frame))))

    def skip(self) -> None:
        """The detector does not run on the next frame."""
        self._flow.input.skip()

    def tracks(self) -> list[Track]:
        """The tracks of all frames so far, by id; what was not answered is as it is if the video ends here."""
        self._ended = self._flow.ended()
        tracks = self._ended.tracks()
        self._used = sum(int(track.observed.sum()) for track in tracks)
        self._reported = tracks
        return [self._in_frames(track) for track in tracks]

    def _in_frames(self, track: Track) -> Track:
        """A track of inferences, with the frames between two of them filled."""
        inferences = self._flow.input.inferences
        if inferences.all:
            return track
        frames = inferences.frames(track.frames)
        steps = np.diff(frames)[np.diff(track.frames) == 1]
        return fill_gaps(replace(track, frames=frames), int(steps.max(initial=1)) - 1)

    def network(self) -> SolvedNetwork | None:
        """What the tracks were chosen from when they were last asked for; None where it is forgotten on the way."""
        if not isinstance(self._ended, WholeFlow) or self._ended is self._flow or self._ended.finished_early:
            return None
        inferences, network = self._flow.input.inferences, self._ended.network(self._reported)
        return network if inferences.all else replace(network, frames=inferences.frames(network.frames))

    def forget(self) -> None:
        """With a delay: drop what was answered from ``tracks()``; see `OnlineTracker`.

        Raises:
            RequestError: there is no delay.
        """
        if not isinstance(self._flow, DelayedFlow):
            raise RequestError("expected a flow with a delay, got one that answers at the end; give `delay`")
        self._flow.forget()
