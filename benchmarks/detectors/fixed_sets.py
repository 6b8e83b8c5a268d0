"""Fixed sets that a detector of people is scored on while it is trained for long.

Real ones, generated ones by pose and by visibility, and generated places without people.

The real ones choose and never teach: PETS 1-300 and MOT17-13. Reported alone are PETS 301-400, MOT17-02's stills, and
people of OTB who walk, dive and ski. Generated are pictures of held-out rendered people:

    tsuiseki simulate sprites --assets out/assets --people 24 --views 12 --poses 0.8 --tilts=-0.1,1.5 --seed 78
        --out out/cache/sprites-val
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from benchmarks.detectors.accuracy import LOWEST_SCORE, labelled, video_in
from benchmarks.detectors.poses import OnePose
from tsuiseki.datamodules.scenes.figures.library import SpriteLibrary
from tsuiseki.datamodules.scenes.training_pictures import random_training_scene
from tsuiseki.datamodules.scenes.training_settings import settings_of_scene
from tsuiseki.tracking.evaluation.detection import LabelledBoxes, evaluate_detections
from tsuiseki.tracking.features.exported import SizedDetect, open_detector
from tsuiseki.tracking.features.tiles import parse_view
from tsuiseki.tracking.features.view_choice import ViewedDetector
from tsuiseki.tracking.formats.single import read_boxes
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray
from tsuiseki.tracking.video.source import open_source

# A detection counts from this score on, as in the tracker.
SCORE = 0.3
SIZE = (640, 480)
SEED = 62_000
# Pictures of crowds, and without people.
PICTURES = {"crowded": 40, "lifeless": 80}
# Pictures of each pose, and the scenes that they show in turn.
POSED, POSE_SCENES = 15, ("street", "near", "aerial")
# Lowest person in a crowd that counts, pixels.
LOWEST = 24
# Names of the poses that are reported, and those of `poses.draw_pose` that they stand for.
POSES: Mapping[str, tuple[str, ...]] = {
    "standing": ("",),
    "sitting": ("sitting", "seated on the ground"),
    "lying": ("lying",),
    "falling": ("falling",),
    "bent": ("crouching", "kneeling", "bending"),
}
# (least, greatest) visible share of a person.
VISIBLE = {"full": (0.75, 1.01), "half to three quarters": (0.5, 0.75), "less than half": (0.25, 0.5)}
# Clips of OTB with one labelled person.
ALONE = ("Crossing", "Couple", "Diving", "Skiing")
FALSE = "false boxes an empty picture"
# The numbers that the `score` is the mean of.
PARTS = (
    *(f"{name} {ap}" for name in ("PETS 1-300", "MOT17-13") for ap in ("AP50", "AP75")),
    *(f"recall {name}" for name in (*POSES, *VISIBLE)),
    FALSE,
)
Pictures: TypeAlias = Callable[[], Iterator[tuple[ImageArray, LabelledBoxes]]]


def real_sets(data: Path) -> dict[str, Pictures]:
    """Labelled pictures of PETS, MOT17-02 and MOT17-13 by name."""
    mot = data / "mot"
    pets, stills, bus = mot / "PETS09-S2L1-first", mot / "mot17-02-stills", mot / "mot17-13-video"
    return {
        "PETS 1-300": lambda: labelled(pets, pets, 0, 299, 6),
        "MOT17-13": lambda: labelled(video_in(bus), bus, 0, 749, 50),
        "PETS 301-400": lambda: labelled(pets, pets, 300, 399, 4),
        "MOT17-02": lambda: labelled(stills, stills, 0, 3, 1),
    }


def scores_of(file: Path, data: Path, sprites: Path) -> dict[str, float]:
    """All numbers of the detector in ``file``, and ``score``, see `headline`.

    Args:
        file: exported.
        data: the real sets.
        sprites: the held-out rendered people.
    """
    detector = open_detector(file, LOWEST_SCORE, threads=1)
    scores: dict[str, float] = {}
    for name, pictures in real_sets(data).items():
        scores |= {f"{name} {key}": value for key, value in _precision(detector, pictures).items()}
    scores |= _alone(detector, data / "sot" / "otb")
    scores |= _by_pose(detector, sprites) | _by_visibility(detector, sprites) | _empty(detector, sprites)
    return {"score": headline(scores)} | scores


def headline(scores: Mapping[str, float]) -> float:
    """The mean of the `PARTS`; of false boxes counts the share that is missing to one an empty picture."""
    return float(np.mean([1 - min(scores[name], 1.0) if name == FALSE else scores[name] for name in PARTS]))


def _precision(detector: SizedDetect, pictures: Pictures) -> dict[str, float]:
    """AP50, AP75, and precision and recall from `SCORE` on, in the view that ``--view auto`` takes."""
    shown = list(pictures())
    tiled = ViewedDetector(detector, parse_view("auto"))
    tiled.prepare([image for image, _ in shown[:3]])
    detections = [tiled.detect([image])[0] for image, _ in shown]
    truth = [labels for _, labels in shown]
    result = {
        f"AP{round(100 * iou)}": evaluate_detections(truth, detections, iou).average_precision for iou in (0.5, 0.75)
    }
    curve = evaluate_detections(truth, [_kept(image) for image in detections])
    last = (curve.precision[-1], curve.recall[-1]) if len(curve.recall) else (0.0, 0.0)
    return result | {"precision": float(last[0]), "recall": float(last[1])}


def _kept(detections: Detections) -> Detections:
    return detections.select(detections.scores >= SCORE)


def _alone(detector: SizedDetect, folder: Path) -> dict[str, float]:
    """Share of the frames of each clip in which its person has a box of IoU 0.3 or more."""
    result = {}
    for name in ALONE:
        boxes = read_boxes(folder / name / "groundtruth_rect.txt")
        frames = [f for f in open_source(folder / name / "img").frames() if f.index % 4 == 0 and f.index < len(boxes)]
        overlaps = [_overlap(boxes[f.index : f.index + 1], _kept(detector.detect([f.image])[0])) for f in frames]
        result[f"covered {name}"] = float(np.mean(np.concatenate(overlaps) >= 0.3))
    return result


def _overlap(boxes: FloatArray, detections: Detections) -> FloatArray:
    """``(N,)`` greatest IoU of a detection with each of the boxes."""
    return np.asarray(iou_matrix(boxes, detections.boxes).max(axis=1, initial=0))


def _by_pose(detector: SizedDetect, sprites: Path) -> dict[str, float]:
    """Recall at IoU 0.5 of people of whom a quarter is visible, in pictures of one pose."""
    result = {}
    for name, shown in POSES.items():
        overlaps = list[FloatArray]()
        for pose in shown:
            for image, boxes, visibility in drawn(sprites, pose or "standing"):
                overlaps.append(_overlap(boxes[visibility >= 0.25], _kept(detector.detect([image])[0])))
        result[f"recall {name}"] = float(np.mean(np.concatenate(overlaps) >= 0.5))
    return result


def _by_visibility(detector: SizedDetect, sprites: Path) -> dict[str, float]:
    """Recall at IoU 0.5 in crowds, by how much of a person is visible."""
    overlaps, shares = list[FloatArray](), list[FloatArray]()
    for image, boxes, visibility in drawn(sprites, "crowded"):
        large = boxes[:, 3] - boxes[:, 1] >= LOWEST
        overlaps.append(_overlap(boxes[large], _kept(detector.detect([image])[0])))
        shares.append(visibility[large])
    hit, share = np.concatenate(overlaps) >= 0.5, np.concatenate(shares)
    return {
        f"recall {name}": float(hit[(share >= low) & (share < high)].mean()) for name, (low, high) in VISIBLE.items()
    }


def _empty(detector: SizedDetect, sprites: Path) -> dict[str, float]:
    counts = [len(_kept(detector.detect([image])[0])) for image, _, _ in drawn(sprites, "lifeless")]
    return {FALSE: float(np.mean(counts))}


@cache
def drawn(sprites: Path, name: str) -> list[tuple[ImageArray, FloatArray, FloatArray]]:
    """Pictures of a scene or of one pose, with boxes and visibilities; drawn once, and kept beside the sprites."""
    file = sprites.with_name(f"{sprites.name}-{name.replace(' ', '-')}.npz")
    if not file.is_file():
        library, arrays = OnePose(sprites), dict[str, Any]()
        for number in range(PICTURES.get(name, POSED)):
            rng = np.random.default_rng([SEED, *name.encode(), number])
            settings = settings_of_scene(name if name in PICTURES else POSE_SCENES[number % 3], rng, SIZE)
            if name in PICTURES:
                picture = random_training_scene(rng, settings, SpriteLibrary(sprites))
            else:
                library.shown = "" if name == "standing" else name
                picture = random_training_scene(rng, replace(settings, people=(2, 12), rendered=1.0), library)
            arrays |= {f"{part}{number}": value for part, value in zip("ibv", picture, strict=True)}
        np.savez(file, **arrays)
    with np.load(file, allow_pickle=False) as kept:
        return [(kept[f"i{n}"], kept[f"b{n}"], kept[f"v{n}"]) for n in range(len(kept.files) // 3)]
