"""How well a detector finds people: average precision, precision and recall by the height of the person.

    python -m benchmarks.detectors.accuracy --data ../shared/data [--detector FILE] [--view auto] [--only NAME ...]
        [--ground]

Real sequences that trained no shipped detector: PETS09-S2L1 (frames 1-300 and 301-400), four stills of MOT17-02, the
video of MOT17-13, and generated streets of other seeds than those of training (`--streets 0` leaves them out). TUD has
no pictures here. Average precision is over all scores from 0.02 on, `rec.8` is the recall where precision is still 0.8,
whatever the score; precision and recall hold at `--score-threshold`. With `--ground` scores go by people's heights on
one ground, as they are known from the pictures before; each generated street is a place of its own.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings
from tsuiseki.tracking.evaluation.detection import LabelledBoxes, evaluate_detections, labelled_boxes
from tsuiseki.tracking.features.exported import open_detector
from tsuiseki.tracking.features.foreign_options import DetectorOptions
from tsuiseki.tracking.features.ground_plane import GroundPlane
from tsuiseki.tracking.features.tiles import parse_view
from tsuiseki.tracking.features.view_choice import ViewedDetector
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.source import open_source
from tsuiseki.tracking.weights import PEOPLE_DETECTOR, shipped

LOWEST_SCORE = 0.02
FIRM = 0.8
STREET = 100
HEIGHTS = (0, 30, 45, 60, 90, 150, 10_000)


@dataclass(frozen=True)
class Sequence:
    """Labelled pictures.

    Attributes:
        name: for the table.
        pictures: each an image with its labels.
        rate: pictures a second.
        length: pictures of one place, after which the next begins; None where all are of one.
    """

    name: str
    pictures: Callable[[], Iterator[tuple[ImageArray, LabelledBoxes]]]
    rate: float
    length: int | None = None


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--detector", default=str(shipped(PEOPLE_DETECTOR)))
    parser.add_argument("--person", type=int, help="class of people, where a detector of others does not tell")
    parser.add_argument("--view", default="auto")
    parser.add_argument("--score-threshold", type=float, default=0.3)
    parser.add_argument("--streets", type=int, default=3)
    parser.add_argument("--every", type=int, default=1, help="look at every n-th frame only")
    parser.add_argument("--ground", action="store_true", help="let scores go by people's heights on one ground")
    parser.add_argument("--only", nargs="*", default=[])
    arguments = parser.parse_args()
    bins = " ".join(f"{a:>4}-{b if b < 9999 else '':<4}" for a, b in itertools.pairwise(HEIGHTS))
    print(f"{'sequence':22} frames   AP.3   AP.5  AP.75  rec.8   prec    rec  tiles  ms CPU  recall by height: {bins}")
    for sequence in sequences(arguments.data, arguments.streets, arguments.every):
        if not arguments.only or any(word in sequence.name for word in arguments.only):
            print(
                row(
                    sequence,
                    arguments.detector,
                    arguments.view,
                    arguments.score_threshold,
                    arguments.ground,
                    None if arguments.person is None else DetectorOptions(person=arguments.person),
                ),
                flush=True,
            )


def sequences(data: Path, streets: int, every: int) -> Iterator[Sequence]:
    """Those that are at hand."""
    mot = data / "mot"
    real = (
        ("PETS 1-300", mot / "PETS09-S2L1-first", mot / "PETS09-S2L1-first", 0, 299, every),
        ("PETS 301-400", mot / "PETS09-S2L1-first", mot / "PETS09-S2L1-first", 300, 399, every),
        ("MOT17-02 stills", mot / "mot17-02-stills", mot / "mot17-02-stills", 0, 3, 1),
        ("MOT17-13 video", video_in(mot / "mot17-13-video"), mot / "mot17-13-video", 0, 749, 15 * every),
    )
    for name, source, labels, first, last, step in real:
        rate = open_source(source).frame_rate / step
        yield Sequence(name, lambda s=source, t=labels, a=first, b=last, n=step: labelled(s, t, a, b, n), rate)  # type: ignore[misc]
    if streets:
        step = 10 * every
        rate, length = StreetSettings().frame_rate / step, len(range(0, STREET, step))
        yield Sequence(f"{streets} generated streets", lambda: generated(streets, step), rate, length)


def video_in(folder: Path) -> Path:
    """The video file in ``folder``."""
    return next(p for p in sorted(folder.iterdir()) if p.suffix in (".h265", ".hevc", ".265", ".mp4", ".webm"))


def labelled(
    source: Path, labels: Path, first: int, last: int, step: int
) -> Iterator[tuple[ImageArray, LabelledBoxes]]:
    """Every ``step``-th frame with its labels."""
    truth = read_ground_truth(labels / "gt" / "gt.txt")
    for frame in open_source(source, FrameRange(first, last)).frames():
        if (frame.index - first) % step == 0:
            yield frame.image, labelled_boxes(truth, [frame.index])[0]


def generated(streets: int, step: int) -> Iterator[tuple[ImageArray, LabelledBoxes]]:
    """Frames of streets that no training used."""
    for seed in range(streets):
        street = StreetClip(StreetSettings(frames=STREET), 7100 + seed)
        for number in range(0, STREET, step):
            (image,), truth = street.draw_frame(number)
            yield image, LabelledBoxes(truth.boxes, truth.visibility < 0.25)


def row(
    sequence: Sequence,
    path: str,
    view: str,
    threshold: float,
    ground: bool,
    options: DetectorOptions | None = None,
) -> str:
    """One line of the table."""
    detector = open_detector(path, LOWEST_SCORE, threads=1, options=options)
    pictures = list(sequence.pictures())
    tiled = ViewedDetector(detector, parse_view(view))
    chosen = tiled.prepare([image for image, _ in pictures[:3]]).view
    start = time.process_time()
    found = [tiled.detect([image])[0] for image, _ in pictures]
    cost = 1000 * (time.process_time() - start) / len(pictures)
    if ground:
        found = list(on_one_ground(found, [len(image) for image, _ in pictures], sequence))
    truth = [labels for _, labels in pictures]
    curves = [evaluate_detections(truth, found, iou) for iou in (0.3, 0.5, 0.75)]
    precisions = [curve.average_precision for curve in curves]
    firm = curves[1].recall[curves[1].precision >= FIRM].max(initial=0.0)
    kept = [Detections(d.boxes[d.scores >= threshold], d.scores[d.scores >= threshold]) for d in found]
    scores = evaluate_detections(truth, kept)
    last = (scores.precision[-1], scores.recall[-1]) if len(scores.recall) else (0.0, 0.0)
    heights = "  ".join(f"{hit:.2f}/{count:<4}" for hit, count in recall_by_height(truth, kept))
    numbers = " ".join(f"{value:6.3f}" for value in (*precisions, firm, *last))
    return f"{sequence.name:22} {len(pictures):6} {numbers} {len(chosen):6} {cost:7.1f}  {heights}"


def on_one_ground(found: list[Detections], heights: list[int], sequence: Sequence) -> Iterator[Detections]:
    """Detections ``found`` in pictures of these heights, with scores by what was learnt of each place before."""
    for number, (one, height) in enumerate(zip(found, heights, strict=True)):
        if number % (sequence.length or len(found)) == 0:
            ground = GroundPlane(sequence.rate)
        yield ground.weighed(one, height)


def recall_by_height(truth: list[LabelledBoxes], found: list[Detections]) -> Iterator[tuple[float, int]]:
    """Recall and number of the people of each height, everybody else ignored."""
    for low, high in itertools.pairwise(HEIGHTS):
        within = [_only(labels, low, high) for labels in truth]
        count = sum(int((~labels.ignored).sum()) for labels in within)
        if count == 0:
            yield 0.0, 0
            continue
        recall: FloatArray = evaluate_detections(within, found).recall
        yield (float(recall[-1]) if len(recall) else 0.0), count


def _only(labels: LabelledBoxes, low: float, high: float) -> LabelledBoxes:
    height = labels.boxes[:, 3] - labels.boxes[:, 1]
    return LabelledBoxes(labels.boxes, labels.ignored | (height < low) | (height >= high))


if __name__ == "__main__":
    np.seterr(all="raise", under="ignore")
    main()
