"""A person as two cylinders on the floor: from the upright box of a detection to its rotated box and its place.

The person model is put on the floor at every foot position (thesis 4.2.2.1). Its outline in the image gives the
upright box b = (x, y, w, h) that a detector would find there, the rotated box r = (x_r, y_r, w_r, h_r, phi) of least
area, and the place q = (q1, q2, 0) it stands at. A KD-tree over all b then finds, for a detected box, the nearest b
and with it r and q.

Rotated boxes here are ``(N, 5)``: centre x, y, width across the body, height along it, and the angle by which the
body is turned clockwise from upright, head up; pixels and radians in [-pi, pi). The feet end is known: it is the lower
one of the box before it is turned.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tsuiseki.tracking.cameras.camera_files import AnyCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.geometry import xywh_from_corners
from tsuiseki.tracking.openers.arrays import read_arrays
from tsuiseki.tracking.output import whole_file
from tsuiseki.tracking.types import FloatArray

# Of the tables on disk; those of another version are made anew.
VERSION = 2
# Points about each of a cylinder's two rims.
AROUND = 16
# A box along the body is taken for the box of least area where it is at most this much larger. Near the point below
# the camera the least box is almost square, and its direction would jump from one side to the next.
NEARLY_LEAST = 1.15
# The upper part of the height that is the head, metres.
HEAD_HEIGHT = 0.3
# Radius of the head, metres.
HEAD_RADIUS = 0.12
# Steps between foot positions in the image, pixels, and on the floor, metres. The two grids are joined, for the first
# is coarse on the floor near the rim, the second in the image near the middle.
STEPS = (4.0, 0.06)
# Share of the model's outline that must lie in the image.
INSIDE = 0.5


@dataclass(frozen=True)
class PersonModel:
    """A cylinder for the body and one on it for the head; metres.

    Attributes:
        height: of the whole person.
        body_radius: of trunk and legs.
    """

    height: float = 1.7
    body_radius: float = 0.25

    def __post_init__(self) -> None:
        if not (self.height > HEAD_HEIGHT and self.body_radius > 0):
            raise RequestError(
                "person model: expected positive radii and a head within the height, got "
                f"height {self.height:g}, head {HEAD_HEIGHT:g}, radii {self.body_radius:g}, {HEAD_RADIUS:g}"
            )

    def outline(self) -> FloatArray:
        """``(4 * AROUND, 3)`` points of the four rims about a person who stands at the origin."""
        turn = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
        ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
        neck = self.height - HEAD_HEIGHT
        levels = ((0.0, self.body_radius), (neck, self.body_radius), (neck, HEAD_RADIUS),
                  (self.height, HEAD_RADIUS))  # fmt: skip
        return np.concatenate([np.column_stack([radius * ring, np.full(AROUND, z)]) for z, radius in levels])


@dataclass(frozen=True)
class PersonTable:
    """The boxes and places of a person at every foot position, and the nearest for a detected box.

    Attributes:
        upright: ``(K, 4)`` x1, y1, x2, y2 cut off at the image, pixels.
        rotated: ``(K, 5)`` rotated boxes, see the module.
        places: ``(K, 2)`` x, y on the floor, metres.
    """

    upright: FloatArray
    rotated: FloatArray
    places: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "_tree", cKDTree(xywh_from_corners(self.upright)))

    def __len__(self) -> int:
        return len(self.places)

    def look_up(self, boxes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotated boxes ``(N, 5)`` and places ``(N, 2)`` of detected boxes ``(N, 4)`` x1, y1, x2, y2."""
        if not len(boxes):
            return np.empty((0, 5)), np.empty((0, 2))
        nearest = self._tree.query(xywh_from_corners(boxes))[1]  # type: ignore[attr-defined]
        return self.rotated[nearest], self.places[nearest]


