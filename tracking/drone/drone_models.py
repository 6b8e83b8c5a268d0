"""The models for people seen from a drone, given ones or those that ship with the toolkit; and given tracks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tsuiseki.tracking.drone.observations import Observers, file_digest
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.action import STREAMS, ActionRecogniser
from tsuiseki.tracking.features.exported import AppearanceLike, as_describer
from tsuiseki.tracking.features.view_choice import ViewedDetector
from tsuiseki.tracking.formats.label_checks import compare_with_picture
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.formats.okutama import ADVICE, check_frames, is_okutama_file, read_okutama
from tsuiseki.tracking.people.detections import people_detect
from tsuiseki.tracking.people.settings import NONE, FindingOptions
from tsuiseki.tracking.types import Detections, IntArray, Track
from tsuiseki.tracking.video.image_folder import ImageFolder
from tsuiseki.tracking.video.source import Source, VideoFile
from tsuiseki.tracking.weights import DRONE_DETECTOR, shipped, shipped_or_file

DroneMethod = Literal["flow", "flow-saf", "flow-maf"]


@dataclass(frozen=True)
class DroneModels:
    """The models of a run, and the key of their observations.

    Attributes:
        observers: networks and estimates.
        names: of the actions; empty without action recognition.
        keys: plain values that identify the models and their settings, for the cache; of a run without actions then
            those of the same observations with actions.
        right_tracks: to use instead of tracking; None tracks.
    """

    observers: Observers
    names: tuple[str, ...]
    keys: Sequence[Mapping[str, Any]]
    right_tracks: Sequence[Track] | None = None

    @classmethod
    def choose(
        cls,
        source: Source,
        method: DroneMethod,
        finding: FindingOptions,
        appearance: AppearanceLike | None = None,
        actions: Sequence[Path] | None = None,
        tracks: Path | None = None,
        *,
        camera_motion: bool = True,
    ) -> DroneModels:
        """The models for a video, as `track_drone` says; people in the file ``tracks`` are right already."""
        if tracks is not None and (finding.detections is not None or finding.detector is not None):
            raise RequestError("expected one of `detections`, `detector` and `tracks`, got several")
        right_tracks = None if tracks is None else read_given_tracks(tracks, source)
        detect = (
            people_detect(source, finding, DRONE_DETECTOR)
            if right_tracks is None
            else tracks_as_detections(right_tracks)[0]
        )
        if isinstance(detect, ViewedDetector):
            # Who is seen from a drone is small to begin with: enlarged tiles find people in every bush.
            detect.enlarge = False
        network = shipped("appearance_people") if appearance is None else appearance
        used = right_tracks is None and not (isinstance(network, str | Path) and str(network) == NONE)
        describe = as_describer(network, finding.threads, device=finding.device) if used else None
        streams = _streams(method, actions, needed=right_tracks is not None)
        recognise = ActionRecogniser(streams, finding.threads, device=finding.device) if streams else None
        camera = camera_motion and right_tracks is None
        key: dict[str, str | None] = {"detections": _digest(finding.detections), "tracks": _digest(tracks)}
        if not isinstance(detect, list):
            key["detector"] = _digest(finding.detector or shipped(DRONE_DETECTOR), "detector")
        key |= {"appearance": _digest(network, "appearance") if used else None, "motion": str(camera)}
        key |= {"score_threshold": str(finding.threshold), "score_range": str(finding.score_range), **finding.how}
        keys = [key | _streams_key(streams)]
        spare = [] if streams else _streams("flow-maf", actions, needed=True)
        if spare and all(path.is_file() for path in spare):
            keys.append(key | _streams_key(spare))
        observers = Observers(detect, describe, recognise, camera, finding.batch_size)
        return cls(observers, recognise.names if recognise else (), keys, right_tracks)


def _streams(method: DroneMethod, actions: Sequence[Path] | None, *, needed: bool) -> list[Path]:
    """The files of the action streams that a method needs."""
    if method == "flow" and not needed:
        return []
    return list(actions) if actions is not None else [shipped(f"action_drone_{name}") for name in STREAMS]


def _digest(model: object, kind: str = "") -> str | None:
    """Of the file that is given, or that the name of a model of a ``kind`` stands for; None of anything else."""
    if not isinstance(model, str | Path):
        return None
    return file_digest(shipped_or_file(kind, model) if kind else Path(model))


def _streams_key(streams: Sequence[Path]) -> dict[str, str | None]:
    return {f"action {number}": file_digest(path) for number, path in enumerate(streams)}


def read_given_tracks(path: Path, source: Source) -> list[Track]:
    """The tracks in a MOTChallenge file, or of Okutama-Action's labels, whose ids, from 0, are counted from 1.

    Raises:
        RequestError: the file is missing or broken, or it labels frames that the video does not have.
    """
    if not path.is_file() or not is_okutama_file(path):
        tracks = read_tracks(path)
        boxes = np.concatenate([np.empty((0, 4)), *(track.boxes for track in tracks)])
        compare_with_picture(path, boxes, source.size)
        # The header of a video file only estimates its length.
        length, slack = (source.promised, source.slack) if isinstance(source, VideoFile) else (source.length, 0)
        last = max((int(track.frames[-1]) for track in tracks), default=0)
        if length and last >= length + slack:
            raise RequestError(
                f"{path}: tracks reach frame {last + 1}, but the video has {length} frames; are these the tracks of "
                "another video?"
            )
        return tracks
    if not isinstance(source, ImageFolder) or source.size is None:
        raise RequestError(f"{path}: expected a folder of the frames that these labels count, got a video; {ADVICE}")
    labels = read_okutama(path, source.size)
    check_frames(labels, len(source.images), source.size, str(path))
    visible = labels.select(~labels.lost)
    rows = [visible.select(np.flatnonzero(visible.ids == identity)) for identity in np.unique(visible.ids).tolist()]
    rows = [person.select(np.argsort(person.frames)) for person in rows]
    return [Track(int(person.ids[0]) + 1, person.frames, person.boxes, np.ones(len(person))) for person in rows]


def tracks_as_detections(tracks: Sequence[Track], length: int | None = None) -> tuple[list[Detections], IntArray]:
    """The boxes of ``tracks`` as detections, one entry a frame, and ``(N,)`` index of the track of each.

    A ``length`` of None ends with the last box.

    Raises:
        RequestError: there is no track.
    """
    if not tracks:
        raise RequestError("expected at least one given track, got none")
    frames = np.concatenate([track.frames for track in tracks])
    labels = np.repeat(np.arange(len(tracks)), [len(track) for track in tracks])
    order = np.lexsort((labels, frames))
    cuts = np.searchsorted(frames[order], np.arange(1, (int(frames.max()) + 1) if length is None else length))
    boxes = np.split(np.concatenate([track.boxes for track in tracks])[order], cuts)
    scores = np.split(np.concatenate([track.scores for track in tracks])[order], cuts)
    return [Detections(*both) for both in zip(boxes, scores, strict=True)], labels[order]
