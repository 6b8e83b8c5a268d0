"""`tsuiseki evaluate`: results against labels."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.okutama import Protocol
from tsuiseki.tracking.frame_range import parse_frames

USUAL_NAMES = ("tracks.txt", "tracks.json", "det.txt", "gt.txt", "states.csv")


def people(
    truth: Path,
    results: list[Path],
    frames: str | None = None,
    protocol: Protocol = "lenient",
    size: tuple[int, int] | None = None,
    names: list[str] | None = None,
    json: Path | None = None,
    plot: Path | None = None,
    overwrite: bool = False,
) -> None:
    """Score tracked people against ground truth: HOTA, DetA, AssA, MOTA, MOTP, IDF1, switches, errors.

    Args:
        truth: a MOTChallenge gt.txt, a sequence folder, or a folder of sequences; a label file or the
            folder of Okutama-Action or of VisDrone-MOT; the folder of Drone-Action; the JSON of CEPDOF, of whose
            rotated boxes the upright ones about them are taken, images in the order of their names.
        results: MOTChallenge text files, or folders that hold NAME.txt or NAME/tracks.txt for each sequence NAME
            (for a single sequence also tracks.txt); several are compared.
        frames: score this stretch only, counted from 1 with both ends, such as 301-400.
        protocol: for labels like Okutama-Action's. lenient scores all frames, and results on hidden people are neither
            right nor wrong; published, as in the numbers published with the data, leaves out the first frame and all
            labels of hidden people, so that results on them are wrong.
        size: width and height of the frames that were tracked, to which labels of Okutama-Action are scaled, given in
            pixels of 3840x2160; by default those of the frames that lie with the labels, or else 1280,720.
        names: of the results in the table, separated by commas; by default their files' or folders'.
        json: write all scores to this file.
        plot: write a comparison plot to this file (PNG, SVG or PDF).
        overwrite: replace existing files.
    """
    from tsuiseki.tracking.evaluation.multi import evaluate_sequences
    from tsuiseki.tracking.evaluation.pairs import match_results
    from tsuiseki.tracking.evaluation.table import people_table, people_values, show
    from tsuiseki.tracking.evaluation.truths import read_truths
    from tsuiseki.tracking.output import check_output_file, output_file
    from tsuiseki.tracking.report.plots import save_comparison

    shown = _result_names(results, names)
    for path in (json, plot):
        if path is not None:
            check_output_file(path, overwrite)
    _check_plot(plot)
    _check_size(size)
    truths = read_truths(truth, parse_frames(frames), protocol, size)
    scores = {
        name: evaluate_sequences(match_results(truths, result)) for name, result in zip(shown, results, strict=True)
    }
    show(people_table(scores))
    if json is not None:
        _write_json(json, people_values(scores), overwrite)
    if plot is not None:
        with output_file(plot, overwrite) as work:
            save_comparison(scores, work)


def detection(
    truth: Path,
    results: list[Path],
    frames: str | None = None,
    protocol: Protocol = "lenient",
    size: tuple[int, int] | None = None,
    iou: float = 0.5,
    score_range: tuple[float, float] = (0.0, 1.0),
    json: Path | None = None,
    overwrite: bool = False,
) -> None:
    """Score detections against ground truth: average precision, and the threshold of the best F1.

    Args:
        truth: a MOTChallenge gt.txt, a sequence folder, or a folder of sequences; a label file or the
            folder of Okutama-Action or of VisDrone-MOT; the folder of Drone-Action; or rotated boxes: the JSON of
            CEPDOF or MW-R, or a folder of HABBOF's text files.
        results: MOTChallenge detection files (det.txt), or folders that hold NAME.txt, NAME/det/det.txt or
            NAME/detections.txt for each sequence NAME; for rotated boxes a JSON list of image_id, bbox (cx, cy, w, h,
            degrees clockwise) and score, which is scored by the overlap of the turned boxes.
        frames: score this stretch only, counted from 1 with both ends, such as 301-400.
        protocol: for labels like Okutama-Action's. lenient scores all frames, and results on hidden people are neither
            right nor wrong; published, as in the numbers published with the data, leaves out the first frame and all
            labels of hidden people, so that results on them are wrong.
        size: width and height of the frames that were tracked, to which labels of Okutama-Action are scaled, given in
            pixels of 3840x2160; by default those of the frames that lie with the labels, or else 1280,720.
        iou: overlap from which a detection is right.
        score_range: smallest and largest score that the detections may have.
        json: write the scores to this file, with recall and precision at every detection.
        overwrite: replace existing files.
    """
    from tsuiseki.tracking.evaluation.pairs import evaluate_detection_files
    from tsuiseki.tracking.evaluation.rotated import evaluate_rotated_file
    from tsuiseki.tracking.evaluation.table import detection_table, detection_values, show
    from tsuiseki.tracking.evaluation.truths import read_truths
    from tsuiseki.tracking.formats.rotated import is_rotated
    from tsuiseki.tracking.output import check_output_file

    if not 0 < iou <= 1:
        raise RequestError(f"--iou: expected an overlap above 0 and up to 1, got {iou:g}")
    if json is not None:
        check_output_file(json, overwrite)
    _check_size(size)
    shown = zip(_result_names(results, None), results, strict=True)
    if is_rotated(truth):
        if frames is not None:
            raise RequestError("--frames: rotated boxes are scored by image, all of them; leave it out")
        scores = {name: evaluate_rotated_file(truth, result, iou) for name, result in shown}
    else:
        truths = read_truths(truth, parse_frames(frames), protocol, size)
        scores = {name: evaluate_detection_files(truths, result, iou, score_range) for name, result in shown}
    show(detection_table(scores, iou))
    if json is not None:
        _write_json(json, detection_values(scores), overwrite)


def action(
    truth: Path,
    results: list[Path],
    threshold: float = 0.4,
    frames: str | None = None,
    protocol: Protocol = "lenient",
    size: tuple[int, int] | None = None,
    multiple_actions: bool = False,
    names: list[str] | None = None,
    json: Path | None = None,
    overwrite: bool = False,
) -> None:
    """Score what people were said to do: F1 at a threshold, and average precision, for every action.

    A row is a labelled person in a frame, or a tracked box on nobody. An action is called where its probability is
    above the threshold; F1 = 2 TP / (2 TP + FP + FN) over all rows. "single" are the probabilities of single frames,
    "multi" those averaged over the window along the track. With tracks given to `track drone --tracks`, only
    recognition is scored; with tracks of its own, misses and false tracks count, too.

    Args:
        truth: a MOTChallenge sequence folder with gt/actions.txt (Okutama-Action's rows), or a folder of such; a label
            file or the folder of Okutama-Action; the folder of Drone-Action.
        results: tracks.json of tsuiseki track drone, or folders that hold NAME/tracks.json for each clip NAME (for a
            single clip also tracks.json); several are compared.
        threshold: an action is called where its probability is above, from 0 to 1.
        frames: score this stretch only, counted from 1 with both ends, such as 301-400.
        protocol: for labels like Okutama-Action's. lenient scores all frames, and results on hidden people are neither
            right nor wrong; published, as in the numbers published with the data, leaves out the first frame and all
            labels of hidden people, so that results on them are wrong.
        size: width and height of the frames that were tracked, to which labels of Okutama-Action are scaled, given in
            pixels of 3840x2160; by default those of the frames that lie with the labels, or else 1280,720.
        multiple_actions: in the folder of Okutama-Action, score against MultiActionLabels, which have all actions of
            a person, instead of SingleActionTrackingLabels, which have one.
        names: of the results in the table, separated by commas; by default their files' or folders'.
        json: write all scores to this file.
        overwrite: replace an existing file.
    """
    from tsuiseki.tracking.evaluation.action.action import evaluate_actions
    from tsuiseki.tracking.evaluation.action.action_pairs import match_actions, read_labelled_actions
    from tsuiseki.tracking.evaluation.action.action_table import action_table, action_values
    from tsuiseki.tracking.evaluation.table import show
    from tsuiseki.tracking.output import check_output_file

    if not 0 <= threshold <= 1:
        raise RequestError(f"--threshold: expected a number from 0 to 1, got {threshold:g}")
    shown = _result_names(results, names)
    if json is not None:
        check_output_file(json, overwrite)
    _check_size(size)
    truths = read_labelled_actions(truth, protocol, size, multiple_actions, parse_frames(frames))
    scores = {}
    for name, result in zip(shown, results, strict=True):
        rows = match_actions(truths, result)
        for kind in ("single", "multi"):
            values = getattr(rows, kind)
            scores[f"{name} {kind}"] = evaluate_actions(truths[0].names, values, rows.truth, threshold)
    show(action_table(scores))
    if json is not None:
        _write_json(json, action_values(scores), overwrite)


def states(
    truth: Path,
    results: list[Path],
    distance: float = 20.0,
    frames: str | None = None,
    names: list[str] | None = None,
    json: Path | None = None,
    overwrite: bool = False,
) -> None:
    """Score bodies that were followed against their exact states: errors of position and heading, success, identity.

    A body is found in a frame where an estimate that its tracker believes lies within --distance of it.

    Args:
        truth: states.csv with the columns frame,id, a position a,b or x,y, and for the heading theta or points at both
            ends of the body (head_x,head_y and abdomen_x,abdomen_y); or the folder that holds it.
        results: of the same kind, such as folders of tsuiseki track deformable; several are compared.
        distance: pixels within which a body is found.
        frames: score this stretch only, counted from 1 with both ends, such as 301-400.
        names: of the results in the table, separated by commas; by default their files' or folders'.
        json: write all scores to this file.
        overwrite: replace an existing file.
    """
    from tsuiseki.tracking.evaluation.state_table import state_table
    from tsuiseki.tracking.evaluation.states import evaluate_states, read_poses
    from tsuiseki.tracking.evaluation.stretch import warn_of_other_frames
    from tsuiseki.tracking.evaluation.table import show
    from tsuiseki.tracking.output import check_output_file

    if not distance > 0:
        raise RequestError(f"`distance`: expected pixels above 0, got {distance:g}")
    shown, stretch = _result_names(results, names), parse_frames(frames)
    if json is not None:
        check_output_file(json, overwrite)
    labels, scores = read_poses(_states_file(truth)).within(stretch), {}
    for name, result in zip(shown, map(_states_file, results), strict=True):
        scores[name] = evaluate_states(labels, read_poses(result), distance, stretch)
        warn_of_other_frames(result, int(labels.frames[0]), int(labels.frames[-1]))
    show(state_table(scores))
    if json is not None:
        _write_json(json, {name: one.values() for name, one in scores.items()}, overwrite)


def _states_file(path: Path) -> Path:
    return path / "states.csv" if path.is_dir() else path


def _result_names(results: list[Path], names: list[str] | None) -> list[str]:
    """One name a result, as short as tells them apart."""
    if names is not None:
        if len(names) != len(results) or len(set(names)) != len(names):
            raise RequestError(f"--names: expected {len(results)} different names, one a result, got {','.join(names)}")
        return names
    parts = [_telling_parts(path.resolve()) for path in results]
    if len(set(parts)) != len(parts):
        raise RequestError("expected different results to compare, got one twice")
    depths = range(1, max(map(len, parts)) + 1)
    candidates = (["/".join(path[-depth:]) for path in parts] for depth in depths)
    return next(shown for shown in candidates if len(set(shown)) == len(shown))


def _telling_parts(path: Path) -> tuple[str, ...]:
    """The parts of ``path`` without what all results are called."""
    if path.is_file():
        path = path.parent if path.name in USUAL_NAMES else path.with_suffix("")
    return path.parts


def _check_size(size: tuple[int, int] | None) -> None:
    if size is not None and min(size) < 1:
        raise RequestError(f"--size: expected a width and height from 1 pixel on, got {size[0]},{size[1]}")


def _check_plot(plot: Path | None) -> None:
    if plot is not None and plot.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise RequestError(f"--plot: expected a file name ending in .png, .svg or .pdf, got {plot}")


def _write_json(path: Path, values: dict[str, Any], overwrite: bool) -> None:
    from tsuiseki.tracking.output import output_file

    with output_file(path, overwrite) as work:
        work.write_text(_json_text(values), encoding="utf-8")


def _json_text(values: dict[str, Any]) -> str:
    return json.dumps(values, indent=1) + "\n"
