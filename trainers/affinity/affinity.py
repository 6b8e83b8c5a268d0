"""Learning the flow's costs from labelled video: boosted trees for the transitions, logistic regression for scores.

The probability that two detections show the same person means: of all pairs like this one that pass the tracker's
gate, that share does, detections in between or not. Costs are logarithms of it, so it is calibrated: no class is
weighted, and the trees' overconfidence is measured on stretches they were not fitted on and taken back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import log_loss
from threadpoolctl import threadpool_limits

from tsuiseki.tracking.association.costs import ObservationCost
from tsuiseki.tracking.association.learnt_costs import FEATURE_SETS, FeatureSet
from tsuiseki.tracking.association.pairwise_flow import GateSettings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.retrieval import area_under_roc
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.tracking.options import OutputFile, Seed, Shared
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray
from tsuiseki.trainers.affinity.affinity_data import AffinityVideo
from tsuiseki.trainers.affinity.affinity_samples import (
    LabelledDetections,
    PairSamples,
    every_nth,
    join_samples,
    pair_samples,
)
from tsuiseki.trainers.exporting.export_affinity import export_affinity

# More of it makes two people alike less alike for no feature but the gap.
FALLING = {"iou": 1, "appearance": -1, "width": -1, "height": -1, "x": -1, "y": -1, "gap": 0, "action": -1}
GROUPS = 5
WINDOW = 10
UNKNOWN_SHARE = 0.1


@dataclass(frozen=True)
class BoostingSettings:
    """The gradient boosting.

    Attributes:
        trees: number of boosting rounds.
        learning_rate: weight of each tree.
        leaves: most leaves of a tree.
        least_samples: pairs that a leaf needs.
        regularisation: L2 penalty of the leaves.
    """

    trees: int = 120
    learning_rate: float = 0.1
    leaves: int = 12
    least_samples: int = 60
    regularisation: float = 5.0


@dataclass(frozen=True)
class AffinityReport:
    """How good the fit is on stretches it was not fitted on.

    Attributes:
        pairs: number of pairs.
        positives: those of the same person.
        auc: area under the ROC of the probability.
        log_loss: mean -log of the probability of what is true, after the calibration.
        scale: of the trees' logit; below 1 where they were overconfident.
        shift: of the trees' logit.
    """

    pairs: int
    positives: int
    auc: float
    log_loss: float
    scale: float
    shift: float


@dataclass(frozen=True)
class AffinitySettings(Shared):
    """What is learnt.

    Attributes:
        features: ``thesis``: overlap and appearance distance; ``extended``: also gap, size and motion.
        gate: which pairs to learn from; by default as the flow tracker asks, up to 10 frames apart. The tracker
            takes the largest gap over from the file.
        boosting: settings of the trees.
        b: bias of the observation cost (eq. 2.12).
    """

    features: Literal["thesis", "extended"] = "extended"
    gate: GateSettings | None = None
    boosting: BoostingSettings | None = None
    b: float = -0.5


SETTINGS, CHANCE = AffinitySettings(), Seed()


def fit_affinity(
    video: AffinityVideo, output: OutputFile, settings: AffinitySettings = SETTINGS, chance: Seed = CHANCE
) -> Path:
    """Fit the transition and observation costs of the flow to labelled video, and export them to one ONNX file.

    A network that was trained on the same frames does better there than in video it has not seen, and the costs would
    learn to trust it too much. One that says so of itself is refused. With ``cross_fit`` or ``cross_fit_detectors`` the
    frames are cut into as many equal stretches as there are networks, and network k, which must not have seen stretch
    k, looks at it.

    Args:
        out: ONNX file to write.
        seed: of all chance.
        overwrite: replace an existing file.

    Raises:
        RequestError: unusable folders or models, a network that has seen what it shall look at, no pairs of both
            kinds, or the file exists.
    """
    output.check()
    out, features = output.out, settings.features
    gate, boosting = settings.gate or GateSettings(window=WINDOW), settings.boosting or BoostingSettings()
    rng = np.random.default_rng(chance.seed)
    found = video.parts(rng)
    samples = join_samples(
        [
            pair_samples(every_nth(part, skip), features, gate, groups=max(1, -(-GROUPS // len(found))))
            for part in found
            for skip in video.skips or [1]
        ]
    )
    check_kinds(samples)
    samples = with_unknown(samples, FEATURE_SETS[features].index("appearance"), rng)
    trees, report = fit_transition(samples, FEATURE_SETS[features], boosting, chance.seed)
    observation = fit_observation(found, settings.b)
    card = affinity_card(features, gate, observation, report, video.folders, video.frames)
    export_affinity(trees, (report.scale, report.shift), card, out, samples.rows, output.overwrite)
    print(f"{out}: {report.pairs} pairs, {report.positives} of the same person")
    print(
        f"on unseen stretches AUC {report.auc:.4f}, log loss {report.log_loss:.4f}; logit scaled by {report.scale:.2f}"
    )
    print(f"observation cost {observation.b:g} {observation.alpha:+.2f} {observation.beta:+.2f} * score")
    return out


# OpenMP threads that wait for each other on a busy machine cost minutes; one alone needs seconds.
@threadpool_limits.wrap(limits=1)  # type: ignore[untyped-decorator]
def fit_transition(
    samples: PairSamples, names: Sequence[str], settings: BoostingSettings, seed: int
) -> tuple[HistGradientBoostingClassifier, AffinityReport]:
    """The trees, and how they do on groups of pairs they were not fitted on.

    The calibration is a logistic regression of the truth on the trees' out-of-group logits (Platt).

    Args:
        samples: pairs.
        names: of the features.
        settings: of the boosting.
        seed: of the boosting.
    """
    logits = np.empty(len(samples.same))
    for group in np.unique(samples.group):
        inside = samples.group == group
        if samples.same[~inside].all() or not samples.same[~inside].any():
            raise RequestError("expected pairs of the same person and of others in every part; give more frames")
        trees = _boost(samples, ~inside, names, settings, seed)
        logits[inside] = trees.decision_function(samples.rows[inside])
    platt = LogisticRegression(C=1e6).fit(logits[:, None], samples.same)
    probability = platt.predict_proba(logits[:, None])[:, 1]
    report = AffinityReport(
        len(samples.same),
        int(samples.same.sum()),
        area_under_roc(logits[samples.same], logits[~samples.same]),
        float(log_loss(samples.same, probability)),
        float(platt.coef_[0, 0]),
        float(platt.intercept_[0]),
    )
    return _boost(samples, np.ones(len(logits), dtype=np.bool_), names, settings, seed), report


def _boost(
    samples: PairSamples, which: BoolArray, names: Sequence[str], settings: BoostingSettings, seed: int
) -> HistGradientBoostingClassifier:
    trees = HistGradientBoostingClassifier(
        learning_rate=settings.learning_rate,
        max_iter=settings.trees,
        max_leaf_nodes=settings.leaves,
        min_samples_leaf=settings.least_samples,
        l2_regularization=settings.regularisation,
        monotonic_cst=[FALLING[name] for name in names],
        early_stopping=False,
        random_state=seed,
    )
    # A feature that is never known splits nothing; the binning wants a value all the same.
    rows = np.where(np.isnan(samples.rows).all(axis=0), 0.0, samples.rows)
    return trees.fit(rows[which], samples.same[which])


def fit_observation(found: Sequence[LabelledDetections], b: float) -> ObservationCost:
    """alpha and beta of eq. 2.13: logistic regression of "lies right on a labelled person" on the score."""
    scores = np.concatenate([part.scores for part in found])
    right = np.concatenate([part.right for part in found])
    if right.all() or not right.any():
        raise RequestError(
            "expected right and wrong detections to learn the observation cost from, got only "
            f"{'right' if right.all() else 'wrong'} ones; lower the detector's threshold or give more frames"
        )
    fitted = LogisticRegression(C=1e3).fit(scores[:, None], right)
    return ObservationCost(alpha=-float(fitted.intercept_[0]), beta=-float(fitted.coef_[0, 0]), b=b)


def check_kinds(samples: PairSamples) -> None:
    positives = int(samples.same.sum())
    if positives == 0 or positives == len(samples.same):
        raise RequestError(
            f"expected pairs of the same person and of different people, got {positives} and "
            f"{len(samples.same) - positives}; give longer or busier video"
        )


def with_unknown(samples: PairSamples, column: int, rng: np.random.Generator) -> PairSamples:
    """Some pairs once more without the appearance, so that the trees can price pairs of which it is not known."""
    chosen = np.flatnonzero(rng.random(len(samples.same)) < UNKNOWN_SHARE)
    rows: FloatArray = samples.rows[chosen].copy()
    rows[:, column] = np.nan
    order: IntArray = np.concatenate([np.arange(len(samples.same)), chosen])
    return replace(
        samples,
        rows=np.concatenate([samples.rows, rows]),
        same=samples.same[order],
        gap=samples.gap[order],
        group=samples.group[order],
    )


def affinity_card(
    features: FeatureSet,
    gate: GateSettings,
    observation: ObservationCost,
    report: AffinityReport,
    folders: Sequence[Path],
    frames: tuple[int, int] | None,
) -> ModelCard:
    stretch = "all frames" if frames is None else f"frames {frames[0]}-{frames[1]}"
    return ModelCard(
        kind="affinity",
        name="gradient boosting",
        class_names=FEATURE_SETS[features],
        layout="NF",
        settings={
            "features": features,
            "window": gate.window,
            "alpha": observation.alpha,
            "beta": observation.beta,
            "b": observation.b,
            "pairs": report.pairs,
            "positives": report.positives,
            "auc": report.auc,
            "log_loss": report.log_loss,
        },
        training_data=f"{', '.join(folder.name for folder in folders)}, {stretch}",
    )
