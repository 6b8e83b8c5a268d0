"""How well people of a gallery are recognised, and whether the probabilities are right.

    python -m benchmarks.association.gallery --people out/cache/gallery-people.npz --data ../shared/data

Generated places: twenty people, whom the network never saw, on two days, six pictures a day, before the same camera or
another. Labelled video: of each track of PETS and MOT17-13 the first half is in the gallery, the second is recognised.
Of the people in view some are left out of the gallery. The settings of `recognition` were chosen on places 0 to 29.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tsuiseki.datamodules.appearance import CropCamera, augment_crop, draw_camera
from tsuiseki.datamodules.identity_crops import IdentityCrops, read_crops, render_people, write_crops
from tsuiseki.tracking.features.exported import Appearance, as_describer
from tsuiseki.tracking.features.recognition import centred, recognise
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.tracking.video.source import open_source

# Height and width of crops, pixels.
SIZE = (128, 64)
PEOPLE, PICTURES, PLACES = 20, 6, 30
# The first of the places that are reported.
REPORTED = 1030
# Shares of the people in view who are not in the gallery.
STRANGERS = (0.05, 0.5)
# Boxes that half of a labelled track has at least.
SHORTEST = 20
# Draws of who is left out, of one labelled video.
DRAWS = 20
BINS = 10
# Rows of the people on a first and a second day, and who is in view together on the second.
Place: TypeAlias = tuple[FloatArray, FloatArray, BoolArray]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", type=Path, default=Path("out/cache/gallery-people.npz"))
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    words = parser.parse_args()
    if not words.people.exists():
        words.people.parent.mkdir(parents=True, exist_ok=True)
        write_crops(words.people, render_people(66, 400, 2 * PICTURES))
    describer = as_describer("people")
    assert isinstance(describer, Appearance)
    crops = read_crops(words.people)
    sets = {
        f"generated, {'the same' if same else 'another'} camera": [
            generated(describer, crops, REPORTED + n, same) for n in range(PLACES)
        ]
        for same in (True, False)
    }
    mot = words.data / "mot"
    video = mot / "mot17-13-video"
    sets["PETS 1-400"] = [halves(describer, mot / "PETS09-S2L1-first", mot / "PETS09-S2L1-first")] * DRAWS
    sets["MOT17-13"] = [halves(describer, next(video.glob("*.h265")), video)] * DRAWS
    print("| set | strangers | rank 1 | right | calibration error |\n|---|---|---|---|---|")
    for name, places in sets.items():
        for strangers in STRANGERS:
            rank, right, error = scores(places, strangers)
            print(f"| {name} | {strangers:.0%} | {rank:.3f} | {right:.3f} | {error:.3f} |")


def generated(describer: Appearance, crops: IdentityCrops, seed: int, same: bool) -> Place:
    """``(N, D)`` mean rows of the people of a place on two days, and who is in view together on the second."""
    rng = np.random.default_rng(seed)
    people = rng.choice(len(np.unique(crops.ids)), PEOPLE, replace=False)
    cameras = [draw_camera(rng, SIZE[0])] * 2 if same else [draw_camera(rng, SIZE[0]) for _ in range(2)]
    days = [
        np.array([_seen(describer, crops, rng, camera, int(person), day) for person in people])
        for day, camera in enumerate(cameras)
    ]
    return days[0], days[1], np.ones((PEOPLE, PEOPLE), dtype=bool)


def _seen(
    describer: Appearance, crops: IdentityCrops, rng: np.random.Generator, camera: CropCamera, person: int, day: int
) -> FloatArray:
    views = np.flatnonzero(crops.ids == person)[day * PICTURES : (day + 1) * PICTURES]
    box = np.array([[0.0, 0.0, SIZE[1], SIZE[0]]])
    rows = []
    for view in views:
        cover = crops.images[int(rng.integers(len(crops)))]
        rows.append(
            describer.describe(augment_crop(rng, camera, crops.images[view], crops.boxes[view], cover, SIZE), box)
        )
    return np.asarray(np.concatenate(rows).mean(axis=0))


def halves(describer: Appearance, source: Path, labels: Path) -> Place:
    """``(N, D)`` mean rows of the first and the second halves of labelled tracks, and which of these overlap."""
    wanted: dict[int, list[tuple[int, int, FloatArray]]] = {}
    truth = read_ground_truth(labels / "gt" / "gt.txt")
    truth = truth.select(truth.evaluated)
    people, counts = np.unique(truth.ids, return_counts=True)
    people = people[counts >= 2 * SHORTEST]
    for number, person in enumerate(people):
        boxes = np.flatnonzero(truth.ids == person)
        for half, rows in enumerate(np.array_split(boxes, 2)):
            for row in rows[np.linspace(0, len(rows) - 1, PICTURES + 2).round().astype(int)[1:-1]]:
                wanted.setdefault(int(truth.frames[row]), []).append((half, number, truth.boxes[row]))
    sums: FloatArray | None = None
    for frame in open_source(str(source)).frames():
        for half, number, box in wanted.get(frame.index, []):
            row = describer.describe(frame.image, box[None])[0]
            sums = np.zeros((2, len(people), len(row))) if sums is None else sums
            sums[half, number] += row
    assert sums is not None
    times = [np.array_split(truth.frames[truth.ids == person], 2)[1] for person in people]
    first, last = (np.array([frames[end] for frames in times]) for end in (0, -1))
    return sums[0], sums[1], (first[:, None] <= last) & (first <= last[:, None])


def scores(places: list[Place], strangers: float) -> tuple[float, float, float]:
    """Rank 1 of those in the gallery; share of right answers, nobody among them; and their calibration error."""
    ranks, right, sure = [], [], []
    for number, (first, second, together) in enumerate(places):
        rng = np.random.default_rng(number)
        inside = np.sort(rng.permutation(len(first))[: round(len(first) * (1 - strangers))])
        chances = recognise(centred(second), centred(first)[inside], together)
        truth = np.where(np.isin(np.arange(len(second)), inside), np.searchsorted(inside, np.arange(len(second))), -1)
        ranks += (chances.argmax(axis=1) == truth)[truth >= 0].tolist()
        nobody = 1 - chances.sum(axis=1)
        answer = np.where(nobody >= chances.max(axis=1), -1, chances.argmax(axis=1))
        right += (answer == truth).tolist()
        sure += np.maximum(nobody, chances.max(axis=1)).tolist()
    return float(np.mean(ranks)), float(np.mean(right)), calibration_error(np.array(sure), np.array(right))


def calibration_error(probabilities: FloatArray, right: FloatArray) -> float:
    """Mean distance between what was said and what came true, over ten bins of equal width, weighted by their size."""
    return float(sum(_shares(probabilities, right.astype(float))))


def _shares(probabilities: FloatArray, right: FloatArray) -> Iterator[float]:
    bins = np.minimum((probabilities * BINS).astype(int), BINS - 1)
    for number in np.unique(bins):
        here = bins == number
        yield abs(probabilities[here].mean() - right[here].mean()) * here.mean()


if __name__ == "__main__":
    main()
