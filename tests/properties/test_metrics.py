"""Scores equal what their definitions give when all possibilities are gone through."""

from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.properties.drawn import boxes_of, matchings, seeds, tracks_of
from tsuiseki.tracking.evaluation.detection import LabelledBoxes, evaluate_detections
from tsuiseki.tracking.evaluation.identity_metrics import LabelledSequence, clear, hota, identity
from tsuiseki.tracking.evaluation.multi import SequencePair, evaluate_sequence, evaluate_sequences
from tsuiseki.tracking.evaluation.point_distances import PointTracks, gospa, ospa, track_distances
from tsuiseki.tracking.evaluation.reidentification import evaluate_retrieval
from tsuiseki.tracking.evaluation.success_curves import evaluate_boxes
from tsuiseki.tracking.formats.tracked_video import boxes_of_tracks
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import Detections, FloatArray, Track
from tsuiseki.tracking.types.labels import GroundTruth

few = st.integers(0, 3)
cut_offs = st.floats(0.5, 20)
orders = st.sampled_from([1.0, 2.0, 3.5])


def sequence_of(seed: int, frames: int, people: int, reported: int) -> LabelledSequence:
    """Frames in which some of a few true and of a few reported identities overlap by anything."""
    rng = np.random.default_rng(seed)
    sides = [[np.flatnonzero(rng.random(count) < 0.8) for _ in range(frames)] for count in (people, reported)]
    overlaps = [rng.random((len(true), len(other))) for true, other in zip(*sides, strict=True)]
    return LabelledSequence.of(*sides, overlaps)


def frames_of(sequence: LabelledSequence) -> list[tuple[list[int], list[int], FloatArray]]:
    columns = sequence.true_ids, sequence.reported_ids, sequence.overlaps
    return [(true.tolist(), reported.tolist(), shared) for true, reported, shared in zip(*columns, strict=True)]


def video_of(seed: int, people: int = 3) -> tuple[GroundTruth, list[Track]]:
    """Labels, and tracks that lie near them, miss some, and exchange two people half-way."""
    rng = np.random.default_rng(seed)
    rows = boxes_of_tracks(tracks_of(rng, people))
    truth = GroundTruth.of_boxes(rows.frames, rows.ids, rows.boxes)
    names = np.where(rows.frames > 3, rows.ids % (3 * people) + 1, rows.ids)
    reported = rows.boxes + rng.normal(0, 3, (len(names), 1))
    detected = rng.random(len(names)) < 0.9
    numbers = np.unique(names[detected]).tolist()
    parts = [np.flatnonzero((names == number) & detected) for number in numbers]
    tracks = [Track(n, rows.frames[p], reported[p], rows.scores[p]) for n, p in zip(numbers, parts, strict=True)]
    return truth, tracks


def aligned(sequence: LabelledSequence) -> dict[tuple[int, int], float]:
    """How much each true and each reported identity overlap, over both of their lengths: a soft Jaccard index."""
    common, there, reported_there = Counter[tuple[int, int]](), Counter[int](), Counter[int]()
    for true, reported, shared in frames_of(sequence):
        there.update(true)
        reported_there.update(reported)
        for (a, i), (b, j) in itertools.product(enumerate(true), enumerate(reported)):
            common[i, j] += shared[a, b] / (shared[a].sum() + shared[:, b].sum() - shared[a, b])
    return {(i, j): share / (there[i] + reported_there[j] - share) for (i, j), share in common.items()}


@given(seed=seeds, frames=st.integers(1, 4), people=few, reported=few)
def test_hota_is_that_of_all_matchings(seed: int, frames: int, people: int, reported: int) -> None:
    """In each frame HOTA takes the matching of the greatest aligned overlap, and counts by its definition."""
    sequence = sequence_of(seed, frames, people, reported)
    alignment, matches = aligned(sequence), list[tuple[int, int, float]]()
    for true, other, shared in frames_of(sequence):
        ways = [[(true[a], other[b], shared[a, b]) for a, b in pairs] for pairs in matchings(*shared.shape)]
        matches += max(ways, key=lambda way: sum(alignment[i, j] * overlap for i, j, overlap in way))
    there, reported_there = (Counter(n for ids in frame_ids for n in ids.tolist())
                             for frame_ids in (sequence.true_ids, sequence.reported_ids))  # fmt: skip
    for alpha, score in zip(np.arange(1, 20) / 20, hota(sequence).hota, strict=True):
        hits = [(i, j) for i, j, overlap in matches if overlap >= alpha]
        common = Counter(hits)
        shares = [common[i, j] / (there[i] + reported_there[j] - common[i, j]) for i, j in hits]
        boxes = there.total() + reported_there.total() - len(hits)
        assert score == pytest.approx(np.sqrt(sum(shares) / max(boxes, 1)))


