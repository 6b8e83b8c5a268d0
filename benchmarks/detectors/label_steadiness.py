"""How much labelled boxes swing with the legs: what a detector's boxes are compared with.

    python -m benchmarks.detectors.label_steadiness --data ../shared/data

A silhouette's box is wide where legs are apart and narrow where they meet, twice a second and more. For every labelled
person taller than `SMALLEST` pixels whose track lasts two seconds or more: the standard deviation of the logarithm of
width by height about its mean over a second. Printed is the median over the people of a sequence, with their mean width
by height. Generated streets are labelled by their silhouettes.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.formats.mot_sequence import MotSequence, read_sequence
from tsuiseki.tracking.types import FloatArray, IntArray

SMALLEST = 40.0
STREETS, FRAMES = 3, 100

# Of a track: frame numbers (N,) and boxes (N, 4).
Track = tuple[IntArray, FloatArray]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    folder = parser.parse_args().data / "mot"
    paths = [folder / name for name in ("PETS09-S2L1-first", "TUD-Campus", "TUD-Stadtmitte")]
    paths += sorted([*(folder / "mot17-val-half").iterdir(), *(folder / "mot15").iterdir()])
    for path in [*paths, folder / "kitti" / "Pedestrian" / "0016"]:
        sequence = read_sequence(path)
        report(path.name, sequence.frame_rate, labelled_tracks(sequence))
    for seed in range(STREETS):
        report(f"generated street {seed + 1}", StreetSettings().frame_rate, street_tracks(7100 + seed))


def labelled_tracks(sequence: MotSequence) -> Iterator[Track]:
    """The people who count."""
    truth = read_ground_truth(sequence.ground_truth_path)
    count = truth.evaluated
    return by_person(truth.ids[count], truth.frames[count], truth.boxes[count])


def street_tracks(seed: int) -> Iterator[Track]:
    """The people of a generated street, every frame."""
    street = StreetClip(StreetSettings(frames=FRAMES), seed)
    drawn = [street.draw_frame(number)[1] for number in range(FRAMES)]
    ids, boxes = np.concatenate([s.ids for s in drawn]), np.concatenate([s.boxes for s in drawn])
    frames = np.repeat(np.arange(FRAMES), [len(s.ids) for s in drawn])
    return by_person(ids, frames, boxes)


def by_person(ids: IntArray, frames: IntArray, boxes: FloatArray) -> Iterator[Track]:
    """The track of each id, in the order of its frames."""
    for number in np.unique(ids):
        at = np.flatnonzero(ids == number)
        at = at[np.argsort(frames[at])]
        yield frames[at], boxes[at]


def report(name: str, rate: float, tracks: Iterator[Track]) -> None:
    """Print the line of one sequence."""
    window = max(round(rate), 3) | 1
    swings, shapes = [], []
    for frames, boxes in tracks:
        sides = boxes[:, 2:] - boxes[:, :2]
        if len(frames) < 2 * window or (np.diff(frames) > 1).any() or sides[:, 1].mean() < SMALLEST:
            continue
        shape = np.log(sides[:, 0] / sides[:, 1])
        about = shape[window // 2 : -(window // 2)] - np.convolve(shape, np.ones(window) / window, "valid")
        swings.append(about.std())
        shapes.append(np.exp(shape.mean()))
    if swings:
        print(f"{name:22} {len(swings):3} people, swing {np.median(swings):.3f}, width by height {np.mean(shapes):.2f}")
    else:
        print(f"{name:22} no person long and large enough")


if __name__ == "__main__":
    main()
