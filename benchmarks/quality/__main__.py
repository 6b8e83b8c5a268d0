"""The estimate of a result's quality (`tsuiseki evaluate people --unlabelled`): its fit, and how well it holds.

    python -m benchmarks.quality --out DIR [--streets 152] [--data ../shared/data]

Generated streets are tracked by several methods over simulated detectors (`streets`), and scored against their truth.
Signs and scores are kept in ``DIR/streets.jsonl``, so that a run goes on where it ended. They fit
``DIR/quality_people.onnx``, as it ships. Other streets, and the labelled sets, which it never sees, say how often the
intervals hold the true score, how wide they are, and how estimates go with scores.
"""

from __future__ import annotations

import argparse
import json
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from skl2onnx import to_onnx
from skl2onnx.common.data_types import FloatTensorType
from sklearn.ensemble import ExtraTreesRegressor
from sklearn.model_selection import GroupKFold, cross_val_predict

from benchmarks.papers import association
from benchmarks.quality.streets import detected_street
from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.errors import InputWarning, RequestError, RunError
from tsuiseki.tracking.evaluation.multi import PeopleScores, evaluate_sequence, restrict
from tsuiseki.tracking.evaluation.quality import FEWEST, SCORES, estimated, scaled_score, sign_row, variant_of
from tsuiseki.tracking.evaluation.quality_signs import NETWORK_SIGNS, network_signs, track_signs
from tsuiseki.tracking.onnx import ModelCard, OnnxModel
from tsuiseki.tracking.people.bytetrack import ByteTrack
from tsuiseki.tracking.people.contract import PeopleTracker, run_tracker
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.ocsort import OcSort
from tsuiseki.tracking.people.sort import Sort
from tsuiseki.tracking.types import Detections, FloatArray, IntArray, Track
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.weights.listing import LICENCE
from tsuiseki.trainers.exporting.export import write_checked
from tsuiseki.trainers.exporting.written_costs import ON_A_THRESHOLD, OPSET, TOLERANCE

# Streets that the fit never sees begin at this seed; there is one for ten of the others.
UNSEEN = 50_000
# Least labelled boxes of a sequence whose scores say something.
LEAST_LABELLED = 100
# The labelled sets of people, by their keys in `association`.
SETS = ("mot17", "mot15", "kitti-pedestrians", "pets", "tud")
# What turns an unbounded score into a logit.
SCORE_SCALES = {"det-acf.txt": 0.05}
# Trees, fewest rows in a leaf, and the share of the signs that a split is chosen from.
TREES = {"n_estimators": 60, "min_samples_leaf": 3, "max_features": 0.7, "random_state": 0}
FOLDS = 8
# Least recall and precision of a street: below, nobody asks how good a result is.
LEAST_RECALL = 0.2
LEAST_PRECISION = 0.3
# What is in the fit of each street, by what is known of a result.
VARIANTS = {
    "tracks network scores": (),
    "tracks network": ("score",),
    "tracks scores": ("network",),
    "tracks": ("score", "network"),
}


@dataclass(frozen=True)
class Case:
    """A video that was tracked, its signs and its true scores.

    Attributes:
        name: of the street or sequence.
        method: that tracked it.
        signs: see `quality_signs`.
        boxes: of the result.
        scores: what `SCORES` are truly.
    """

    name: str
    method: str
    signs: dict[str, float]
    boxes: int
    scores: dict[str, float]


