"""`tsuiseki evaluate`: results against labels; a function for each kind."""

from __future__ import annotations

import json as text
import sys
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import PositiveFloat, PositiveInt, field_validator
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS, PositiveShare, Share
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.result_files import result_names
from tsuiseki.tracking.fields import ClassNames, Commas, Options
from tsuiseki.tracking.formats.okutama import Protocol
from tsuiseki.tracking.runs.options import Files
from tsuiseki.tracking.types.frame_range import FrameRange, parse_frames

if TYPE_CHECKING:
    from rich.table import Table


@dataclass(frozen=True, config=SETTINGS)
class Evaluated(Options):
    """What is scored against what.

    Attributes:
        truth: the labels.
        results: what is scored; several are compared.
    """

    truth: Path
    results: list[Path]


@dataclass(frozen=True, config=SETTINGS)
class Comparison(Files, Evaluated):
    """Likewise, and where the scores go.

    Attributes:
        json: write all scores to this file.
    """

    file_options: ClassVar[Sequence[str]] = ("json",)
    _: KW_ONLY
    json: Path | None = None

    def check(self) -> None:
        super().check()
        self.named()

    def named(self) -> dict[str, Path]:
        """The results, each by a name as short as tells them apart."""
        return dict(zip(result_names(self.results), self.results, strict=True))

    def report(self, table: Table, values: Mapping[str, Any], right: Mapping[str, float] | None = None) -> None:
        """Print the scores, and write them where that is wanted; a 0 in ``right`` is reported, for it is no score."""
        from tsuiseki.tracking.evaluation.tables import show

        for name in [name for name, share in (right or {}).items() if not share]:
            reason = "nothing in it is on a label; is it of another video, in another unit, or empty?"
            warnings.warn(f"{name}: {reason}", InputWarning, stacklevel=2)
        show(table)
        if self.json is not None:
            written = text.dumps(values, indent=1, default=vars) + "\n"
            self.write(self.json, lambda path: path.write_text(written, encoding="utf-8"))


@dataclass(frozen=True, config=SETTINGS)
class PlottedComparison(Comparison):
    """Likewise, with a plot.

    Attributes:
        plot: write a comparison plot to this file (PNG, SVG or PDF).
    """

    file_options: ClassVar[Sequence[str]] = ("json", "plot")
    _: KW_ONLY
    plot: Path | None = None


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class ScoredFrames(Options):
    """Which frames count.

    Attributes:
        frames: score this segment only, counted from 1 with both ends, such as 301-400.
    """

    frames: str | None = None

    @field_validator("frames")
    @classmethod
    def _range(cls, frames: str | None) -> str | None:
        parse_frames(frames)
        return frames

    @property
    def range(self) -> FrameRange:
        """The frames, 0-based."""
        return parse_frames(self.frames)


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class Labels(ScoredFrames):
    """How labels are read.

    Attributes:
        protocol: for labels like Okutama-Action's. lenient scores all frames, and results on hidden people are neither
            right nor wrong; published, as in the numbers published with the data, leaves out the first frame and all
            labels of hidden people, so that results on them are wrong.
        size: width and height of the frames that were tracked, to which labels of Okutama-Action are scaled, given in
            pixels of 3840x2160; by default those of the frames that lie with the labels, or else 1280,720. Of other
            labels that are shares or percent of the picture, the size of that picture.
    """

    protocol: Protocol = "lenient"
    size: Commas[tuple[PositiveInt, PositiveInt] | None] = None


SCORED, LABELS = ScoredFrames(), Labels()


@dataclass(frozen=True, config=SETTINGS)
class PeopleComparison(PlottedComparison):
    """Likewise, or what results show of their own quality.

    Attributes:
        unlabelled: all that is named is a result, and its scores are estimated without labels.
    """

    results: list[Path] = field(default_factory=list)
    _: KW_ONLY
    unlabelled: bool = False

    def check(self) -> None:
        if self.unlabelled and self.plot is not None:
            raise RequestError("`plot`: expected it with labels; leave it out with --unlabelled")
        if not self.unlabelled and not self.results:
            raise RequestError("expected labels and a result, got one path; --unlabelled scores it without labels")
        super().check()

    def named(self) -> dict[str, Path]:
        results = [self.truth, *self.results] if self.unlabelled else self.results
        return dict(zip(result_names(results), results, strict=True))


