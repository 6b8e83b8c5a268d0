"""What the parts of `track fisheye` make of real pictures: calibrations, rotated boxes, detections, ten frames.

1. Calibration: each board's pose under OCamCalib's lens and under one pinhole fitted to all boards; round trip of the
   lens; its inverse polynomial against the exact root, over every pixel.
2. Labelled rotated boxes: from the upright box about each, the table of a two-cylinder person under a generic
   equidistant lens gives a rotated box. The person's size over the camera's height is chosen on every other box of an
   image and reported on the rest.
3. The detector on the same pictures: AP50 of upright boxes, and of the rotated boxes looked up for them.
4. The ten frames tracked, by the given boxes and by the detector's, as `--method hungarian` and `flow` do.

    OMP_NUM_THREADS=1 python -m benchmarks.fisheye.real --data ../shared/data/fisheye
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.cameras.calibration import locate_over_floor, pose_at
from tsuiseki.tracking.cameras.lens_files import read_lens
from tsuiseki.tracking.cameras.lens_fitting import EquidistantLens, fit_omnidirectional
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera, OmnidirectionalLens
from tsuiseki.tracking.cameras.person_model import PersonModel, PersonTable, build_table, stand
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.detection import evaluate_rotated
from tsuiseki.tracking.evaluation.multi import SequencePair, evaluate_sequences
from tsuiseki.tracking.evaluation.result_files import read_truths
from tsuiseki.tracking.features.exported import Appearance, Detect, Detector
from tsuiseki.tracking.fisheye.page import corners
from tsuiseki.tracking.fisheye.settings import FisheyeSettings
from tsuiseki.tracking.fisheye.tracker import FloorMethod, link_on_floor
from tsuiseki.tracking.fisheye.unrolled import DETECTORS, ceiling_detector
from tsuiseki.tracking.fisheye.view import CeilingView
from tsuiseki.tracking.formats.rotated import (
    RotatedBoxes,
    about_bodies,
    half_turned,
    read_rotated_labels,
    turned_detections,
)
from tsuiseki.tracking.geometry import rotated_iou
from tsuiseki.tracking.openers.images import decoded_image
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.video.image_folder import read_image
from tsuiseki.tracking.weights import shipped

# Height of the camera over the floor; only the person's share of it matters in the image.
CAMERA = 3.0
# Likewise, of the overhead stills.
OVERHEAD_CAMERA = 2.6
HEIGHTS = (1.0, 1.35, 1.7)
RADII = (0.25, 0.35)
# Of a detection that is tracked: the default of `track fisheye`.
LEAST_SCORE = 0.3
# Overlap from which a detection is taken to mean a labelled person.
TOUCHING = 0.1
# Where the labels of the ten frames give a person another's id, as looking at them shows: the image, x of the box's
# centre, and whose box it is.
EXCHANGED = {
    ("Lunch3_000004", 1499): 14,
    ("Lunch3_000004", 1622): 5,
    ("Lunch3_000007", 997): 9,
    ("Lunch3_000007", 1445): 11,
    ("Lunch3_000008", 1511): 14,
    ("Lunch3_000008", 1612): 5,
}
# Inner corners of the boards.
PATTERN = (5, 4)


def main() -> None:
    """Print all four."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("../shared/data/fisheye"))
    parser.add_argument("--detector", type=Path, default=None)
    parser.add_argument("--view", choices=("unrolled", "image"), default="unrolled")
    parser.add_argument("--rings", default="1,4", help="tiles of each ring of unrolled views, separated by commas")
    parser.add_argument("--overhead", type=Path, default=None, help="draw the model over a still into this file")
    parser.add_argument("--stills", type=Path, default=None, help="draw the detector's boxes over the overhead stills "
                        "into this folder, from a score of 0.2 on, thick from 0.3")  # fmt: skip
    parser.add_argument("--blank", action="store_true", help="and leave the still out")
    options = parser.parse_args()
    if options.overhead is not None:
        overhead(options.data / "ocam-overhead", options.overhead, blank=options.blank)
        return
    cv2.setNumThreads(1)
    if options.stills is not None:
        stills(options.data / "ocam-overhead", options.stills)
        return
    for path in sorted((options.data / "calibrations").glob("*.txt")):
        lens(path)
    boards(options.data / "ocam-overhead")
    rings = [int(n) for n in options.rings.split(",")]
    network = Detector(options.detector or shipped(DETECTORS[options.view]), 0.05, threads=1)

    @lru_cache(maxsize=4)
    def detector(width: int, height: int) -> Detect:
        return ceiling_detector(network, _camera(width, height), options.view, rings)

    for name in ("rotated-boxes", "cepdof-sample"):
        detected(options.data / name, detector, labelled(options.data / name))
    ten_frames(options.data / "cepdof-sample", detector)


