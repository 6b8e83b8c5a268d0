"""Learning the flow's costs from labelled video: boosted trees for the transitions, logistic regression for scores.

The probability that two detections show the same person means: of all pairs like this one that pass the tracker's
gate, that share does, detections in between or not. Costs are logarithms of it, so it is calibrated: no class is
weighted, and the trees' overconfidence is measured on parts they were not fitted on and taken back.

Where a network was trained, it is right more often than elsewhere, and costs that are fitted there trust it too much.
On later frames of PETS a detector of frames 1-400 with costs fitted to them reaches an IDF1 of .764, with other costs
.864. An exported network says what it was trained on (`ModelCard.training_data`).
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import PositiveInt
from pydantic.dataclasses import dataclass as pydantic_dataclass
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import log_loss
from threadpoolctl import threadpool_limits

from tsuiseki.datamodules.simulated_detections import DetectorFaults
from tsuiseki.tracking.association.costs import ObservationCost, pair_features
from tsuiseki.tracking.association.learnt_costs import FEATURE_SETS, FeatureSet, feature_rows
from tsuiseki.tracking.association.pairwise_flow import PRINTED_GATE, GateSettings, candidate_pairs
from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.coverage import UNMATCHED
from tsuiseki.tracking.evaluation.reidentification import area_under_roc
from tsuiseki.tracking.features.action import STREAMS, ActionRecogniser
from tsuiseki.tracking.features.exported import Appearance, Detector
from tsuiseki.tracking.fields import Commas, Options
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.onnx import ModelCard, OnnxModel
from tsuiseki.tracking.runs.options import OutputFile, Seed
from tsuiseki.tracking.types import BoolArray, Columns, Detections, FloatArray, IntArray
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.weights import shipped, shipped_or_file
from tsuiseki.trainers.exporting.written_costs import export_affinity
from tsuiseki.trainers.flow.videos import (
    RIGHT_OVERLAP,
    described,
    detected,
    labelled_sequences,
    match_boxes,
    span_of,
)
from tsuiseki.trainers.flow.videos import acting as with_actions

# Shorter words, such as "MOT" or "all", name no sequence.
SHORTEST_NAME = 4
_RANGE = re.compile(r"(\d+)\s*[-–]\s*(\d+)")


def trained_frames(training_data: str, sequence: str) -> list[tuple[float, float]]:
    """First and last frames of ``sequence`` that a network was trained on by its own words; all where it names none.

    Parts are separated by semicolons. A part is about the sequence where one of its words is the sequence's name, or
    its beginning from four letters on.

    >>> trained_frames("MOT17-02; PETS frames 1–300, 401-500", "PETS09-S2L1-first")
    [(1.0, 300.0), (401.0, 500.0)]
    >>> trained_frames("MOT17-02; PETS", "MOT17-02"), trained_frames("generated pictures", "MOT17-02")
    ([(0.0, inf)], [])
    """
    spans: list[tuple[float, float]] = []
    for part in training_data.split(";"):
        words = re.split(r"[\s,()/]+", part)
        names = [w for w in words if len(w) >= SHORTEST_NAME and sequence.lower().startswith(w.lower())]
        if names:
            text = " ".join(word for word in words if word not in names)
            ranges = [(float(a), float(b)) for a, b in _RANGE.findall(text)]
            spans += ranges or [(0.0, float("inf"))]
    return spans


def check_trained_elsewhere(models: Sequence[OnnxModel], frames: Sequence[tuple[str, int, int]]) -> None:
    """Refuse networks that were trained on the frames they run on; warn of those that do not state it.

    Args:
        models: the networks.
        frames: names of the sequences with the first and last frame of each, counted from 1.

    Raises:
        RequestError: one was, by its own words.
    """
    for model in models:
        path, card = model.path, model.card
        for sequence, first, last in frames:
            if any(a <= last and first <= b for a, b in trained_frames(card.training_data, sequence)):
                raise RequestError(
                    f"{path}: expected a {card.kind} that was not trained on frames {first}-{last} of {sequence}, got "
                    f"one trained on {card.training_data!r}; costs fitted there trust it too much; give other "
                    "`frames`"
                )
        if not card.training_data:
            warnings.warn(
                f"{path} does not say what it was trained on; costs fitted to frames it was trained on trust it too "
                "much",
                stacklevel=2,
            )


@dataclass(frozen=True)
class LabelledDetections(Columns):
    """All detections of some frames of a video and whom they show.

    Attributes:
        frames: ``(N,)`` frame numbers.
        boxes: ``(N, 4)`` pixels.
        scores: ``(N,)`` of the detector.
        features: ``(N, D)`` appearance, or None.
        ids: ``(N,)`` identities, `UNMATCHED` where a detection shows no labelled person.
        right: ``(N,)`` whether the box lies right, with an IoU of at least 0.5.
        actions: ``(N, A)`` probabilities of actions, or None.
    """

    frames: IntArray
    boxes: FloatArray
    scores: FloatArray
    features: FloatArray | None
    ids: IntArray
    right: BoolArray
    actions: FloatArray | None = None


@dataclass(frozen=True)
class PairSamples(Columns):
    """Pairs within the gate.

    Attributes:
        rows: ``(P, F)`` float32 features.
        same: ``(P,)`` whether both show the same person.
        group: ``(P,)`` number of the sequence and the part of it; pairs of one group are not independent.
    """

    rows: FloatArray
    same: BoolArray
    group: IntArray


def label_detections(detections: Sequence[Detections], truth: GroundTruth, first: int) -> LabelledDetections:
    """Match the detections of every frame to the labels: first those with an IoU of 0.5, then what is left with 0.25.

    Detections that only an ignored label explains are left out: it is unknown whether they are right.

    Args:
        detections: of the frames from ``first`` on.
        truth: labels.
        first: 0-based frame of the first entry.
    """
    ids, right, frames = [np.empty(0, np.int64)], [np.empty(0, np.bool_)], []
    for frame, of_frame in enumerate(detections, start=first):
        rows = truth.between(frame, frame)
        people, ignored = rows.select(rows.evaluated), rows.select(rows.ignored)
        person, lies_right = match_boxes(of_frame.boxes, people.boxes)
        hidden = (iou_matrix(of_frame.boxes, ignored.boxes) >= RIGHT_OVERLAP).any(axis=1) & (person < 0)
        names = np.append(people.ids, UNMATCHED)[person]
        ids.append(names[~hidden])
        right.append(lies_right[~hidden])
        frames.append(of_frame.select(~hidden))
    features = [d.features for d in frames if d.features is not None]
    actions = [d.actions for d in frames if d.actions is not None]
    return LabelledDetections(
        np.repeat(np.arange(first, first + len(frames)), [len(d) for d in frames]),
        np.concatenate([np.empty((0, 4)), *(d.boxes for d in frames)]),
        np.concatenate([np.empty(0), *(d.scores for d in frames)]),
        np.concatenate(features) if features else None,
        np.concatenate(ids),
        np.concatenate(right),
        np.concatenate(actions) if actions else None,
    )


def every_nth(detections: LabelledDetections, skip: int) -> LabelledDetections:
    """The detections of every ``skip``-th frame, as of a video with that much fewer frames."""
    in_step = detections.frames % skip == 0
    return replace(detections.select(in_step), frames=detections.frames[in_step] // skip)


def pair_samples(detections: LabelledDetections, features: FeatureSet, gate: GateSettings, groups: int) -> PairSamples:
    """The pairs that the tracker would ask about, in ``groups`` spans of equal length by the earlier detection.

    Pairs of two false detections are left out: that they are false is what their observation costs say, and a thing
    that is taken for a person again and again is one thing.
    """
    i, j, gap = candidate_pairs(detections.frames, detections.boxes, gate)
    labelled = (detections.ids[i] != UNMATCHED) | (detections.ids[j] != UNMATCHED)
    i, j, gap = i[labelled], j[labelled], gap[labelled]
    pairs = pair_features(detections.boxes, detections.features, i, j, gap, detections.actions)
    start, stop = (int(detections.frames.min()), int(detections.frames.max()) + 1) if len(detections) else (0, 1)
    return PairSamples(
        feature_rows(pairs, features).astype(np.float64),
        detections.ids[i] == detections.ids[j],
        (detections.frames[i] - start) * groups // (stop - start),
    )


def join_samples(parts: Sequence[PairSamples]) -> PairSamples:
    """All pairs of ``parts``, whose groups stay apart."""
    joined = parts[0]
    for part in parts[1:]:
        joined = joined.and_then(replace(part, group=part.group + int(joined.group.max(initial=-1)) + 1))
    return joined


def with_unknown(samples: PairSamples, column: int, share: float, rng: np.random.Generator) -> PairSamples:
    """A ``share`` of the pairs once more without the feature of a ``column``, so that trees weigh it unknown, too."""
    repeated = samples.select(rng.random(len(samples)) < share)
    repeated.rows[:, column] = np.nan
    return samples.and_then(repeated)


# More of it makes two people alike less alike for no feature but the gap.
FALLING = {"iou": 1, "appearance": -1, "width": -1, "height": -1, "x": -1, "y": -1, "gap": 0, "action": -1}
# Parts of each sequence of which each is left out once.
GROUPS = 5
# Of the gate, frames.
WINDOW = 10
# Share of the pairs that are also shown to the trees without their appearance.
UNKNOWN_SHARE = 0.1
# Weight of each tree.
LEARNING_RATE = 0.1
# Most leaves of a tree.
LEAVES = 12
# Pairs that a leaf needs, so that no leaf learns single pairs by heart.
LEAST_SAMPLES = 60
# L2 penalty of the leaves.
REGULARISATION = 5.0
# b, the bias of the observation cost (eq. 2.12).
BIAS = -0.5
# Of simulated detections.
FAULTS = DetectorFaults()


@pydantic_dataclass(frozen=True, kw_only=True, config=SETTINGS)
class AffinityVideo(Options):
    """What is learnt from.

    Attributes:
        folders: labelled sequences, or folders of them, in any layout that tsuiseki train association takes.
        frames: first and last frame to learn from, 1-based and both included.
        detections: ``given`` takes det/det.txt of each sequence; ``simulated`` draws faulty ones from the labels.
        detector: exported detector, or the name of a shipped one, to use instead of --detections.
        appearance: exported appearance network, or a shipped one; without one the appearance is unknown.
        actions: exported action streams, for features with actions; by default the shipped ones.
        skips: also learn from every n-th frame only, for other frame rates; 1 is the video itself.
    """

    folders: Commas[list[Path]]
    frames: Commas[tuple[PositiveInt, PositiveInt] | None] = None
    detections: Literal["given", "simulated"] = "given"
    detector: Path | None = None
    appearance: Path | None = None
    actions: Commas[list[Path] | None] = None
    skips: Commas[list[PositiveInt] | None] = None

    def parts(self, rng: np.random.Generator, *, acting: bool = False) -> list[LabelledDetections]:
        """The detections of every part, described, with who they are.

        Args:
            rng: of simulated detections.
            acting: with what people do.

        Raises:
            RequestError: unusable folders or models, or a network that was trained on the frames it runs on.
        """
        appearance = None if self.appearance is None else Appearance(shipped_or_file("appearance", self.appearance))
        detector = None if self.detector is None else Detector(shipped_or_file("detector", self.detector))
        videos = [(video, span_of(video, self.frames)) for video in labelled_sequences(self.folders)]
        frames = [(video.name, start + 1, stop) for video, (start, stop) in videos]
        check_trained_elsewhere([network.model for network in (appearance, detector) if network is not None], frames)
        streams = self.actions or [shipped(f"action_drone_{name}") for name in STREAMS]
        recognise = ActionRecogniser(streams) if acting else None
        parts = []
        for video, (start, stop) in videos:
            observed = detected(video, detector or self.detections, rng, FAULTS, self.frames)
            observed = with_actions(described(observed, appearance, (start, stop)), recognise)
            parts.append(label_detections(observed.detections[start:stop], video.truth, start))
        return parts


@dataclass(frozen=True)
class AffinityReport:
    """How good the fit is on parts it was not fitted on.

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