def build_table(
    camera: AnyCamera,
    floor: FloatArray,
    person: PersonModel | None = None,
    steps: tuple[float, float] = STEPS,
) -> PersonTable:
    """The table of a camera over a floor.

    Args:
        camera: with its pose.
        floor: ``(4,)`` x1, y1, x2, y2 of the floor that people stand on, metres.
        person: their size.
        steps: between foot positions, see `STEPS`.

    Raises:
        RequestError: the camera hangs no higher than the person, or has no person of this floor in view.
    """
    person = person or PersonModel()
    check_height(camera, person)
    upright, rotated, feet = outlines(camera, _foot_positions(camera, floor, *steps), person, INSIDE)
    if not len(feet):
        raise RequestError("expected a floor in view of the camera, got none of it; check the pose and the floor")
    return PersonTable(upright, rotated, feet)


def outlines(
    camera: AnyCamera, feet: FloatArray, person: PersonModel, inside: float = 0.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Upright ``(K, 4)`` and rotated ``(K, 5)`` boxes of the model at ``feet`` ``(N, 2)``, and those feet ``(K, 2)``.

    A person of whom some point is beyond the rim, or less than ``inside`` of the outline in the image, is left out.
    """
    shape = person.outline()
    ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, person.height]])
    points = np.concatenate([shape, ends])
    world = np.column_stack([feet, np.zeros(len(feet))])[:, None] + points
    pixels, depth = camera.project(world.reshape(-1, 3))
    pixels = pixels.reshape(len(feet), -1, 2)
    with np.errstate(invalid="ignore"):
        within = np.asarray(((pixels >= 0) & (pixels <= [camera.width, camera.height])).all(axis=2))
    visible = np.asarray((depth > 0).reshape(len(feet), -1).all(axis=1))
    visible &= within[:, : len(shape)].mean(axis=1) >= max(inside, 1e-9)
    outline, foot, head = pixels[visible, : len(shape)], pixels[visible, -2], pixels[visible, -1]
    low, high = outline.min(axis=1), outline.max(axis=1)
    limit = np.array([camera.width, camera.height])
    upright = np.concatenate([np.clip(low, 0, limit), np.clip(high, 0, limit)], axis=1)
    # The pixel of the floor right under the camera, or the image's middle where that is not seen.
    nadir, depth = camera.project(np.array([[camera.position[0], camera.position[1], 0.0]]))
    below = nadir[0] if depth[0] > 0 else np.array([camera.width, camera.height]) / 2
    rotated = _smallest_boxes(outline.astype(np.float32), head - foot, foot - below)
    return upright, rotated, feet[visible]


def stand(
    camera: AnyCamera, place: FloatArray, floor: FloatArray, person: PersonModel | None = None
) -> tuple[FloatArray, FloatArray]:
    """Upright box ``(4,)`` and rotated box ``(5,)`` of one person who stands at ``place`` ``(2,)``, metres.

    Raises:
        RequestError: the place is not on the floor ``(4,)``, the camera hangs no higher than the person, or a part of
            the person is beyond the rim.
    """
    person = person or PersonModel()
    if not ((place >= floor[:2]) & (place <= floor[2:])).all():
        raise RequestError(
            f"expected a foot position on the floor {floor.tolist()}, got {np.asarray(place).tolist()}; move it, or "
            "give a larger floor"
        )
    check_height(camera, person)
    upright, rotated, _ = outlines(camera, np.asarray(place, dtype=np.float64)[None], person)
    if not len(upright):
        raise RequestError(
            f"expected a person wholly within the lens's rim, got one at {np.asarray(place).tolist()} who is partly "
            "beyond it; move it nearer to the camera"
        )
    return upright[0], rotated[0]


def check_height(camera: AnyCamera, person: PersonModel) -> None:
    """Refuse a camera that hangs no higher than the person.

    Raises:
        RequestError: it does.
    """
    if camera.position[2] <= person.height:
        raise RequestError(
            f"expected a camera above the person of {person.height:g} m, got one at a height of "
            f"{camera.position[2]:g} m; check the pose, or the person's height"
        )


def _smallest_boxes(outline: NDArray[np.float32], upward: FloatArray, outward: FloatArray) -> FloatArray:
    """``(K, 5)`` boxes of least area, nearly, about ``(K, P, 2)`` points, their heights along ``upward`` ``(K, 2)``.

    Right under the camera head and feet fall together; there the body points away from that place.
    """
    rectangles = np.array([(*c, *s, a) for c, s, a in map(cv2.minAreaRect, outline)], dtype=np.float64).reshape(-1, 5)
    weak = np.linalg.norm(upward, axis=1) < 1.0
    upward = np.where(weak[:, None], outward - np.array([0.0, 1e-6]), upward)
    least = headed(rectangles[:, :2], rectangles[:, 2:4], np.radians(rectangles[:, 4]), upward)
    along = _boxes_along(outline, upward)
    return np.where((along[:, 2] * along[:, 3] <= NEARLY_LEAST * least[:, 2] * least[:, 3])[:, None], along, least)


def _boxes_along(outline: NDArray[np.float32], upward: FloatArray) -> FloatArray:
    """``(K, 5)`` boxes about ``(K, P, 2)`` points whose heights lie along ``upward`` ``(K, 2)``."""
    up = upward / np.linalg.norm(upward, axis=1, keepdims=True)
    axes = np.stack([np.column_stack([-up[:, 1], up[:, 0]]), up], axis=1)
    spread = np.einsum("kij,kpj->kpi", axes, outline.astype(np.float64))
    low, high = spread.min(axis=1), spread.max(axis=1)
    centre = np.einsum("kij,ki->kj", axes, (low + high) / 2)
    return np.column_stack([centre, high - low, np.arctan2(up[:, 0], -up[:, 1])])


def headed(centre: FloatArray, size: FloatArray, angle: FloatArray, upward: FloatArray) -> FloatArray:
    """``(K, 5)`` rotated boxes whose height is the side that lies nearest to ``upward``.

    Args:
        centre: ``(K, 2)`` pixels.
        size: ``(K, 2)`` of the sides along and across ``angle``.
        angle: ``(K,)`` of the first side, clockwise from +x, radians.
        upward: ``(K, 2)`` from feet to head, pixels.
    """
    heading = np.arctan2(upward[:, 1], upward[:, 0])
    quarter = np.round((heading - angle) / (np.pi / 2))
    along_first = quarter % 2 == 0
    height = np.where(along_first, size[:, 0], size[:, 1])
    width = np.where(along_first, size[:, 1], size[:, 0])
    # An upright body points to -y, which is a quarter turn before +x.
    turned = angle + quarter * (np.pi / 2) + np.pi / 2
    turned = (turned + np.pi) % (2 * np.pi) - np.pi
    return np.column_stack([centre, width, height, turned])


def _foot_positions(camera: AnyCamera, floor: FloatArray, pixels: float, metres: float) -> FloatArray:
    """``(N, 2)`` metres: a grid of the image and one of the floor."""
    x1, y1, x2, y2 = floor
    u, v = np.meshgrid(np.arange(pixels / 2, camera.width, pixels), np.arange(pixels / 2, camera.height, pixels))
    from_image = camera.ground(np.column_stack([u.ravel(), v.ravel()]))[:, :2]
    x, y = np.meshgrid(np.arange(x1, x2 + 1e-9, metres), np.arange(y1, y2 + 1e-9, metres))
    feet = np.concatenate([from_image, np.column_stack([x.ravel(), y.ravel()])])
    with np.errstate(invalid="ignore"):
        on_floor = ((feet >= [x1, y1]) & (feet <= [x2, y2])).all(axis=1)
    return feet[on_floor]


def cached_table(
    folder: Path,
    camera: AnyCamera,
    floor: FloatArray,
    person: PersonModel,
    steps: tuple[float, float] = STEPS,
) -> PersonTable:
    """`build_table`, kept in ``folder`` under a hash of what it is made of; a broken file is made anew."""
    with np.printoptions(precision=17, threshold=100_000):
        described = repr((VERSION, camera, floor.tolist(), person, steps))
    path = folder / f"person-{hashlib.sha256(described.encode()).hexdigest()[:24]}.npz"
    if path.is_file():
        try:
            arrays = read_arrays(path, "a table of people")
            return PersonTable(arrays["upright"], arrays["rotated"], arrays["places"])
        except (ValueError, KeyError):
            pass  # made anew below
    table = build_table(camera, floor, person, steps)
    with whole_file(path) as file:
        np.savez(file, upright=table.upright, rotated=table.rotated, places=table.places)
    return table