def lens(path: Path) -> None:
    """Round trip and inverse polynomial over every pixel of an image."""
    found = read_lens(path)
    x, y = np.meshgrid(np.arange(found.width) + 0.5, np.arange(found.height) + 0.5)
    pixels = np.column_stack([x.ravel(), y.ravel()])
    rays = found.rays(pixels)
    pixels, rays = pixels[np.isfinite(rays[:, 0])], rays[np.isfinite(rays[:, 0])]
    trip = np.abs(found.project(rays) - pixels).max()
    away = np.hypot(*(found.project_by_inverse(rays) - pixels).T)
    near = np.hypot(*(pixels - found.centre).T) < 300
    print(f"{path.name}: round trip {trip:.1e} px; inverse polynomial off by {away[near].max():.4f} px within 300 px "
          f"of the centre, {away.max():.4f} px at most")  # fmt: skip


def boards(folder: Path) -> None:
    """Reprojection residuals of the checkerboards."""
    calibration = read_lens(folder / "calib_results.txt")
    camera = OmnidirectionalCamera(calibration, np.eye(3), np.zeros(3))
    objects, images, residuals = [], [], []
    for path in sorted(folder.rglob("cal*.jpg")):
        board = _corners(np.asarray(decoded_image(path, cv2.IMREAD_GRAYSCALE), dtype=np.uint8))
        if board is None:
            continue
        corners, squares = board
        try:
            _, away, _ = locate_over_floor(camera, corners, squares)
        except RequestError:
            _, away, _ = locate_over_floor(camera, corners, squares * [1, -1])
        residuals.append(away)
        objects.append(np.column_stack([squares, np.zeros(len(squares))]).astype(np.float32))
        images.append(corners.astype(np.float32)[:, None])
    guess = np.array([[326.0, 0, 326.9], [0, 326.0, 261.7], [0, 0, 1]])
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_ZERO_TANGENT_DIST
    flags |= cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    pinhole = cv2.calibrateCamera(objects, images, (640, 480), guess, np.zeros(5), flags=flags)[0]
    each = np.concatenate(residuals)
    print(
        f"{len(residuals)} of 12 boards found, {len(each)} corners: {np.sqrt(np.mean(each**2)):.2f} px rms "
        f"({np.median(each):.2f} median) by OCamCalib's lens, {pinhole:.2f} px rms by a pinhole fitted to them"
    )


def _corners(grey: NDArray[np.uint8]) -> tuple[FloatArray, FloatArray] | None:
    found, corners = cv2.findChessboardCorners(
        grey, PATTERN, flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    )
    if not found:
        return None
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 0.001)
    corners = cv2.cornerSubPix(grey, corners, (5, 5), (-1, -1), stop)
    x, y = np.meshgrid(np.arange(PATTERN[0]), np.arange(PATTERN[1]))
    return corners.reshape(-1, 2).astype(np.float64) + 0.5, np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)


def _generic(width: int, height: int) -> OmnidirectionalLens:
    """An equidistant lens whose right angle lies at the nearer border."""
    focal = np.full(2, min(width, height) / 2 / (np.pi / 2))
    middle = np.array([width, height]) / 2
    return fit_omnidirectional(EquidistantLens(width, height, focal, middle, np.zeros(4)))


def _camera(width: int, height: int) -> OmnidirectionalCamera:
    return OmnidirectionalCamera(_generic(width, height), np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, CAMERA]))


@lru_cache(maxsize=32)
def _table(width: int, height: int, person: PersonModel) -> PersonTable:
    camera = _camera(width, height)
    reach = 6 * CAMERA
    steps = max(width, height) / 120, 0.3
    return build_table(camera, np.array([-reach, -reach, reach, reach]), person, steps)


def _picture(folder: Path, name: str) -> ImageArray:
    return read_image(folder / "images" / f"{name}.jpg")


def labelled(folder: Path) -> dict[str, PersonTable]:
    """How well the model explains the labels of each image; the tables of the chosen people."""
    labels = read_rotated_labels(folder / "annotations.json")
    people = [PersonModel(height=h, body_radius=r) for h in HEIGHTS for r in RADII]
    tables, errors, overlaps = {}, [], []
    for name, each in labels.items():
        height, width = _picture(folder, name).shape[:2]
        fitted = [np.median(_explained(each, np.s_[::2], (height, width), p)[1]) for p in people]
        person = people[int(np.argmax(fitted))]
        angle, overlap, radial = _explained(each, np.s_[1::2], (height, width), person)
        tables[name] = _table(width, height, person)
        errors.append(angle)
        overlaps.append(overlap)
        if folder.name == "rotated-boxes":
            print(
                f"{name}: person of {person.height:g} m, radius {person.body_radius:g} m under {CAMERA:g} m; "
                f"{len(angle)} other boxes: median angle error {np.median(angle):.1f} deg "
                f"(the radius's own {np.median(radial):.1f}), median IoU {np.median(overlap):.3f}"
            )
    angle, overlap = np.concatenate(errors), np.concatenate(overlaps)
    print(
        f"{folder.name}, {len(angle)} boxes: angle {np.median(angle):.1f} deg, IoU {np.median(overlap):.3f} (medians)"
    )
    return tables


