"""A simulated annotator who knows the labels answers the questions of a review (`reproduce corrections`).

Labels and detections are matched one to one in each frame, from an overlap of 0.3 on. A track's owner at a detection is
the one that most detections around have, so that a single box between two people is no error.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.review.corrections import Box, Correction
from tsuiseki.tracking.review.demands import Finder
from tsuiseki.tracking.review.questions import Question, Questioner
from tsuiseki.tracking.review.solving import CorrectedFlow
from tsuiseki.tracking.review.tracks import Reporter, track_ids
from tsuiseki.tracking.types import FloatArray, IntArray
from tsuiseki.trainers.experiments.end_to_end import STREETS, write_streets
from tsuiseki.trainers.experiments.given_sequences import (
    GivenSequence,
    combined_scores,
    find_given,
    find_sets,
    given_detections,
    given_labels,
    track_sums,
)
from tsuiseki.trainers.experiments.study import Bench, Outcome, Table

OVERLAP, AROUND, SHORTEST = 0.3, 3, 3
# Share of what the detections allow that is to be reached.
REACHED = 0.99
NOBODY, IGNORED = -1, -2


@dataclass(frozen=True)
class Course:
    """One sequence under an annotator.

    Attributes:
        errors: wrong links between people, and tracks that should go on as another.
        idf1: after each answer.
        hota: likewise.
        allowed: IDF1 with the right links over the same detections.
        by_hand: clicks that splitting (one) and joining (two) take for those.
    """

    errors: int
    idf1: list[float]
    hota: list[float]
    allowed: float
    by_hand: int

    @property
    def needed(self) -> int | None:
        """Answers until IDF1 is what is wanted; None if it never is."""
        good = np.flatnonzero(np.array(self.idf1) >= REACHED * self.allowed)
        return int(good[0]) if len(good) else None


def reproduce(bench: Bench, data: Path = Path("../shared/data"), answers: int = 60, streets: int = 4) -> Outcome:
    """How soon answers to the questions of a review mend what is wrong.

    Args:
        bench: where it works.
        data: folder that holds mot/mot17-val-half, mot/PETS09-S2L1-first, mot/TUD-Campus and mot/TUD-Stadtmitte.
        answers: given to each sequence.
        streets: generated streets beside them.
    """
    made = find_given(bench.store.made("streets", write_streets, 10, 120).parent, STREETS)[:streets]
    sequences = [one for every in find_sets(data, ("pets", "tud", "mot17")).values() for one in every]
    lines, values = [], {}
    for given in bench.watch.over([*sequences, *made], "corrections"):
        course = bench.store.recall(reviewed, given, answers)
        values[given.name] = course
        marks = [f"{course.idf1[min(n, len(course.idf1) - 1)]:.3f}" for n in (0, 10, 20, 40, answers)]
        needed = "–" if course.needed is None else str(course.needed)
        lines.append([given.name, str(course.errors), *marks, f"{course.allowed:.3f}", needed, str(course.by_hand)])
    columns = ("sequence", "errors", *(f"IDF1 at {n}" for n in (0, 10, 20, 40, answers)))
    table = Table("", (*columns, "allowed", f"answers to {REACHED}", "clicks by hand"), lines)
    return Outcome(values, [table])


def reviewed(given: GivenSequence, answers: int) -> Course:
    """An annotator's course through a sequence."""
    tracker = FlowTracker(frame_rate=given.rate, size=given.size if min(given.size) else None)
    for found in given_detections(given):
        tracker.update(found)
    tracks = tracker.tracks()
    network = tracker.network()
    assert network is not None
    flow, reporter = CorrectedFlow(network), Reporter(tracks)
    ids = track_ids(network.track, flow.labels(), reporter.most)
    owners = owners_of_detections(network.frames, network.boxes, given)
    wrong, by_hand = _errors(flow.network.frames, ids, owners)
    right = np.where((ids > 0) & (owners >= 0), owners + 1, 0)
    allowed = combined_scores(track_sums(given, reporter.tracks(flow.network, right, {}))[None])["idf1"]
    idf1, hota, said, asked = list[float](), list[float](), list[Correction](), set[str]()
    for _ in range(answers + 1):
        ids = track_ids(flow.network.track, flow.labels(), reporter.most)
        now = combined_scores(track_sums(given, reporter.tracks(flow.network, ids, flow.demands.shown))[None])
        idf1.append(now["idf1"])
        hota.append(now["hota"])
        questions = Questioner(flow.network, flow.settled(), ids, flow.parted()).ranked(1, asked)
        if not questions:
            break
        asked.add(questions[0].key)
        correction = answered(questions[0], Finder(flow.network.frames, flow.network.boxes), owners)
        try:
            flow.correct([*said, *([] if correction is None else [correction])])
            said += [] if correction is None else [correction]
        except RequestError:
            flow.correct(said)
    return Course(wrong, idf1, hota, allowed, by_hand)