@pydantic_dataclass(frozen=True, kw_only=True, config=SETTINGS)
class AffinitySettings(Options):
    """What is learnt.

    Attributes:
        features: thesis: overlap and appearance distance, for --preset printed; extended: also gap, size and motion.
            thesis_action and extended_action: also the distance of action features.
        trees: number of boosting rounds.
    """

    features: FeatureSet = "extended"
    trees: PositiveInt = 120


EXTENDED = AffinitySettings()
CHANCE = Seed()


def fit_affinity(
    video: AffinityVideo, output: OutputFile, settings: AffinitySettings = EXTENDED, chance: Seed = CHANCE
) -> Path:
    """Fit the transition and observation costs of the flow to labelled video, and export them to one ONNX file.

    Networks must not have been trained on these frames: the costs would trust them too much. Those that name them as
    their training data are refused.

    Args:
        output.out: file to write.
        output.overwrite: replace an existing file.

    Raises:
        RequestError: unusable folders or models, a network that was trained on the frames it runs on, no pairs of both
            kinds, or the file exists.
    """
    output.check()
    out, features = output.out, settings.features
    gate = PRINTED_GATE if features.startswith("thesis") else GateSettings(window=WINDOW)
    rng = np.random.default_rng(chance.seed)
    parts = video.parts(rng, acting="action" in FEATURE_SETS[features])
    samples = join_samples(
        [
            pair_samples(every_nth(part, skip), features, gate, groups=max(1, -(-GROUPS // len(parts))))
            for part in parts
            for skip in video.skips or [1]
        ]
    )
    positives = int(samples.same.sum())
    if positives in (0, len(samples)):
        raise RequestError(
            f"expected pairs of the same person and of different people, got {positives} and "
            f"{len(samples) - positives}; give longer or busier video"
        )
    samples = with_unknown(samples, FEATURE_SETS[features].index("appearance"), UNKNOWN_SHARE, rng)
    trees, report = fit_transition(samples, FEATURE_SETS[features], settings.trees, chance.seed)
    observation = fit_observation(parts)
    card = affinity_card(features, observation, report, video)
    export_affinity(trees, (report.scale, report.shift), card, out, samples.rows, output.overwrite)
    print(f"{out}: {report.pairs} pairs, {report.positives} of the same person")
    print(f"on unseen parts AUC {report.auc:.4f}, log loss {report.log_loss:.4f}; logit scaled by {report.scale:.2f}")
    print(f"observation cost {observation.b:g} {observation.alpha:+.2f} {observation.beta:+.2f} * score")
    return out


# OpenMP threads that wait for each other on a busy machine cost minutes; one alone needs seconds.
@threadpool_limits.wrap(limits=1)  # type: ignore[untyped-decorator]
def fit_transition(
    samples: PairSamples, names: Sequence[str], count: int, seed: int
) -> tuple[HistGradientBoostingClassifier, AffinityReport]:
    """The trees, and how they do on groups of pairs they were not fitted on.

    The calibration is a logistic regression of the truth on the trees' out-of-group logits (Platt).

    Args:
        samples: pairs.
        names: of the features.
        count: of trees.
        seed: of the boosting.
    """
    logits = np.empty(len(samples.same))
    for group in np.unique(samples.group):
        inside = samples.group == group
        if samples.same[~inside].all() or not samples.same[~inside].any():
            raise RequestError("expected pairs of the same person and of others in every part; give more frames")
        trees = _boost(samples, ~inside, names, count, seed)
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
    return _boost(samples, np.ones(len(logits), dtype=np.bool_), names, count, seed), report


def _boost(
    samples: PairSamples, which: BoolArray, names: Sequence[str], count: int, seed: int
) -> HistGradientBoostingClassifier:
    trees = HistGradientBoostingClassifier(
        learning_rate=LEARNING_RATE,
        max_iter=count,
        max_leaf_nodes=LEAVES,
        min_samples_leaf=LEAST_SAMPLES,
        l2_regularization=REGULARISATION,
        monotonic_cst=[FALLING[name] for name in names],
        early_stopping=False,
        random_state=seed,
    )
    # A feature that is never known splits nothing; the binning wants a value all the same.
    rows = np.where(np.isnan(samples.rows).all(axis=0), 0.0, samples.rows)
    return trees.fit(rows[which], samples.same[which])


def fit_observation(parts: Sequence[LabelledDetections]) -> ObservationCost:
    """alpha and beta of eq. 2.13: logistic regression of "lies right on a labelled person" on the score."""
    scores = np.concatenate([part.scores for part in parts])
    right = np.concatenate([part.right for part in parts])
    if right.all() or not right.any():
        raise RequestError(
            "expected right and wrong detections to learn the observation cost from, got only "
            f"{'right' if right.all() else 'wrong'} ones; lower the detector's threshold or give more frames"
        )
    fitted = LogisticRegression(C=1e3).fit(scores[:, None], right)
    return ObservationCost(alpha=-float(fitted.intercept_[0]), beta=-float(fitted.coef_[0, 0]), b=BIAS)


def affinity_card(
    features: FeatureSet, observation: ObservationCost, report: AffinityReport, video: AffinityVideo
) -> ModelCard:
    """What the exported file will say about itself."""
    part = "all frames" if video.frames is None else f"frames {video.frames[0]}-{video.frames[1]}"
    return ModelCard(
        kind="affinity",
        name="gradient boosting",
        class_names=FEATURE_SETS[features],
        layout="NF",
        settings={
            "features": features,
            "window": WINDOW,
            "alpha": observation.alpha,
            "beta": observation.beta,
            "b": observation.b,
            "pairs": report.pairs,
            "positives": report.positives,
            "auc": report.auc,
            "log_loss": report.log_loss,
        },
        training_data=f"{', '.join(folder.name for folder in video.folders)}, {part}",
    )
