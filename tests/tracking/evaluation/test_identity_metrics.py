"""HOTA, CLEAR MOT and identity scores against trackeval, then what holds in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tsuiseki.tracking.evaluation.identity_metrics import ALPHAS, LabelledSequence, clear, hota, identity


def crowded(seed: int, length: int = 40) -> LabelledSequence:
    """Crossing people, doubled and false boxes, ids that change, frames without true or found boxes."""
    rng = np.random.default_rng(seed)
    true_ids, reported_ids, overlaps = [], [], []
    for _ in range(length):
        true = np.flatnonzero(rng.random(6) < 0.7) if rng.random() > 0.1 else np.empty(0, np.int64)
        found = np.flatnonzero(rng.random(8) < 0.7) if rng.random() > 0.1 else np.empty(0, np.int64)
        near = 0.6 * (true[:, None] == found[None] % 6)
        shared = np.clip(near + rng.random((len(true), len(found))) * rng.choice([0.3, 0.9]), 0, 1)
        true_ids.append(true)
        reported_ids.append(found)
        # Values on the thresholds themselves, too.
        overlaps.append(np.where(rng.random(shared.shape) < 0.2, np.round(shared, 1), shared))
    return LabelledSequence(true_ids, reported_ids, overlaps, 6, 8)


def as_trackeval(sequence: LabelledSequence) -> dict[str, Any]:
    return {
        "num_timesteps": len(sequence.true_ids),
        "num_gt_ids": sequence.true_count,
        "num_tracker_ids": sequence.reported_count,
        "num_gt_dets": sum(map(len, sequence.true_ids)),
        "num_tracker_dets": sum(map(len, sequence.reported_ids)),
        "gt_ids": list(sequence.true_ids),
        "tracker_ids": list(sequence.reported_ids),
        "similarity_scores": list(sequence.overlaps),
    }


def empty_results(sequence: LabelledSequence) -> LabelledSequence:
    none = [np.empty(0, np.int64)] * len(sequence.true_ids)
    return LabelledSequence(sequence.true_ids, none, [o[:, :0] for o in sequence.overlaps], 6, 0)


@pytest.fixture(scope="module")
def peers() -> tuple[Any, Any, Any]:
    from trackeval.metrics import CLEAR, HOTA, Identity

    quiet = {"PRINT_CONFIG": False}
    return HOTA(), CLEAR(dict(quiet)), Identity(dict(quiet))


def agree(ours: tuple[Any, Any, Any], theirs: tuple[Any, Any, Any]) -> None:
    for name, field in (("HOTA", "hota"), ("DetA", "det_a"), ("AssA", "ass_a"), ("HOTA_TP", "hits")):
        np.testing.assert_allclose(getattr(ours[0], field), theirs[0][name], rtol=0, atol=1e-12, err_msg=name)
    for name, field in (
        ("MOTA", "mota"),
        ("MOTP", "motp"),
        ("IDSW", "switches"),
        ("CLR_TP", "hits"),
        ("CLR_FP", "false"),
        ("CLR_FN", "misses"),
        ("CLR_Re", "recall"),
        ("CLR_Pr", "precision"),
    ):
        assert getattr(ours[1], field) == pytest.approx(theirs[1][name], abs=1e-12), name
    for name, field in (("IDF1", "idf1"), ("IDTP", "hits"), ("IDFP", "false"), ("IDFN", "misses")):
        assert getattr(ours[2], field) == pytest.approx(theirs[2][name], abs=1e-12), name


@pytest.mark.parametrize("seed", range(12))
def test_they_are_those_of_trackeval(peers: tuple[Any, Any, Any], seed: int) -> None:
    sequence = crowded(seed) if seed < 11 else empty_results(crowded(seed))
    data = as_trackeval(sequence)
    agree(
        (hota(sequence), clear(sequence), identity(sequence)),
        (peers[0].eval_sequence(data), peers[1].eval_sequence(data), peers[2].eval_sequence(data)),
    )


def test_those_of_several_sequences_too(peers: tuple[Any, Any, Any]) -> None:
    several = [crowded(20), crowded(21, length=90), empty_results(crowded(22))]
    ours = [(hota(s), clear(s), identity(s)) for s in several]
    theirs = tuple(
        peer.combine_sequences({str(n): peer.eval_sequence(as_trackeval(s)) for n, s in enumerate(several)})
        for peer in peers
    )
    first, second, third = ours
    agree(tuple(a + b + c for a, b, c in zip(first, second, third, strict=True)), theirs)  # type: ignore[arg-type]


def test_the_thresholds_are_those_of_the_paper() -> None:
    np.testing.assert_allclose(ALPHAS, np.linspace(0.05, 0.95, 19))


def test_a_pair_is_kept_where_another_overlaps_more() -> None:
    """CLEAR keeps the pair of the frame before while it overlaps enough; the better one would be a switch."""
    both = np.array([0, 1])
    shared = [np.array([[0.9, 0.1]]), np.array([[0.6, 0.9]]), np.array([[0.4, 0.9]])]
    sequence = LabelledSequence([np.array([0])] * 3, [both] * 3, shared, 1, 2)
    assert clear(sequence).switches == 1
    assert clear(sequence).overlap == pytest.approx(0.9 + 0.6 + 0.9)