@settings(max_examples=60)
@given(seed=seeds, frames=st.integers(1, 8), people=few, reported=few)
def test_mota_is_that_of_all_matchings(seed: int, frames: int, people: int, reported: int) -> None:
    """CLEAR MOT keeps as many pairs of the frame before as it can, and among these ways takes the greatest overlap."""
    sequence = sequence_of(seed, frames, people, reported)
    before, last, hits, switches, overlap = set(), {}, 0, 0, 0.0
    for true, other, shared in frames_of(sequence):
        if not shared.size:
            continue
        ways = [way for way in matchings(*shared.shape) if all(shared[pair] >= 0.5 for pair in way)]
        best = max(
            ways,
            key=lambda way: (sum((true[a], other[b]) in before for a, b in way), sum(shared[pair] for pair in way)),
        )
        before = {(true[a], other[b]) for a, b in best}
        switches += sum(last.get(who, whom) != whom for who, whom in before)
        last.update(before)
        hits, overlap = hits + len(best), overlap + sum(shared[pair] for pair in best)
    total, boxes = (sum(map(len, ids)) for ids in (sequence.true_ids, sequence.reported_ids))
    counts = clear(sequence)
    assert (counts.hits, counts.misses, counts.false, counts.switches) == (hits, total - hits, boxes - hits, switches)
    assert counts.overlap == pytest.approx(overlap)
    assert counts.mota == pytest.approx((hits - (boxes - hits) - switches) / max(total, 1))


@given(seed=seeds, frames=st.integers(1, 5), people=few, reported=few)
def test_idf1_is_that_of_all_renamings(seed: int, frames: int, people: int, reported: int) -> None:
    """IDF1 is the greatest share of boxes that bear the right name, over all ways to give each person one track."""
    sequence = sequence_of(seed, frames, people, reported)
    hits = max(
        sum(
            bool(shared[true.index(i), other.index(j)] >= 0.5)
            for true, other, shared in frames_of(sequence)
            for i, j in names
            if i in true and j in other
        )
        for names in matchings(sequence.true_count, sequence.reported_count)
    )
    boxes = sum(map(len, [*sequence.true_ids, *sequence.reported_ids]))
    assert identity(sequence).idf1 == pytest.approx(2 * hits / max(boxes, 2))


@given(seed=seeds, names=st.permutations(range(20)))
def test_scores_do_not_depend_on_names(seed: int, names: list[int]) -> None:
    """Other ids of the people and of the tracks give the same scores."""
    truth, tracks = video_of(seed)
    renamed = replace(truth, ids=np.array(names)[truth.ids])
    shuffled = [replace(track, id=names[track.id] + 1) for track in tracks]
    assert vars(evaluate_sequence(renamed, shuffled)) == pytest.approx(vars(evaluate_sequence(truth, tracks)))


@given(seed=seeds, scale=st.floats(0.25, 4), shift=st.floats(-50, 50))
def test_scores_do_not_depend_on_the_unit(seed: int, scale: float, shift: float) -> None:
    """Boxes of a larger picture, or of one cut elsewhere, have the same scores."""
    truth, tracks = video_of(seed)
    moved = replace(truth, boxes=truth.boxes * scale + shift)
    elsewhere = [replace(track, boxes=track.boxes * scale + shift) for track in tracks]
    assert vars(evaluate_sequence(moved, elsewhere)) == pytest.approx(vars(evaluate_sequence(truth, tracks)))