def action(compared: Comparison, *, labels: Labels = LABELS, threshold: Share = 0.4) -> None:
    """Score recognised actions: F1 at a threshold, and average precision, for every action.

    A row is a labelled person in a frame, or a tracked box on none. An action is called where its probability is
    above the threshold; F1 = 2 TP / (2 TP + FP + FN) over all rows. "single" are the probabilities of single frames,
    "multi" those averaged over the window along the track. With tracks given to `track drone --tracks`, only
    recognition is scored; with tracks of its own, misses and false tracks count, too.

    Args:
        compared.truth: a MOTChallenge sequence folder with gt/actions.txt (Okutama-Action's rows), or a folder of such;
            a label file or the folder of Okutama-Action; the folder of Drone-Action.
        compared.results: tracks.json of tsuiseki track drone, or folders that hold NAME/tracks.json for each clip NAME
            (for a single clip also tracks.json); several are compared.
        threshold: an action is called where its probability is above, from 0 to 1.
    """
    from tsuiseki.tracking.evaluation.actions import (
        action_table,
        action_values,
        evaluate_actions,
        match_actions,
        read_labelled_actions,
    )

    truths = read_labelled_actions(compared.truth, labels.protocol, labels.size, labels.range)
    scores = {}
    for name, result in compared.named().items():
        rows = match_actions(truths, result)
        for kind in ("single", "multi"):
            values = getattr(rows, kind)
            scores[f"{name} {kind}"] = evaluate_actions(truths[0].names, values, rows.truth, threshold)
    compared.report(action_table(scores), action_values(scores))


def detection(
    compared: Comparison,
    *,
    labels: Labels = LABELS,
    iou: PositiveShare = 0.5,
    score_range: Commas[tuple[float, float]] = (0.0, 1.0),
) -> None:
    """Score detections against ground truth: average precision, recall, and the threshold of the best F1.

    Where labels say how much of each person is visible, they are also scored by that, all others being ignored.

    Args:
        compared.truth: whatever evaluate people takes, also labels of single pictures; or rotated boxes: the
            JSON of CEPDOF or MW-R, or a folder of HABBOF's text files.
        compared.results: MOTChallenge detection files (det.txt), or folders that hold NAME.txt, NAME/det/det.txt or
            NAME/detections.txt for each sequence NAME; detectors, exported (.onnx) or as trained (.ckpt, needs the
            train extra), which run on the labelled images; for rotated boxes also JSON lists of image_id, bbox (cx, cy,
            w, h, degrees clockwise) and score, which are scored by the overlap of the turned boxes.
        iou: overlap from which a detection is right.
        score_range: smallest and largest score that the detections may have.
        compared.json: write the scores to this file, with recall and precision at every detection.
    """
    from tsuiseki.tracking.evaluation.detection import evaluate_rotated_file
    from tsuiseki.tracking.evaluation.result_files import evaluate_detection_files, read_truths
    from tsuiseki.tracking.evaluation.tables import detection_table, evaluation_values
    from tsuiseki.tracking.formats.rotated import is_rotated

    results = compared.named().items()
    if is_rotated(compared.truth) and not any(result.suffix in (".onnx", ".ckpt") for _, result in results):
        if labels.frames is not None:
            raise RequestError("`frames`: rotated boxes are scored by image, all of them; leave it out")
        scores = {name: evaluate_rotated_file(compared.truth, result, iou) for name, result in results}
    else:
        truths = read_truths(compared.truth, labels.range, labels.protocol, labels.size, single=True)
        with tempfile.TemporaryDirectory() as folder:
            exported = {name: _exported(result, Path(folder) / f"{n}.onnx") for n, (name, result) in enumerate(results)}
            scores = {name: evaluate_detection_files(truths, at, iou, score_range) for name, at in exported.items()}
    compared.report(detection_table(scores, iou), evaluation_values(scores))


def _exported(result: Path, out: Path) -> Path:
    """``result``; of a checkpoint the network that ``out`` then holds."""
    if result.suffix != ".ckpt":
        return result
    from tsuiseki.trainers.exporting.export_networks import write_checkpoint

    write_checkpoint(result, out)
    return out


def floor(compared: Comparison, *, distance: PositiveFloat = 1.0) -> None:
    """Score people on a floor: IDF1, MOTA and HOTA by distance, GOSPA; MODA and MODP within 0.5 m.

    Args:
        compared.truth: a folder of WILDTRACK or Shelf or its table of places, or a CSV with time,id,x,y in seconds and
            metres.
        compared.results: world.csv of tsuiseki track floor, or folders with it, scored while they were tracked.
        distance: metres within which a track is on a person, for IDF1, MOTA, HOTA and GOSPA.
    """
    from tsuiseki.tracking.cameras.multicamera import read_placed_truth
    from tsuiseki.tracking.evaluation.on_floor import evaluate_on_floor, while_tracked
    from tsuiseki.tracking.evaluation.tables import FLOOR_COLUMNS, value_table

    labels, scores = read_placed_truth(compared.truth), {}
    for name, path in compared.named().items():
        reported = read_placed_truth(path / "world.csv" if path.is_dir() else path, empty=True)
        scores[name] = evaluate_on_floor(while_tracked(labels, path), reported, distance)
    compared.report(value_table(scores, FLOOR_COLUMNS), scores, {name: score.recall for name, score in scores.items()})