def main() -> None:
    """Make the table, the fit and the report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--streets", type=int, default=152)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", InputWarning)
    arguments.out.mkdir(parents=True, exist_ok=True)
    streets = street_cases(range(arguments.streets), arguments.out / "streets.jsonl")
    fitted(streets, arguments.out / "quality_people.onnx")
    model = OnnxModel(arguments.out / "quality_people.onnx", "quality", threads=1)
    unseen = range(UNSEEN, UNSEEN + arguments.streets // 10)
    print(report("streets that it never saw", street_cases(unseen, arguments.out / "unseen.jsonl"), model))
    labelled = [*labelled_cases(arguments.data)]
    for title, methods in (("labelled sets, flow", {"FlowTracker"}), ("labelled sets, ByteTrack", {"ByteTrack"})):
        print(report(title, [case for case in labelled if case.method in methods], model))


def street_cases(seeds: Sequence[int], path: Path) -> list[Case]:
    """The streets of some seeds that are `useful`, from the file where they are there, and written there."""
    cases = [Case(**json.loads(line)) for line in path.read_text().splitlines()] if path.is_file() else []
    done = {int(case.name) for case in cases}
    with path.open("a") as file:
        for seed in (seed for seed in seeds if seed not in done):
            try:
                street = detected_street(seed)
            except RequestError:  # No camera shows so many people as large as they were drawn.
                continue
            tracker = street_tracker(np.random.default_rng([seed, 67]), street.rate, street.size)
            case = tracked_case(str(seed), tracker, street.detections, street.truth, street.rate, street.size)
            if case is not None:
                cases.append(case)
                file.write(json.dumps(vars(case)) + "\n")
                file.flush()
    return sorted((case for case in cases if int(case.name) in seeds and useful(case)), key=lambda case: int(case.name))


def street_tracker(rng: np.random.Generator, rate: float, size: tuple[int, int]) -> PeopleTracker:
    """One in two times the flow as it is, one in four with other settings, or else another method."""
    chance = rng.random()
    if chance < 0.5:
        return FlowTracker(frame_rate=rate, size=size)
    if chance < 0.75:
        shortest, longest = float(rng.choice([0.01, 0.16, 0.5, 1.0])), float(rng.choice([0, 0.5, 2, 4]))
        smooth = bool(rng.random() < 0.7)
        return FlowTracker(frame_rate=rate, size=size, min_time=shortest, fill=longest, smoothing=smooth)
    return (Sort, ByteTrack, OcSort)[rng.integers(3)]()


def tracked_case(
    name: str,
    tracker: PeopleTracker,
    detections: Sequence[Detections],
    truth: GroundTruth,
    rate: float,
    size: tuple[int, int] | None,
) -> Case | None:
    """The case of a video; None where too little is tracked to say anything."""
    length = len(detections)
    tracks = restrict(run_tracker(detections, tracker), FrameRange(0, length - 1))
    network = tracker.network() if isinstance(tracker, FlowTracker) else None
    scores = evaluate_sequence(truth, tracks, length)
    return case_of(name, type(tracker).__name__, tracks, network, rate, size, length, scores)


def case_of(
    name: str,
    method: str,
    tracks: Sequence[Track],
    network: SolvedNetwork | None,
    rate: float,
    size: tuple[int, int] | None,
    length: int,
    scores: PeopleScores,
) -> Case | None:
    """Signs and scores of tracks; None of too few boxes."""
    boxes = sum(map(len, tracks))
    if boxes < FEWEST:
        return None
    signs = track_signs([track for track in tracks if len(track)], rate, size, (0, length - 1))
    signs |= {} if network is None else network_signs(network)
    return Case(name, method, signs, boxes, {score: float(getattr(scores, score)) for score in SCORES})


def useful(case: Case) -> bool:
    """Whether a street is tracked well enough that its quality is asked for."""
    return case.scores["recall"] >= LEAST_RECALL and case.scores["precision"] >= LEAST_PRECISION


def fitted(cases: Sequence[Case], path: Path) -> None:
    """Fit the trees to streets, and write them as ONNX.

    A street counts once for each of `VARIANTS` that it can show.
    """
    columns = {
        name: [case.signs[name] for case in cases if name in case.signs] for case in cases for name in case.signs
    }
    usual = {name: float(np.median(values)) for name, values in columns.items()} | {"no_network": 0.0, "no_scores": 0.0}
    names = [*usual]
    parts = [
        (number, variant, sign_row(reduced, names, usual))
        for number, case in enumerate(cases)
        for variant, without in VARIANTS.items()
        if variant_of(reduced := _without(case.signs, without)) == variant
    ]
    rows = np.array([row for *_, row in parts]).astype(np.float32).astype(np.float64)
    groups, variants = np.array([n for n, *_ in parts]), np.array([v for _, v, _ in parts])
    true = np.array([scaled_scores(case) for case in cases])[groups]
    mean, spread = true.mean(axis=0), true.std(axis=0)
    scaled = (true - mean) / spread
    errors = true - (_left_out(rows, scaled, groups) * spread + mean)
    quantiles = {
        variant: dict(zip(SCORES, np.quantile(errors[variants == variant], [0.05, 0.95], axis=0).T.round(4).tolist(),
                          strict=True)) for variant in VARIANTS
    }  # fmt: skip
    settings = {"usual": usual, "mean": mean.tolist(), "spread": spread.tolist(), "quantiles": quantiles}
    card = ModelCard(
        kind="quality",
        name="extremely randomized trees",
        class_names=tuple(names),
        layout="NF",
        settings=settings,
        training_data=f"{len(cases)} generated streets, simulated detectors",
        licence=LICENCE,
    )
    export_trees(_trees().fit(rows, scaled), card, path, rows)


def _without(signs: dict[str, float], kinds: Sequence[str]) -> dict[str, float]:
    """Signs less those of scores or of the network; without a network nothing is left of it."""
    starts = tuple("score" if kind == "score" else kind for kind in kinds)
    gone = {name for name in signs if name.startswith("score") and "score" in starts}
    gone |= {name for name in signs if name in NETWORK_SIGNS and "network" in starts}
    return {name: value for name, value in signs.items() if name not in gone}


def scaled_scores(case: Case) -> FloatArray:
    """``(6,)`` true scores as they are estimated."""
    values = {**case.scores, "id_switches": 1000 * case.scores["id_switches"] / case.boxes}
    return np.array([float(scaled_score(name, values[name])) for name in SCORES])


def _trees() -> ExtraTreesRegressor:
    return ExtraTreesRegressor(**TREES)


def _left_out(rows: FloatArray, targets: FloatArray, groups: IntArray) -> FloatArray:
    """What trees say of rows of streets that they did not see."""
    folds = GroupKFold(FOLDS, shuffle=True, random_state=0)
    return np.asarray(cross_val_predict(_trees(), rows, targets, groups=groups, cv=folds))


def export_trees(trees: ExtraTreesRegressor, card: ModelCard, path: Path, rows: FloatArray) -> None:
    """Write trees as ONNX, once they answer as scikit-learn's do."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        opset = {"": OPSET, "ai.onnx.ml": 3}
        kind = [("signs", FloatTensorType([None, rows.shape[1]]))]
        model = to_onnx(trees, initial_types=kind, target_opset=opset)

    def parity(work: Path) -> float:
        answers = OnnxModel(work, "quality", threads=1).run(rows.astype(np.float32))[0]
        difference = np.abs(answers - trees.predict(rows))
        if np.mean(difference > TOLERANCE) > ON_A_THRESHOLD:
            raise RunError(f"parity check failed: answers differ by up to {difference.max():.2g} from scikit-learn's")
        return float(difference.max())

    write_checked(model, card, path, parity, overwrite=True)