@given(seed=seeds, copies=st.integers(2, 4))
def test_a_sequence_and_its_copies_score_as_it_alone(seed: int, copies: int) -> None:
    """Several sequences with the same boxes have together the shares of one."""
    truth, tracks = video_of(seed)
    scores = evaluate_sequences(SequencePair(str(k), truth, tracks) for k in range(copies))
    for name in ("hota", "mota", "idf1", "recall", "precision", "motp"):
        assert getattr(scores.combined, name) == pytest.approx(getattr(scores.sequences["0"], name))


def points(rng: np.random.Generator, count: int) -> FloatArray:
    return rng.uniform(0, 10, (count, 2))


@given(seed=seeds, true=few, reported=few, c=cut_offs, p=orders)
def test_ospa_is_that_of_all_assignments(seed: int, true: int, reported: int, c: float, p: float) -> None:
    """OSPA is the least mean over all assignments of the smaller set, the rest at the cut-off."""
    rng = np.random.default_rng(seed)
    small, large = sorted([points(rng, true), points(rng, reported)], key=len)
    costs = [
        sum(min(float(np.linalg.norm(a - large[k])), c) ** p for a, k in zip(small, chosen, strict=True))
        for chosen in itertools.permutations(range(len(large)), len(small))
    ]
    expected = ((min(costs) + c**p * (len(large) - len(small))) / max(len(large), 1)) ** (1 / p)
    assert ospa(large, small, c, p).distance == pytest.approx(expected)


@given(seed=seeds, sizes=st.tuples(few, few, few), c=cut_offs, p=orders)
def test_ospa_is_a_metric(seed: int, sizes: tuple[int, int, int], c: float, p: float) -> None:
    """OSPA is the same both ways, 0 to itself, at most the cut-off, and no detour is shorter."""
    rng = np.random.default_rng(seed)
    a, b, d = (points(rng, count) for count in sizes)
    ab, ba, bd, ad = (ospa(x, y, c, p).distance for x, y in ((a, b), (b, a), (b, d), (a, d)))
    assert ab == pytest.approx(ba)
    assert ospa(a, a, c, p).distance == 0
    assert ab <= c * (1 + 1e-12)
    assert ad <= ab + bd + 1e-9


@given(seed=seeds, true=few, reported=few, c=cut_offs, p=orders)
def test_gospa_is_that_of_all_partial_assignments(seed: int, true: int, reported: int, c: float, p: float) -> None:
    """GOSPA is the least sum over all partial assignments, who is left at half the cut-off."""
    rng = np.random.default_rng(seed)
    a, b = points(rng, true), points(rng, reported)
    costs = [
        sum(float(np.linalg.norm(a[i] - b[j])) ** p for i, j in pairs) + c**p / 2 * (true + reported - 2 * len(pairs))
        for pairs in matchings(true, reported)
    ]
    assert gospa(a, b, c, p).distance ** p == pytest.approx(min(costs))


@given(seed=seeds, c=cut_offs)
def test_the_distance_of_two_tracks_is_the_mean_over_their_frames(seed: int, c: float) -> None:
    """Two tracks are as far apart as in the mean frame in which either is, at the cut-off where one is missing."""
    rng = np.random.default_rng(seed)
    paths = [{int(k): points(rng, 1)[0] for k in rng.permutation(6)[: rng.integers(1, 6)]} for _ in range(2)]
    apart = [
        min(float(np.linalg.norm(paths[0][k] - paths[1][k])), c) if k in paths[0] and k in paths[1] else c
        for k in paths[0].keys() | paths[1].keys()
    ]
    tables = [PointTracks(np.array([*path]), np.ones(len(path)), np.array([*path.values()])) for path in paths]
    assert track_distances(*tables, c).item() == pytest.approx(np.mean(apart))


def detected_images(seed: int, images: int = 3) -> tuple[list[LabelledBoxes], list[Detections]]:
    """Labels, some of them to be ignored, and detections beside them and elsewhere."""
    rng, truth, detections = np.random.default_rng(seed), [], []
    for image in range(images):
        boxes = boxes_of(rng, int(rng.integers(0, 4)) + (image == 0), 60)
        ignored = rng.random(len(boxes)) < 0.3
        ignored[: image == 0] = False
        near = boxes[rng.integers(0, len(boxes), 3)] + rng.normal(0, 3, (3, 1)) if len(boxes) else boxes
        reported = np.concatenate([near, boxes_of(rng, 2, 60)])
        truth.append(LabelledBoxes(boxes, ignored))
        detections.append(Detections(reported, rng.random(len(reported))))
    return truth, detections


