"""What `tsuiseki demo` shows: three methods on the same detections of a generated clip, on one page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from tsuiseki.tracking import weights
from tsuiseki.tracking.association.learnt_costs import Affinity
from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.drone.page import action_timelines
from tsuiseki.tracking.evaluation.multi import PeopleEvaluation, SequencePair, evaluate_sequences
from tsuiseki.tracking.features.exported import Appearance, Detector
from tsuiseki.tracking.features.standing_camera import StandingCamera
from tsuiseki.tracking.geometry import centres, iou_matrix
from tsuiseki.tracking.people.contract import PeopleTracker
from tsuiseki.tracking.people.detections import PeopleInputs, ground_of
from tsuiseki.tracking.people.settings import PeopleMethod
from tsuiseki.tracking.people.tracker_choice import people_tracker
from tsuiseki.tracking.report.page import BOXES_NOTE, Report
from tsuiseki.tracking.types import BoolArray, Track
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.video.source import Source

if TYPE_CHECKING:
    from tsuiseki.tracking.drone.run import DroneResult

# What each method is called in table and report; the tracks of the last one are drawn.
STREET_METHODS: Mapping[PeopleMethod, str] = {"sort": "SORT", "deepsort": "DeepSORT", "flow": "Min-cost flow"}
DRONE_METHODS: Mapping[Literal["flow", "flow-saf", "flow-maf"], str] = {
    "flow": "flow",
    "flow-saf": "flow, single-frame actions",
    "flow-maf": "flow, multi-frame actions",
}
# What ships for people, by what it does.
STREET_MODELS = {"detector": weights.PEOPLE_DETECTOR, "appearance": "appearance_people", "affinity": "affinity_people"}


def street(
    source: Source, models: Mapping[str, Path], threads: int, device: Device
) -> tuple[PeopleInputs, dict[str, PeopleTracker]]:
    """Where people on a street come from, and a tracker for each of `STREET_METHODS` by its name, as of `track people`.

    ``models`` are files by the kinds of `STREET_MODELS`.
    """
    camera, affinity = StandingCamera(), Affinity(models["affinity"], threads)
    detector = Detector(models["detector"], threads=threads, device=device)
    appearance = Appearance(models["appearance"], threads, device=device)
    inputs = PeopleInputs(source, detector, appearance, camera=camera, ground=ground_of(detector, "auto", source))
    return inputs, {
        name: people_tracker(method, None, affinity, source=source, camera=camera, drop_straddling=True)
        for method, name in STREET_METHODS.items()
    }


def scored(
    clip: str, truth: GroundTruth, tracks: Mapping[str, list[Track]], frames: int
) -> dict[str, PeopleEvaluation]:
    """The scores of the tracks of each method on the clip of that name, whose first ``frames`` were tracked."""
    return {
        name: evaluate_sequences([SequencePair(clip, truth, method_tracks, frames)])
        for name, method_tracks in tracks.items()
    }


# Heights below which the centre of a thing that stands still moves.
STILL = 0.5
# Share of false positives from which on a track that stands still is of a thing.
MOSTLY = 0.8


def street_report(truth: GroundTruth, tracks: Mapping[str, list[Track]], frames: int) -> Report:
    """The page of people on a street; ``tracks`` of its first ``frames`` are by what each method is called."""
    scores = scored("street", truth, tracks, frames)
    introduction = (
        f"{len(np.unique(truth.ids))} people on a generated street, {frames} frames. Networks trained on generated "
        "scenes detected and described them once; three methods linked the detections, each scored against the truth."
    )
    report = Report("Tsuiseki demo", introduction, truth, tracks, scores, frames)
    return replace(report, introduction=" ".join([introduction, *why_not_best(report)]))


def why_not_best(report: Report) -> list[str]:
    """What the last method, which is drawn, does worse and better than the one of the highest HOTA, and where.

    Returns:
        A sentence, and one about its false boxes if it has any; none where the last method is the best.
    """
    scores = report.scores
    drawn, best = list(scores)[-1], max(scores, key=lambda name: scores[name].combined.hota)
    ours, theirs = scores[drawn].combined, scores[best].combined
    if ours.hota >= theirs.hota:
        return []
    line = (
        f"{drawn} is not the best here in HOTA ({ours.hota:.3f}; {best} {theirs.hota:.3f}): it keeps "
        f"{ours.false_positives} false boxes ({best} {theirs.false_positives}), misses {ours.false_negatives} people "
        f"({theirs.false_negatives}) and changes {ours.id_switches} ids ({theirs.id_switches}); right boxes overlap "
        f"true ones by {ours.motp:.3f} ({theirs.motp:.3f})."
    )
    if not ours.false_positives:
        return [line]
    return [line, _where_false_boxes_come_from(report.tracks[drawn], report.truth, ours.false_positives)]


def _where_false_boxes_come_from(tracks: Sequence[Track], truth: GroundTruth, count: int) -> str:
    """A sentence that tells things that stand still, boxes filled into gaps and the rest of ``count`` boxes apart."""
    still = filled = things = 0
    for track in tracks:
        false = _false_positives(track, truth)
        if not false.any():
            continue
        way = np.ptp(centres(track.boxes), axis=0).max() / np.median(track.boxes[:, 3] - track.boxes[:, 1])
        if false.mean() > MOSTLY and way < STILL:
            things += 1
            still += int(false.sum())
        else:
            filled += int((false & ~track.observed).sum())
    counts = {
        f"on things that never move and were taken for people all the time ({things})": still,
        "filled into gaps where no person is": filled,
        "beside people or on people who have a box already": count - still - filled,
    }
    return f"Its false boxes: {', '.join(f'{number} {where}' for where, number in counts.items() if number)}."


def _false_positives(track: Track, truth: GroundTruth) -> BoolArray:
    """``(T,)`` which boxes of a track overlap no person by half."""
    wrong = np.ones(len(track), dtype=np.bool_)
    for row, frame in enumerate(track.frames.tolist()):
        there = truth.boxes[truth.frames == frame]
        wrong[row] = not (iou_matrix(track.boxes[row : row + 1], there) >= 0.5).any()
    return wrong


def drone_report(truth: GroundTruth, results: Mapping[str, DroneResult], frames: int) -> Report:
    """The page of people who act under a drone, and of what they do by the last of the ``results``."""
    tracks = {name: result.boxes for name, result in results.items()}
    last = [*results.values()][-1]
    return Report(
        "Tsuiseki demo, from a drone",
        f"{len(np.unique(truth.ids))} people on generated ground under a drone that jerks, {frames} frames. Networks "
        "trained on generated clips detected and described them and recognised what they do, once; three ways link "
        "the detections, each scored against the truth.",
        truth,
        tracks,
        scored("drone", truth, tracks, frames),
        frames,
        sections=[action_timelines(last, last.threshold)],
        overlay_note=BOXES_NOTE,
    )
