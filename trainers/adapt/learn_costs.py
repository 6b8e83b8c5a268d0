"""What links cost in a camera's video, fitted to its own tracks; taken only where they keep identities better.

Tracks made of all frames are followed once more with some frames missing, on a stretch that nothing was fitted to:
costs that fit the camera then still say who is who.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.association.affinity import FEATURE_SETS, Affinity
from tsuiseki.tracking.association.costs import ScoreCost
from tsuiseki.tracking.association.gating import GateSettings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.multi import evaluate_sequence, restrict
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.trainers.adapt.examples import truth_of, with_gaps
from tsuiseki.trainers.adapt.find import Found, track
from tsuiseki.trainers.adapt.labels import Labels
from tsuiseki.trainers.adapt.watch import Watched
from tsuiseki.trainers.affinity.affinity import (
    GROUPS,
    WINDOW,
    BoostingSettings,
    affinity_card,
    check_kinds,
    fit_observation,
    fit_transition,
    with_unknown,
)
from tsuiseki.trainers.affinity.affinity_samples import LabelledDetections, join_samples, pair_samples
from tsuiseki.trainers.exporting.export_affinity import export_affinity

_BIAS = -0.5


@dataclass(frozen=True)
class Stretch:
    """A part of a video, to its end.

    Attributes:
        watched: the video.
        found: in all of it.
        labels: tracks of all of it.
        first: frame that the part begins with; it goes to the end.
    """

    watched: Watched
    found: Found
    labels: Labels
    first: int


def fit_costs(samples: list[LabelledDetections], sources: list[Path], out: Path, seed: int) -> Path | None:
    """Fit the prices of links and detections, and export them.

    Args:
        samples: named detections of each video.
        sources: the videos, for the file's metadata.
        out: the file.
        seed: of all chance.

    Returns:
        ``out``; None where the detections do not hold both kinds, of pairs or of detections.
    """
    gate = GateSettings(window=WINDOW)
    features = FEATURE_SETS["extended"]
    try:
        pairs = join_samples([pair_samples(s, "extended", gate, max(1, -(-GROUPS // len(samples)))) for s in samples])
        check_kinds(pairs)
        pairs = with_unknown(pairs, features.index("appearance"), np.random.default_rng(seed))
        trees, report = fit_transition(pairs, features, BoostingSettings(), seed)
        observation = fit_observation(samples, _BIAS)
    except RequestError:
        return None
    card = replace(
        affinity_card("extended", gate, observation, report, sources, None),
        training_data="tracks of unlabelled video of one camera (tsuiseki adapt)",
    )
    export_affinity(trees, (report.scale, report.shift), card, out, pairs.rows, overwrite=True)
    return out


def identity_kept(
    stretches: list[Stretch],
    score_threshold: float,
    costs: Affinity | None = None,
    scores: ScoreCost | None = None,
    gap: int = 1,
) -> float | None:
    """IDF1 of tracks made with frames missing against those of all frames, the mean over the stretches.

    Args:
        stretches: with people.
        score_threshold: of the detections that are tracked.
        costs: to try; None takes those that the tracks were made with.
        scores: what detections are worth where neither says so: with frames missing, the video itself can hardly tell.
        gap: frames that are missing, after as many that are there, and so on.

    Returns:
        None where nobody is there.
    """
    kept, weights = [], []
    for stretch in stretches:
        watched, found = stretch.watched, stretch.found
        end = found.first + watched.length
        truth = truth_of(stretch.labels).between(stretch.first, end - 1)
        if not truth.evaluated.any():
            continue
        fewer = replace(
            found,
            detections=with_gaps(found.detections, gap),
            costs=costs or found.costs,
            scores=found.scores or scores,
        )
        tracks = restrict(track(watched, fewer, score_threshold), FrameRange(stretch.first, end - 1))
        kept.append(evaluate_sequence(truth, tracks, end).idf1)
        weights.append(int(truth.evaluated.sum()))
    return float(np.average(kept, weights=weights)) if kept else None