@given(seed=seeds)
def test_average_precision_is_that_of_all_thresholds(seed: int) -> None:
    """AP is the mean over the labelled boxes of the best precision with which at least so many are detected."""
    truth, detections = detected_images(seed)
    right = []
    for labels, image in zip(truth, detections, strict=True):
        free = np.flatnonzero(~labels.ignored).tolist()
        for k in np.argsort(-image.scores).tolist():
            overlaps = {j: iou_matrix(image.boxes[k : k + 1], labels.boxes[j : j + 1]).item() for j in free}
            best = max(overlaps, key=overlaps.__getitem__, default=None)
            if best is not None and overlaps[best] >= 0.5:
                free.remove(best)
                right.append((image.scores[k], True))
            elif not any(covers(labels.boxes[j], image.boxes[k]) for j in np.flatnonzero(labels.ignored)):
                right.append((image.scores[k], False))
    count = sum(int((~labels.ignored).sum()) for labels in truth)
    hits = np.cumsum([hit for _, hit in sorted(right, reverse=True)])
    precision = hits / np.arange(1, len(hits) + 1)
    levels = [precision[hits >= number].max(initial=0.0) for number in range(1, count + 1)]
    assert evaluate_detections(truth, detections).average_precision == pytest.approx(np.mean(levels))


def covers(label: FloatArray, box: FloatArray) -> bool:
    """Whether a label covers at least half of a box."""
    side = np.minimum(label[2:], box[2:]) - np.maximum(label[:2], box[:2])
    return bool((side > 0).all() and side.prod() >= 0.5 * (box[2:] - box[:2]).prod())


@given(seed=seeds, order=st.permutations(range(3)))
def test_average_precision_depends_on_the_order_of_scores_alone(seed: int, order: list[int]) -> None:
    """Images in another order, and scores on another rising scale, have the same average precision."""
    truth, detections = detected_images(seed)
    scaled = [replace(image, scores=np.exp(5 * image.scores) - 7) for image in detections]
    other = evaluate_detections([truth[k] for k in order], [scaled[k] for k in order])
    assert other.average_precision == pytest.approx(evaluate_detections(truth, detections).average_precision)


@given(seed=seeds, frames=st.integers(1, 8))
def test_the_area_under_the_success_curve_is_the_mean_over_thresholds(seed: int, frames: int) -> None:
    """A frame is a success at a threshold where its overlap is above it: never at 1, and at 0 where it is hit."""
    rng = np.random.default_rng(seed)
    truth = boxes_of(rng, frames)
    result = truth + rng.choice([0.0, 4.0, 500.0], (frames, 1)) * rng.random((frames, 1)).round()
    overlaps = [iou_matrix(a[None], b[None]).item() for a, b in zip(truth, [truth[0], *result[1:]], strict=True)]
    scores = evaluate_boxes(truth, result)
    assert scores.auc == pytest.approx(np.mean([[o > k / 20 for o in overlaps] for k in range(21)]))
    assert scores.thesis_auc == pytest.approx(np.mean([[o > k / 10 for o in overlaps] for k in range(11)]))


@given(seed=seeds, views=st.integers(2, 8))
def test_retrieval_is_that_of_its_definition(seed: int, views: int) -> None:
    """Mean average precision is the mean of precisions at the right views, rank 1 whether the first is right."""
    rng = np.random.default_rng(seed)
    distances, gallery = rng.random((2, views)), rng.integers(0, 2, views)
    gallery[:2] = 0, 1
    precisions, firsts = [], []
    for person in range(2):
        right = gallery[np.argsort(distances[person])] == person
        precisions.append(np.mean([right[: k + 1].mean() for k in np.flatnonzero(right)]))
        firsts.append(right[0])
    scores = evaluate_retrieval(distances, np.arange(2), gallery, np.zeros((2, views), dtype=np.bool_))
    assert scores.mean_average_precision == pytest.approx(np.mean(precisions))
    assert scores.rank1 == pytest.approx(np.mean(firsts))
