"""`tsuiseki evaluate detection`."""

from __future__ import annotations

from tsuiseki.tracking.cli.evaluate.options import Comparison, Labels


def detection(
    given: Comparison, labels: Labels, iou: float = 0.5, score_range: tuple[float, float] = (0.0, 1.0)
) -> None:
    """Score detections against ground truth: average precision, and the threshold of the best F1.

    Args:
        truth: a MOTChallenge gt.txt, a sequence folder, or a folder of sequences; a label file or the
            folder of Okutama-Action, VisDrone-MOT or KITTI tracking; the folder of Drone-Action; or rotated boxes: the
            JSON of CEPDOF or MW-R, or a folder of HABBOF's text files.
        results: MOTChallenge detection files (det.txt), or folders that hold NAME.txt, NAME/det/det.txt or
            NAME/detections.txt for each sequence NAME; for rotated boxes a JSON list of image_id, bbox (cx, cy, w, h,
            degrees clockwise) and score, which is scored by the overlap of the turned boxes.
        iou: overlap from which a detection is right.
        score_range: smallest and largest score that the detections may have.
        json: write the scores to this file, with recall and precision at every detection.
    """
    from tsuiseki.tracking.errors import RequestError
    from tsuiseki.tracking.evaluation.pairs import evaluate_detection_files
    from tsuiseki.tracking.evaluation.rotated import evaluate_rotated_file
    from tsuiseki.tracking.evaluation.table import detection_table, detection_values
    from tsuiseki.tracking.evaluation.truths import read_truths
    from tsuiseki.tracking.formats.space.rotated import is_rotated

    if not 0 < iou <= 1:
        raise RequestError(f"`iou`: expected an overlap above 0 and up to 1, got {iou:g}")
    shown = given.named().items()
    if is_rotated(given.truth):
        if labels.frames is not None:
            raise RequestError("`frames`: rotated boxes are scored by image, all of them; leave it out")
        scores = {name: evaluate_rotated_file(given.truth, result, iou) for name, result in shown}
    else:
        truths = read_truths(given.truth, labels.range, labels.protocol, labels.size)
        scores = {name: evaluate_detection_files(truths, result, iou, score_range) for name, result in shown}
    given.report(detection_table(scores, iou), detection_values(scores))
