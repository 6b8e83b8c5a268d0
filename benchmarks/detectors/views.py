"""Small people in large frames: what tiles find, by the height of the person, and which rule chooses them best.

    python -m benchmarks.detectors.views [--data ../shared/data] [--detector FILE] [--only NAME ...]

Pictures: generated streets in HD (1920x1080) and 4K (3840x2160) seen from 5 to 15 m, with people of 24 to 200 pixels,
of two ranges of seeds; the two halves of MOT17-13's video, also shrunk to 640 and 826 pixels across; the stills of
MOT17-02. Rules were chosen on the first range and the first half. A detector looks at each picture with every number of
tiles across up to those that show a pixel of the picture as 1.7 of the input, and with more where `auto` tries them
(elsewhere such a row takes the most that were tried). Then each rule says which number it would have taken from what
was found, without a label, and the labels say what that would have brought; all but `auto` choose among the former.
Precision and recall hold at score 0.3.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from benchmarks.detectors.accuracy import LOWEST_SCORE, labelled, recall_by_height, video_in
from tsuiseki.datamodules.scenes.training_pictures import random_training_scene
from tsuiseki.datamodules.scenes.training_settings import TrainingSettings
from tsuiseki.tracking.evaluation.detection import LabelledBoxes, evaluate_detections
from tsuiseki.tracking.features.exported import open_detector
from tsuiseki.tracking.features.tiles import LARGEST_SCALE, TiledDetector, view_of
from tsuiseki.tracking.features.view_choice import ENLARGED_SCALE, WORTH, most_columns, worth_more
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.preprocessing import stretched
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray
from tsuiseki.tracking.weights import PEOPLE_DETECTOR, shipped

CERTAIN = 0.3
HD, UHD = (1920, 1080), (3840, 2160)
Found: TypeAlias = Mapping[int, Detections]


@dataclass(frozen=True)
class Tried:
    """A picture and its detections.

    Attributes:
        truth: who is there.
        found: by the number of tiles across.
        tiles: of each number.
        milliseconds: of CPU time that each took.
        scales: input pixels for a pixel of the picture, of each number.
    """

    truth: LabelledBoxes
    found: Found
    tiles: Mapping[int, int]
    milliseconds: Mapping[int, float]
    scales: Mapping[int, float]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--detector", default=str(shipped(PEOPLE_DETECTOR)))
    parser.add_argument("--only", nargs="*", default=[])
    arguments = parser.parse_args()
    for name, pictures in sets(arguments.data):
        if not arguments.only or any(word in name for word in arguments.only):
            tried = [try_tiles(image, truth, arguments.detector) for image, truth in pictures()]
            print(f"\n{name}, {len(tried)} pictures")
            print("                           AP.5   prec    rec  tiles   ms CPU  recall by height")
            for columns in sorted({c for each in tried for c in each.found}):
                print(row(f"{columns} across", tried, [min(columns, max(each.found)) for each in tried]))
            for rule, chosen in rules().items():
                print(row(rule, tried, [chosen(each) for each in tried]))
            print(row("best by its labels", tried, [best(each) for each in tried]), flush=True)


def sets(data: Path) -> Iterator[tuple[str, Callable[[], Iterator[tuple[ImageArray, LabelledBoxes]]]]]:
    """Names, and pictures with labels."""
    for name, size, count in (("HD", HD, 10), ("4K", UHD, 6)):
        for use, first in (("chosen on", 7200), ("judged on", 7300)):
            yield f"{name}, {use}", lambda size=size, first=first, count=count: generated(size, first, count)  # type: ignore[misc]
    moving = data / "mot" / "mot17-13-video"
    if moving.is_dir():
        for use, first in (("chosen on", 0), ("judged on", 375)):
            yield f"MOT17-13, {use}", lambda first=first: half_of(moving, first)  # type: ignore[misc]
            for wide in (640, 826):
                yield (
                    f"MOT17-13 in {wide}, {use}",
                    lambda first=first, wide=wide: shrunk(half_of(moving, first), wide),  # type: ignore[misc]
                )
        stills = data / "mot" / "mot17-02-stills"
        yield "MOT17-02, judged on", lambda: labelled(stills, stills, 0, 3, 1)


def generated(size: tuple[int, int], first: int, count: int) -> Iterator[tuple[ImageArray, LabelledBoxes]]:
    """Pictures of places that no training used."""
    small = TrainingSettings(size, (8, 40), (24.0, 200.0), (8, 30), (5.0, 15.0), samples=1, beside=0.4, night=0.2)
    for seed in range(first, first + count):
        image, boxes, visibility = random_training_scene(np.random.default_rng(seed), small)
        yield image, LabelledBoxes(boxes, visibility < 0.25)


def half_of(moving: Path, first: int) -> Iterator[tuple[ImageArray, LabelledBoxes]]:
    """Every thirtieth of 375 frames."""
    return labelled(video_in(moving), moving, first, first + 374, 30)


def shrunk(
    pictures: Iterator[tuple[ImageArray, LabelledBoxes]], width: int
) -> Iterator[tuple[ImageArray, LabelledBoxes]]:
    """The pictures as a camera of ``width`` pixels across would have seen them."""
    for image, truth in pictures:
        scale = width / image.shape[1]
        small, _ = stretched(image, round(image.shape[0] * scale), width)
        yield small, LabelledBoxes(truth.boxes * scale, truth.ignored)


def try_tiles(image: ImageArray, truth: LabelledBoxes, path: str) -> Tried:
    """Find people with every number of tiles across up to `LARGEST_SCALE`, and with more where `auto` tries them."""
    detector = open_detector(path, LOWEST_SCORE, threads=1)
    size = image.shape[:2]
    assert detector.input_size is not None
    high, wide = detector.input_size
    found: dict[int, Detections] = {}
    tiles: dict[int, int] = {}
    cost: dict[int, float] = {}
    scales: dict[int, float] = {}
    usual, most = (most_columns(size, detector.input_size, scale) for scale in (LARGEST_SCALE, ENLARGED_SCALE))
    for columns in range(1, most + 1):
        if columns > usual and auto(Tried(truth, found, tiles, cost, scales)) < columns - 1:
            break
        view = view_of((size[0], size[1]), columns, wide / high)
        start = time.process_time()
        found[columns] = TiledDetector(detector, view).detect([image])[0]
        cost[columns] = 1000 * (time.process_time() - start)
        x1, y1, x2, y2 = view.tiles[-1].tolist()
        tiles[columns], scales[columns] = len(view), min(wide / (x2 - x1), high / (y2 - y1))
    return Tried(truth, found, tiles, cost, scales)


def rules() -> dict[str, Callable[[Tried], int]]:
    """Ways of choosing, by name."""
    return {
        "auto": auto,
        **{f"grows by {n:g}": lambda each, n=n: grows(each, n) for n in (WORTH, 1.25)},  # type: ignore[misc]
        **{f"smallest at {n} pixels": lambda each, n=n: smallest(each, n) for n in (25, 35, 50)},  # type: ignore[misc]
        **{f"{s:g} of those confirmed": lambda each, s=s: confirmed(each, s) for s in (0.7, 0.8, 0.9)},  # type: ignore[misc]
        "all that show more": lambda each: max(not_enlarged(each).found),
    }


def auto(each: Tried) -> int:
    """As `tsuiseki.tracking.features.view_choice` does, of this picture alone."""
    return _grown(each, lambda people, more, columns: worth_more(people, more, each.scales[columns] > LARGEST_SCALE))


def grows(each: Tried, worth: float) -> int:
    """One more tile across as long as the sum of the scores grows by the factor ``worth``, up to `LARGEST_SCALE`."""
    return _grown(each, lambda people, more, columns: more > worth * people and each.scales[columns] <= LARGEST_SCALE)


def _grown(each: Tried, worth: Callable[[float, float, int], bool]) -> int:
    chosen = 1
    for columns in range(2, max(each.found) + 1):
        people = _expected(each.found[chosen])
        if worth(people, _expected(each.found[columns]), columns):
            chosen = columns
        elif people >= 0.5:
            break
    return chosen


def not_enlarged(each: Tried) -> Tried:
    """The picture without tiles that show it larger than at `LARGEST_SCALE`."""
    return replace(
        each, found={c: found for c, found in each.found.items() if c == 1 or each.scales[c] <= LARGEST_SCALE}
    )


def smallest(each: Tried, pixels: float) -> int:
    """The fewest tiles that show nine tenths of those detected at two numbers with ``pixels`` of the input."""
    each = not_enlarged(each)
    heights = [_heights(_twice(each.found, columns)) for columns in each.found]
    every = max(heights, key=len)
    if not len(every):
        return 1
    low = float(np.quantile(every, 0.1))
    return next((c for c, scale in each.scales.items() if low * scale >= pixels), max(each.found))


def confirmed(each: Tried, share: float) -> int:
    """The fewest tiles with a ``share`` of the most people that are detected at two neighbouring numbers of tiles."""
    each = not_enlarged(each)
    counts = {columns: _expected(_twice(each.found, columns)) for columns in each.found}
    return next(columns for columns, count in counts.items() if count >= share * max(counts.values()))


def best(each: Tried) -> int:
    """By the labels: the most right boxes less the most false ones."""

    def harmony(columns: int) -> float:
        precision, recall = rates([each], [columns])
        return 2 * precision * recall / max(precision + recall, 1e-9)

    return max(not_enlarged(each).found, key=harmony)


def _twice(found: Found, columns: int) -> Detections:
    """What is detected with one tile across more or fewer, too."""
    here = certain(found[columns])
    again = np.zeros(len(here), dtype=bool)
    for other in (columns - 1, columns + 1):
        if other in found:
            there = certain(found[other])
            again |= (iou_matrix(here.boxes, there.boxes) >= 0.5).any(axis=1)
    return here.select(again)


def certain(found: Detections) -> Detections:
    """What scores `CERTAIN` or more."""
    return found.select(found.scores >= CERTAIN)


def _expected(found: Detections) -> float:
    return float(certain(found).scores.sum())


def _heights(found: Detections) -> FloatArray:
    heights: FloatArray = found.boxes[:, 3] - found.boxes[:, 1]
    return heights


def rates(tried: Sequence[Tried], columns: Sequence[int]) -> tuple[float, float]:
    """Precision and recall with these numbers of tiles."""
    kept = [certain(each.found[c]) for each, c in zip(tried, columns, strict=True)]
    scores = evaluate_detections([each.truth for each in tried], kept)
    return (float(scores.precision[-1]), float(scores.recall[-1])) if len(scores.recall) else (0.0, 0.0)


def row(name: str, tried: Sequence[Tried], columns: Sequence[int]) -> str:
    """One line of the table."""
    truth = [each.truth for each in tried]
    pairs = list(zip(tried, columns, strict=True))
    average = evaluate_detections(truth, [each.found[c] for each, c in pairs]).average_precision
    precision, recall = rates(tried, columns)
    tiles = np.mean([each.tiles[c] for each, c in pairs])
    cost = np.mean([each.milliseconds[c] for each, c in pairs])
    heights = "  ".join(
        f"{low}-{'' if high > 9999 else high}: {hit:.2f}/{count}"
        for (low, high), (hit, count) in zip(
            itertools.pairwise((0, 30, 45, 60, 90, 150, 10_000)),
            recall_by_height(truth, [certain(each.found[c]) for each, c in pairs]),
            strict=True,
        )
        if count
    )
    return f"{name:24} {average:6.3f} {precision:6.3f} {recall:6.3f} {tiles:6.1f} {cost:8.0f}  {heights}"


if __name__ == "__main__":
    main()