def answered(question: Question, find: Finder, owners: IntArray) -> Correction | None:
    """What somebody says who sees whose boxes are shown; None for skip."""
    if question.kind in ("link", "end"):
        two = (question.no.parts or (question.no,))[0] if question.kind == "link" else question.yes
        one, other = (find(box) for box in two.there)
        whose = _seen(question, one, find, owners, before=True), _seen(question, other, find, owners, before=False)
        if min(whose) < 0:
            return None
        return question.yes if (whose[0] == whose[1]) == (question.kind == "link") else question.no
    found = [owners[find(box)] for part in (question.yes.parts or (question.yes,)) for box in part.there]
    if question.kind == "exchange":
        if min(found) < 0 or found[0] == found[2]:
            return None
        return question.yes if found[0] == found[1] else question.no if found[0] == found[3] else None
    person = np.mean([owner >= 0 for owner in found]) > 0.5
    return None if IGNORED in found else question.yes if person == (question.yes.kind == "real") else question.no


def _seen(question: Question, n: int, find: Finder, owners: IntArray, *, before: bool) -> int:
    """Whose most of the boxes are that are shown on one side of a detection of a track."""
    nodes = [(find(Box(b.frame, b.x, b.y, b.width, b.height)), b) for b in question.boxes_a]
    mine, frame = next((box.id, box.frame) for node, box in nodes if node == n)
    side = [owners[m] for m, b in nodes if b.id == mine and (b.frame <= frame if before else b.frame >= frame)]
    known = [owner for owner in (side[-7:] if before else side[:7]) if owner >= 0]
    return max(set(known), key=known.count) if known else NOBODY


def owners_of_detections(frames: IntArray, boxes: FloatArray, given: GivenSequence) -> IntArray:
    """``(N,)`` ids of the labels, -1 for nobody, -2 where a result is neither right nor wrong."""
    labels = given_labels(given)
    labels = labels.select(labels.evaluated | labels.ignored)
    owners = np.full(len(frames), NOBODY)
    for frame in np.unique(frames).tolist():
        rows, there = np.flatnonzero(frames == frame), np.flatnonzero(labels.frames == frame)
        overlap = iou_matrix(boxes[rows], labels.boxes[there])
        one, other = scipy.optimize.linear_sum_assignment(-np.where(overlap >= OVERLAP, overlap, 0))
        good = overlap[one, other] >= OVERLAP
        here = there[other[good]]
        owners[rows[one[good]]] = np.where(labels.ignored[here], IGNORED, labels.ids[here])
    return owners


def _errors(frames: IntArray, ids: IntArray, owners: IntArray) -> tuple[int, int]:
    """How many errors there are, and the clicks that mending all by hand takes."""
    splits, pieces = 0, dict[int, list[tuple[int, bool, bool]]]()
    for number in np.unique(ids[ids > 0]).tolist():
        rows = np.flatnonzero(ids == number)
        rows = rows[np.argsort(frames[rows], kind="stable")]
        known = np.flatnonzero(owners[rows] >= 0)
        smooth = [_most(owners[rows[known[max(n - AROUND, 0) : n + AROUND + 1]]]) for n in range(len(known))]
        runs = [run for run in np.split(known, np.flatnonzero(np.diff(smooth)) + 1) if len(run) >= SHORTEST]
        splits += max(len(runs) - 1, 0)
        for n, run in enumerate(runs):
            piece = int(frames[rows[0]]), n == 0, n == len(runs) - 1
            pieces.setdefault(_most(owners[rows[run]]), []).append(piece)
    joins = sum(len(every) - 1 for every in pieces.values())
    ordered = [sorted(every, key=lambda piece: piece[0]) for every in pieces.values()]
    broken = sum(one[2] and other[1] for every in ordered for one, other in itertools.pairwise(every))
    return splits + broken, splits + 2 * joins


def _most(owners: Sequence[int] | IntArray) -> int:
    values, counts = np.unique(owners, return_counts=True)
    return int(values[counts.argmax()])