def report(title: str, cases: Sequence[Case], model: OnnxModel) -> str:
    """How often intervals hold the true score, how wide they are, and how the estimate goes with it."""
    lines = [f"{title}: {len(cases)}", "score        holds  width  correlation  mean error"]
    for name in SCORES:
        intervals = np.array([estimated(case.signs, case.boxes, model)[name] for case in cases])
        true = np.array([case.scores[name] for case in cases])
        value, low, high = intervals.T
        held = ((low <= true + 1e-3) & (true <= high + 1e-3)).mean()
        together = np.corrcoef(value, true)[0, 1]
        error = np.abs(value - true).mean()
        lines.append(f"{name:12s} {held:5.2f}  {(high - low).mean():5.2f}  {together:11.2f}  {error:10.3f}")
    return "\n".join(lines)


def labelled_cases(data: Path) -> Iterable[Case]:
    """The labelled sequences of people, by the flow and by ByteTrack over their given detections."""
    for data_set in (s for s in association.DATA_SETS if s.key in SETS):
        for sequence in association.find_sequences(data, replace(data_set, frames=None)):
            truth = association.sequence_labels(sequence)
            if truth.evaluated.sum() < LEAST_LABELLED:
                continue
            for path in (sequence.detections, sequence.detections.with_name("det-acf.txt")):
                if not path.is_file():
                    continue
                scale = 1.0 if data_set.logits else SCORE_SCALES.get(path.name)
                given = association.sequence_detections(replace(sequence, detections=path))
                detections = given if scale is None else [_as_probabilities(entry, scale) for entry in given]
                name = f"{sequence.name} {path.stem}"
                size = sequence.filmed["size"]
                for tracker in (FlowTracker(**sequence.filmed), ByteTrack()):
                    case = tracked_case(name, tracker, detections, truth, sequence.rate, size)
                    if case is not None:
                        yield case


def _as_probabilities(detections: Detections, scale: float) -> Detections:
    return Detections(detections.boxes, 1 / (1 + np.exp(-scale * detections.scores)))


if __name__ == "__main__":
    main()
