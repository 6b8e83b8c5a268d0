"""A simulated annotator who knows the labels answers the questions of a review (`corrections`).

Labels and detections are matched one to one in each frame, from an overlap of 0.3 on. A track's owner at a detection is
the one that most detections around have, so that a single box between two people is no error.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from cyclopts.types import NonNegativeInt, PositiveInt

from benchmarks.papers import association
from benchmarks.papers.association import STREETS, DetectedSequence, combined_scores, track_sums
from benchmarks.papers.outcome import Outcome
from benchmarks.papers.store import Cached
from benchmarks.papers.tables import Column, tabulated
from tsuiseki.tracking.association.corrected_flow import CorrectedFlow
from tsuiseki.tracking.association.corrected_tracks import Reporter, track_ids
from tsuiseki.tracking.association.correction_demands import Finder
from tsuiseki.tracking.association.marginals import Marginals
from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.coverage import IGNORED, UNMATCHED, owners_of
from tsuiseki.tracking.formats.correction_log import Correction, boxes_of
from tsuiseki.tracking.review.questions import Question, Questioner
from tsuiseki.tracking.types import BoolArray, IntArray

OVERLAP, AROUND, SHORTEST = 0.3, 3, 3
# Share of decisions that is reviewed, and of what the detections allow that is reached.
FIRST, REACHED = 0.05, 0.99
RANKINGS = ("questions", "min-marginal", "link cost", "score", "random")


def reproduce(
    *, store: Cached, data: Path = Path("../shared/data"), answers: PositiveInt = 60, streets: NonNegativeInt = 4
) -> Outcome:
    """Where a review asks first, and how soon answers mend what is wrong.

    Args:
        store: of what was computed.
        data: folder that holds mot/mot17-val-half, mot/PETS09-S2L1-first, mot/TUD-Campus and mot/TUD-Stadtmitte.
        answers: given to each sequence.
        streets: generated streets beside them.
    """
    sets = association.find_sets(store, data, ("pets", "tud", "mot17", STREETS.key))
    sequences = [
        sequence for key, members in sets.items() for sequence in members[: streets if key == STREETS else None]
    ]
    courses = store.each(reviewed, [(sequence, answers) for sequence in sequences], "corrections")
    marks, names = (0, 10, 20, 40, answers), [sequence.name for sequence in sequences]
    measured = dict[str, list[dict[str, Any]]]()
    for name, course in zip(names, courses, strict=True):
        # Answers until IDF1 is what is wanted; NaN if it never is.
        needed = next((n for n, idf1 in enumerate(course["idf1"]) if idf1 >= REACHED * course["allowed"]), np.nan)
        measured[name] = [{**course, "at": {str(n): course["idf1"][: n + 1][-1] for n in marks}, "needed": needed}]
    early = {name: sum(course["found"][name] for course in courses) for name in RANKINGS}
    total = max(sum(course["errors"] for course in courses), 1)
    shares = ", ".join(f"{name} {count / total:.0%}" for name, count in early.items())
    columns = [
        Column("errors", "errors", ".0f"),
        *(Column(name, f"found.{name}", ".0f") for name in RANKINGS),
        *(Column(f"IDF1 at {n}", f"at.{n}", ".3f") for n in marks),
        Column("allowed", "allowed", ".3f"),
        Column(f"answers to {REACHED}", "needed", show=lambda n, _: "–" if np.isnan(n[0]) else f"{n[0]:.0f}"),
        Column("clicks by hand", "by_hand", ".0f"),
    ]
    note = f"Errors within the first {FIRST:.0%} of decisions, by ranking: {shares}."
    table = tabulated(measured, columns, ("sequence",), "Corrections")
    return Outcome(dict(zip(names, courses, strict=True)), [table], notes=[note])


def reviewed(sequence: DetectedSequence, answers: int) -> dict[str, Any]:
    """An annotator's course through a sequence.

    Returns:
        ``errors``: wrong links between people, and tracks that should go on as another; ``decisions``: links, starts,
        ends and detections of tracks; ``found``: errors within the first decisions, or as many questions, by ranking;
        ``idf1`` and ``hota`` after each answer; ``allowed``: IDF1 with the right links over the same detections;
        ``by_hand``: clicks that splitting (one) and joining (two) take for those.
    """
    tracker = association.flow_over(sequence)
    tracks = tracker.tracks()
    network = tracker.network()
    assert network is not None
    flow, reporter = CorrectedFlow(network), Reporter(tracks)
    ids = track_ids(network.track, flow.labels(), reporter.highest)
    owners = owners_of(network.frames, network.boxes, association.sequence_labels(sequence), OVERLAP)
    wrong, by_hand = _errors(flow, ids, owners)
    ranked = _rankings(flow, ids)
    first = int(FIRST * len(ranked["random"]))
    find = Finder(network.frames, network.boxes)
    first_ones = {name: set(order[:first].tolist()) for name, order in ranked.items()}
    early = Questioner(flow.network, flow.flow, ids).ranked(first)
    first_ones["questions"] = {arc for question in early for arc in _arcs_of(question, find, flow)}
    shares = {name: float(sum(bool(error & arcs) for error in wrong)) for name, arcs in first_ones.items()}
    right = np.where((ids > 0) & (owners >= 0), owners + 1, 0)
    allowed = combined_scores(track_sums(sequence, reporter.tracks(flow.network, right, {}))[None])["idf1"]
    idf1, hota, accepted, keys = list[float](), list[float](), list[Correction](), set[str]()
    for _ in range(answers + 1):
        ids = track_ids(flow.network.track, flow.labels(), reporter.highest)
        now = combined_scores(track_sums(sequence, reporter.tracks(flow.network, ids, flow.demands.drawn_boxes))[None])
        idf1.append(now["idf1"])
        hota.append(now["hota"])
        questions = Questioner(flow.network, flow.settled(), ids, flow.parted()).ranked(1, keys)
        if not questions:
            break
        keys.add(questions[0].key)
        correction = answered(questions[0], owners, ids, flow.network)
        try:
            flow.correct([*accepted, *([] if correction is None else [correction])])
            accepted += [] if correction is None else [correction]
        except RequestError:
            flow.correct(accepted)
    return {
        "errors": len(wrong), "decisions": len(ranked["random"]), "found": shares, "idf1": idf1, "hota": hota,
        "allowed": allowed, "by_hand": by_hand,
    }  # fmt: skip


def answered(question: Question, owners: IntArray, ids: IntArray, network: SolvedNetwork) -> Correction | None:
    """What somebody says who sees whose boxes are shown; None for skip.

    Args:
        question: that is asked.
        owners: ``(N,)``, see `owners_of`.
        ids: ``(N,)`` of the tracks.
        network: of the flow.
    """
    find = Finder(network.frames, network.boxes)
    if question.kind == "exchange":
        (a, b), (c, d) = ([find(box) for box in part.there] for part in question.yes.parts)
        starts = [_seen(question, n, find, owners, earlier=True) for n in (a, c)]
        ends = [_seen(question, n, find, owners, earlier=False) for n in (b, d)]
        if min(*starts, *ends) < 0 or starts[0] == starts[1]:
            return None
        return question.yes if starts[0] == ends[0] else question.no if starts[0] == ends[1] else None
    if question.kind in ("link", "end"):
        two = (question.no.parts or (question.no,))[0] if question.kind == "link" else question.yes
        earlier, later = (find(box) for box in two.there)
        whose = (
            _seen(question, earlier, find, owners, earlier=True),
            _seen(question, later, find, owners, earlier=False),
        )
        if IGNORED in whose or (question.kind == "end" and whose == (UNMATCHED, UNMATCHED)):
            return None
        if whose == (UNMATCHED, UNMATCHED):
            # The track is chosen when a question is asked: one key deletes it.
            rows = np.flatnonzero(ids == ids[earlier]) if ids[earlier] else np.array([earlier, later])
            return Correction("delete", boxes_of(network.frames[rows].tolist(), network.boxes[rows].tolist()))
        if question.kind == "link" and whose[0] != whose[1]:
            return _parted(earlier, later, whose, owners, ids, network)
        return question.yes if (whose[0] == whose[1]) == (question.kind == "link") else question.no
    box_owners = [owners[find(box)] for part in (question.yes.parts or (question.yes,)) for box in part.there]
    person = np.mean([owner >= 0 for owner in box_owners]) > 0.5
    return None if IGNORED in box_owners else question.yes if person == (question.yes.kind == "real") else question.no


def _parted(
    earlier: int, later: int, whose: tuple[int, int], owners: IntArray, ids: IntArray, network: SolvedNetwork
) -> Correction:
    """A track is another person from a frame on: where most detections to both sides are as they should be."""
    frames = network.frames
    rows = np.flatnonzero((ids == ids[earlier]) & (frames >= frames[earlier]) & (frames <= frames[later]))
    rows = rows[np.argsort(frames[rows], kind="stable")]
    early, late = np.cumsum(owners[rows] == whose[0]), np.cumsum(owners[rows] == whose[1])
    last = int(np.argmax(early[:-1] + late[-1] - late[:-1]))
    here = rows[last : last + 2]
    return Correction("not_same", boxes_of(frames[here].tolist(), network.boxes[here].tolist()))


def _seen(question: Question, n: int, find: Finder, owners: IntArray, *, earlier: bool) -> int:
    """Whose most of the boxes are that are shown on one side of a detection of a track."""
    tracks = ([(find(box), box.frame) for box in boxes] for boxes in question.boxes_a.values())
    nodes, at = next((nodes, frame) for nodes in tracks for node, frame in nodes if node == n)
    side = [int(owners[m]) for m, frame in nodes if (frame <= at if earlier else frame >= at)]
    nearest = side[-7:] if earlier else side[:7]
    people = [owner for owner in nearest if owner >= 0]
    return max(set(people), key=people.count) if people else min(nearest)


def _errors(flow: CorrectedFlow, ids: IntArray, owners: IntArray) -> tuple[list[set[int]], int]:
    """Arcs of which each error is one at least, and the clicks that mending all by hand takes."""
    count, frames, link = flow.flow.count, flow.network.frames, flow.flow.link
    errors, pieces = list[set[int]](), dict[int, list[tuple[IntArray, bool, bool]]]()
    for number in np.unique(ids[ids > 0]).tolist():
        rows = np.flatnonzero(ids == number)
        rows = rows[np.argsort(frames[rows], kind="stable")]
        owned = np.flatnonzero(owners[rows] >= 0)
        smooth = [_most(owners[rows[owned[max(n - AROUND, 0) : n + AROUND + 1]]]) for n in range(len(owned))]
        runs = [run for run in np.split(owned, np.flatnonzero(np.diff(smooth)) + 1) if len(run) >= SHORTEST]
        for earlier, later in itertools.pairwise(runs):
            way = rows[earlier[-1] - AROUND : later[0] + AROUND + 1].tolist()
            errors.append({link(a, b) for a, b in itertools.pairwise(way)})
        for n, run in enumerate(runs):
            owner = _most(owners[rows[run]])
            pieces.setdefault(owner, []).append((rows, n == 0, n == len(runs) - 1))
    splits, joins = len(errors), sum(len(own_pieces) - 1 for own_pieces in pieces.values())
    for own_pieces in pieces.values():
        own_pieces.sort(key=lambda piece: int(frames[piece[0][0]]))
        for (earlier, _, last), (later, first, _) in itertools.pairwise(own_pieces):
            if last and first:
                errors.append({2 * count + int(earlier[-1]), count + int(later[0])})
    return errors, splits + 2 * joins


def _most(owners: Sequence[int] | IntArray) -> int:
    values, counts = np.unique(owners, return_counts=True)
    return int(values[counts.argmax()])


def _rankings(flow: CorrectedFlow, ids: IntArray) -> dict[str, IntArray]:
    """Decisions of the reported tracks in the order of each ranking.

    Margins and costs rank what may be an identity error, detections last; a margin counts less the longer the gap.
    """
    network, solved = flow.network, flow.flow
    count, margins = solved.count, Marginals(solved, 6.0)
    owner = np.concatenate([np.tile(np.arange(count), 3), network.graph.tail])
    used: BoolArray = solved.used & (ids[owner] > 0)
    arcs = np.flatnonzero(used | (np.arange(len(used)) < count))
    gap = np.concatenate([np.ones(3 * count), network.frames[network.graph.head] - network.frames[network.graph.tail]])
    margin = np.where(arcs < count, np.inf, margins.cost[arcs] - np.log2(gap[arcs]))
    cost = np.where(arcs < 3 * count, np.inf, -solved.cost[arcs])
    scores = np.nan_to_num(network.scores)[owner[arcs]]
    keys = (margin, cost, scores, np.random.default_rng(0).random(len(arcs)))
    return {name: arcs[np.argsort(key, kind="stable")] for name, key in zip(RANKINGS[1:], keys, strict=True)}


def _arcs_of(question: Question, find: Finder, flow: CorrectedFlow) -> set[int]:
    """The decisions that a question is about."""
    count, arcs = flow.flow.count, set[int]()
    for part in question.yes.parts or (question.yes,):
        rows = [find(box) for box in part.there]
        arcs |= {flow.flow.link(i, j) for i, j in itertools.pairwise(rows)}
        arcs |= {2 * count + rows[0], count + rows[-1]} if part.kind == "not_same" else set()
    return arcs