def people(
    compared: PeopleComparison, *, labels: Labels = LABELS, classes: ClassNames | None = None, offset: int = 0
) -> None:
    """Score tracked people against ground truth: HOTA, DetA, AssA, MOTA, MOTP, IDF1, switches, errors.

    With --unlabelled, there is no truth: each score of a result is estimated, with an interval that holds the true one
    in 9 of 10 cases, and the places where people may have been confused are named.

    Args:
        compared.truth: a MOTChallenge gt.txt, a sequence folder, or a folder of sequences; a label file or the
            folder of Okutama-Action, VisDrone-MOT, KITTI tracking or BDD100K; the folder of Drone-Action; CVAT's XML,
            the JSON of COCO with track_id or of Label Studio, a folder of YOLO's rows with ids; the JSON of CEPDOF, of
            whose rotated boxes the upright ones about them are taken, images in the order of their names.
        compared.results: MOTChallenge text files, or folders that hold NAME.txt, data/NAME.txt (as TrackEval's) or
            NAME/tracks.txt for each sequence NAME; a text may have KITTI's rows. For a single sequence also tracks.txt,
            or what tsuiseki convert writes of boxes but for via and geff. Several are compared.
        classes: score these, each apart, by the labels' names or numbers, such as person,car; person is people as
            without this option. Results have classes in column 8: a run's by the names in its run.json, others by the
            labels' numbers.
        offset: frames to add to the numbers of the results, such as 300 for those of a part that counts anew after the
            first 300 frames; may be negative.
    """
    if compared.unlabelled:
        if labels != LABELS or classes is not None or offset:
            raise RequestError("expected --unlabelled with results and --json alone; leave out what is about labels")
        _without_labels(compared)
        return
    from tsuiseki.tracking.evaluation.multi import evaluate_sequences
    from tsuiseki.tracking.evaluation.result_files import match_results, read_truths
    from tsuiseki.tracking.evaluation.tables import evaluation_values, people_table
    from tsuiseki.tracking.report.plots import save_comparison
    from tsuiseki.tracking.types.class_choice import ClassChoice

    scores = {}
    for kind in [None] if classes is None else ClassChoice(classes).plain:
        truths = read_truths(compared.truth, labels.range, labels.protocol, labels.size, kind)
        for name, result in compared.named().items():
            of_class = name if kind is None else f"{name} {kind}"
            scores[of_class] = evaluate_sequences(match_results(truths, result, offset))
    compared.report(people_table(scores), evaluation_values(scores))
    compared.draw(lambda path: save_comparison(scores, path))


def _without_labels(compared: PeopleComparison) -> None:
    from tsuiseki.tracking.evaluation.tables import quality_table, quality_values
    from tsuiseki.tracking.result import Result

    qualities = {name: Result.load(path).quality() for name, path in compared.named().items()}
    compared.report(quality_table(qualities), {name: quality_values(quality) for name, quality in qualities.items()})
    for name, quality in qualities.items():
        for line in (quality.on_doubt(), *(f"not seen: {line}" for line in quality.unseen)):
            print(f"{name}: {line}" if len(qualities) > 1 else line)


def appearance(compared: Comparison) -> None:
    """Score appearance networks: how often a person is recognised among others, and mean average precision.

    Args:
        compared.truth: labelled video with pictures, in a layout that evaluate people takes; or the folder of
            Market-1501, with query and bounding_box_test.
        compared.results: appearance networks as ONNX, or the names of shipped or downloaded ones; several are compared.
    """
    from tsuiseki.tracking.evaluation.reidentification import read_views, score_views
    from tsuiseki.tracking.evaluation.tables import score_table
    from tsuiseki.tracking.features.exported import as_describer

    networks = {n: as_describer(p) for n, p in compared.named().items()}
    views = read_views(compared.truth)
    scores = {name: score_views(views, network) for name, network in networks.items()}
    rows = [[name, *(f"{v:.3f}" for v in (s.rank1, s.rank5, s.rank10, s.mean_average_precision)), str(s.queries)]
             for name, s in scores.items()]  # fmt: skip
    table = score_table(("Network",), ("Rank 1", "Rank 5", "Rank 10", "mAP", "Queries"), [rows])
    compared.report(table, scores)