def _explained(
    labels: RotatedBoxes, which: slice, size: tuple[int, int], person: PersonModel
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Angle errors of the looked-up boxes, degrees, their IoU with the labels, and angle errors of the radius."""
    height, width = size
    boxes = labels.boxes[which]
    rotated, _ = _table(width, height, person).look_up(about_bodies(boxes))
    errors = np.abs(half_turned(rotated[:, 4] - boxes[:, 4]))
    x, y = (boxes[:, :2] - [width / 2, height / 2]).T
    radial = np.abs(half_turned(np.arctan2(y, x) + np.pi / 2 - boxes[:, 4]))
    overlaps = np.array([rotated_iou(r[None], b[None])[0, 0] for r, b in zip(rotated, boxes, strict=True)])
    return np.degrees(errors), overlaps, np.degrees(radial)


def detected(folder: Path, detector: Callable[[int, int], Detect], tables: dict[str, PersonTable]) -> None:
    """AP50 of the detector, for upright boxes and for turned ones, which are looked up where it turns none."""
    labels = read_rotated_labels(folder / "annotations.json")
    upright, rotated = {}, {}
    for name in labels:
        picture = _picture(folder, name)
        found = detector(picture.shape[1], picture.shape[0]).detect([picture])[0]
        none, turned = np.full(len(found), -1), _unturned(found.boxes)
        if found.angles is None:
            upright[name] = RotatedBoxes(turned, none, found.scores)
            turned = tables[name].look_up(found.boxes)[0]
        else:
            turned[:, 4] = found.angles
            upright[name] = RotatedBoxes(_unturned(about_bodies(turned)), none, found.scores)
        rotated[name] = RotatedBoxes(turned, none, found.scores)
    about = {n: RotatedBoxes(_unturned(about_bodies(e.boxes)), e.ids, e.scores) for n, e in labels.items()}
    plain, exact = evaluate_rotated(about, upright), evaluate_rotated(labels, rotated)
    print(f"{folder.name}: detector AP50 {plain.average_precision:.3f} upright (best F1 {plain.best_f1:.2f} at "
          f"{plain.best_threshold:.2f}), {exact.average_precision:.3f} rotated")  # fmt: skip
    print(f"{folder.name}: rotated AP50 would be {_limits(labels, rotated)}")


def _limits(labels: Mapping[str, RotatedBoxes], found: Mapping[str, RotatedBoxes]) -> str:
    """AP50 of rotated boxes if something of each detection that touches a label were that label's."""
    parts = []
    for what, columns in (("places", [0, 1]), ("sizes", [2, 3]), ("angles", [4]), ("order", [])):
        ideal = {}
        for name, each in found.items():
            overlaps = rotated_iou(each.boxes, labels[name].boxes)
            best, boxes = overlaps.max(axis=1), each.boxes.copy()
            touches = np.ix_(best > TOUCHING, columns)
            boxes[touches] = labels[name].boxes[overlaps.argmax(axis=1)][touches]
            ideal[name] = RotatedBoxes(boxes, each.ids, each.scores if columns else best)
        parts.append(f"{evaluate_rotated(labels, ideal).average_precision:.3f} with right {what}")
    return ", ".join(parts)


def _unturned(boxes: FloatArray) -> FloatArray:
    centre, size = (boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]
    return np.concatenate([centre, size, np.zeros((len(boxes), 1))], axis=1)


def ten_frames(folder: Path, detector: Callable[[int, int], Detect]) -> None:
    """Identity scores over the ten frames at one frame a second."""
    truth = read_truths(folder / "annotations.json")[0]
    labels = read_rotated_labels(folder / "annotations.json")
    person = PersonModel(height=1.3, body_radius=0.3)
    first = _picture(folder, next(iter(labels)))
    table = _table(first.shape[1], first.shape[0], person)
    view = CeilingView(table, Appearance(shipped("appearance_people"), threads=1))
    for source in ("given", "own"):
        frames = []
        for name, each in labels.items():
            image = _picture(folder, name)
            if source == "given":
                found = turned_detections(each)
            else:
                found = detector(image.shape[1], image.shape[0]).detect([image])[0]
                found = found.select(found.scores >= LEAST_SCORE)
            frames.append(view.describe(image, view.locate(found)))
        for method in get_args(FloorMethod):
            linked = link_on_floor(frames, 1.0, method, FisheyeSettings(), StageTimes())
            for ids, known in (("as labelled", truth.labels), ("put right", _put_right(truth.labels, labels))):
                pair = SequencePair(truth.name, known, [t.track for t in linked], truth.length)
                scores = evaluate_sequences([pair]).combined
                print(f"{folder.name}, {source} boxes, {method}, ids {ids}: {len(linked)} tracks, "
                      f"{scores.id_switches} switches, MOTA {scores.mota:.3f}, IDF1 {scores.idf1:.3f}, "
                      f"recall {scores.recall:.2f}, precision {scores.precision:.2f}")  # fmt: skip


def _put_right(truth: GroundTruth, labels: Mapping[str, RotatedBoxes]) -> GroundTruth:
    """The truth of the ten frames, its rows in the order of the labels, with the right ids."""
    names = [(name, round(x)) for name, each in labels.items() for x in each.boxes[:, 0].tolist()]
    # Ids of the truth count from 1.
    ids = [EXCHANGED.get(name, known - 1) + 1 for name, known in zip(names, truth.ids.tolist(), strict=True)]
    return replace(truth, ids=np.array(ids, dtype=np.int64))


def _overhead_camera(folder: Path) -> OmnidirectionalCamera:
    """The camera of the overhead stills, which show more at the sides than was calibrated."""
    wide = read_lens(folder / "calib_results.txt").resized(1280, 720, "widen")
    return pose_at(OmnidirectionalCamera(wide, np.eye(3), np.zeros(3)), OVERHEAD_CAMERA)


def stills(folder: Path, out: Path) -> None:
    """The overhead stills with what the shipped detector finds in them."""
    out.mkdir(parents=True, exist_ok=True)
    network = Detector(shipped(DETECTORS["unrolled"]), 0.2, threads=1)
    detector = ceiling_detector(network, _overhead_camera(folder), "unrolled")
    for path in sorted((folder / "data").rglob("2016*.jpg")):
        image = read_image(path)
        found = detector.detect([image])[0]
        boxes = _unturned(found.boxes)
        boxes[:, 4] = 0 if found.angles is None else found.angles
        drawn = image[:, :, ::-1].copy()
        for box, score in zip(np.round(corners(boxes)).astype(np.int32), found.scores.tolist(), strict=True):
            cv2.polylines(drawn, [box], True, (0, 160, 0), 5 if score >= LEAST_SCORE else 1, cv2.LINE_AA)
            cv2.putText(drawn, f"{score:.2f}", tuple(box[0].tolist()), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (0, 0, 220), 2)
        cv2.imwrite(str(out / f"{path.stem}.jpg"), drawn)
        strong = np.round(found.scores[found.scores >= LEAST_SCORE], 2).tolist()
        print(f"{path.stem}: scores from {LEAST_SCORE:g} on {strong}")


def overhead(folder: Path, out: Path, *, blank: bool) -> None:
    """Somebody who stands and somebody on a chair, placed by hand, as cylinders with upright and rotated boxes."""
    camera = _overhead_camera(folder)
    picture = np.ascontiguousarray(read_image(folder / "data" / "12may16" / "2016-05-13-033831.jpg")[:, :, ::-1])
    if blank:
        picture[:] = 250
        cv2.circle(picture, tuple(np.round(camera.lens.centre).astype(int).tolist()), 500, (235, 235, 235), -1)
    for place, person in (((-0.31, -0.09), PersonModel(1.72)), ((0.38, 0.05), PersonModel(1.2, 0.28))):
        upright, rotated = stand(camera, np.array(place), np.array([-3.0, -3.0, 3.0, 3.0]), person)
        points = camera.project(person.outline() + np.append(place, 0.0))[0].reshape(4, -1, 2)
        box = np.round(corners(rotated[None])[0]).astype(np.int32)
        low, high = np.round(upright.reshape(2, 2)).astype(int).tolist()
        cv2.polylines(picture, list(np.round(points).astype(np.int32)), True, (160, 110, 0), 2, cv2.LINE_AA)
        cv2.rectangle(picture, tuple(low), tuple(high), (0, 0, 220), 2)
        cv2.polylines(picture, [box], True, (0, 160, 0), 2, cv2.LINE_AA)
        cv2.line(picture, tuple(box[2].tolist()), tuple(box[3].tolist()), (0, 160, 0), 5)
    cv2.imwrite(str(out), picture[:, 130:1150])


if __name__ == "__main__":
    main()