def points(
    compared: Comparison, *, scored: ScoredFrames = SCORED, cutoff: PositiveFloat = 100.0, window: PositiveInt = 10
) -> None:
    """Score tracked points: OSPA, OSPA(2), GOSPA and its parts, number of targets, changed identities.

    Means are over all frames from the first on; where labels or results begin later, give --frames.

    Args:
        compared.truth: points as CSV with the columns frame,id,x,y, or MOTChallenge text, whose boxes count by their
            centres.
        compared.results: of the same kinds; several are compared.
        cutoff: distance from which a point counts as missed, in the unit of the files.
        window: frames of OSPA(2).
    """
    from tsuiseki.tracking.evaluation.point_distances import evaluate_between, read_points
    from tsuiseki.tracking.evaluation.tables import POINT_COLUMNS, value_table

    labels, scores = read_points(compared.truth, labelled=True), {}
    if not scored.range.mask(labels.frames).any():
        raise RequestError(f"{compared.truth}: expected at least one labelled point in the frames to score, got none")
    for name, path in compared.named().items():
        scores[name] = evaluate_between(labels, read_points(path), scored.range, cutoff, window)
    near = {name: cutoff - score.ospa1 for name, score in scores.items()}
    compared.report(value_table(scores, POINT_COLUMNS), scores, near)


def single(
    compared: PlottedComparison,
    *,
    scored: ScoredFrames = SCORED,
    attributes: Path | None = None,
    by: Literal["sequence", "attribute"] = "sequence",
    of_many: bool = False,
) -> None:
    """Score a tracker of one target: area under the success curve, precision, curves, by sequence and attribute.

    With --of-many, results hold tracks of many, as `track people` and `track drone` write them: say what share of the
    frames a track is on the one labelled person, and how often its identity switches.

    Args:
        compared.truth: a sequence folder (OTB, VOT, UAV123), a folder of them, or a folder of label files NAME.txt.
        compared.results: a folder with NAME.txt, NAME.json or NAME/boxes.txt for each sequence NAME, one file for a
            single sequence, or a folder of tracker_benchmark's score files (ALL.json and others); several are compared.
        attributes: a list like OTB's tb_50.txt, or a folder of tracker_benchmark's score files; only the sequences in
            it are scored.
        scored.frames: with --of-many, score this segment only, counted from 1 with both ends, such as 301-400.
        by: what the rows of the table are.
        of_many: the results hold tracks of many people.
        compared.json: write all scores and curves to this file.
        compared.plot: write the curves to this file (PNG, SVG or PDF).
    """
    from tsuiseki.tracking.evaluation.coverage import cover_targets, coverage_table
    from tsuiseki.tracking.evaluation.multi import MATCH_OVERLAP
    from tsuiseki.tracking.evaluation.success_curves import compare, single_table, single_values
    from tsuiseki.tracking.formats.single import find_single_sequences
    from tsuiseki.tracking.report.plots import curves_figure

    sequences = find_single_sequences(compared.truth, attributes)
    if of_many:
        spans = {
            name: cover_targets(sequences, path, MATCH_OVERLAP, scored.range) for name, path in compared.named().items()
        }
        covered = {name: sum(target.covered for target in targets.values()) for name, targets in spans.items()}
        compared.report(coverage_table(spans), spans, covered)
        return
    curves = {name: compare(sequences, path) for name, path in compared.named().items()}
    compared.report(single_table(curves, by), single_values(curves))
    for name, result in curves.items():
        for sequence, scores in result.sequences.items():
            if scores.note:
                print(f"{name}, {sequence}: {scores.note}", file=sys.stderr)
        if result.missing:
            print(f"{name}: no result for {', '.join(result.missing)}; left out of its means", file=sys.stderr)
    figure = curves_figure({name: r.groups for name, r in curves.items()})
    compared.draw(lambda path: figure.savefig(path, dpi=130, facecolor="white"))


def states(compared: Comparison, *, scored: ScoredFrames = SCORED, distance: PositiveFloat = 20.0) -> None:
    """Score bodies that were followed against their exact states: errors of position and heading, success, identity.

    A body is detected in a frame where a confirmed estimate lies within --distance of it.

    Args:
        compared.truth: states.csv with the columns frame,id, a position a,b or x,y, and for the heading theta or points
            at both ends of the body (head_x,head_y and abdomen_x,abdomen_y); or the folder that holds it.
        compared.results: of the same kind, such as folders of tsuiseki track deformable; several are compared.
        distance: pixels within which a body is detected.
    """
    from tsuiseki.tracking.evaluation.result_files import warn_of_other_frames
    from tsuiseki.tracking.evaluation.states import evaluate_states, read_poses
    from tsuiseki.tracking.evaluation.tables import STATE_COLUMNS, value_table

    truth, *files = (path / "states.csv" if path.is_dir() else path for path in (compared.truth, *compared.results))
    labels, scores = read_poses(truth).within(scored.range), {}
    for name, file in zip(compared.named(), files, strict=True):
        scores[name] = evaluate_states(labels, read_poses(file), distance, scored.range)
        warn_of_other_frames(file, int(labels.frames[0]), int(labels.frames[-1]))
    right = {name: score.success for name, score in scores.items()}
    compared.report(value_table(scores, STATE_COLUMNS), {name: score.values() for name, score in scores.items()}, right)
