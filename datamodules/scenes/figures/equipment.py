"""What a rendered person rides, sits in, pushes or holds: a bicycle, a wheelchair, a pram, an umbrella."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tsuiseki.datamodules.scenes.figures.figure import covered, fabric
from tsuiseki.datamodules.scenes.figures.mesh import Mesh, Worn, ellipsoid, triangles_of_quads
from tsuiseki.datamodules.scenes.people.posture import PersonSkeleton
from tsuiseki.tracking.types import FloatArray, IntArray

Shell = tuple[FloatArray, IntArray]
# Radius of a bicycle's wheel, metres.
_WHEEL = 0.34
# Height of its cranks' axle over the ground, metres.
_AXLE = 0.28
# Corners around a wheel.
_AROUND = 28
# Corners around a tube.
_SECTORS = 8


def equipment(rng: np.random.Generator, name: str, skeleton: PersonSkeleton) -> list[Mesh]:
    """Meshes in the world of what the pose ``name`` needs, or none; they may reach below the person's feet.

    Args:
        rng: draws sizes and cloth.
        name: of a pose, see `poses.draw_pose`.
        skeleton: of the person, who stands at the origin.
    """
    if name not in _MADE:
        return []
    axes = skeleton.pelvis_axes
    # Made before somebody who faces x, with the pelvis above the origin.
    root, limbs = np.array([skeleton.pelvis[0], skeleton.pelvis[1], 0.0]), copy.copy(skeleton)
    limbs.fingers, limbs.ankle = (skeleton.fingers - root) @ axes, (skeleton.ankle - root) @ axes
    shells = _MADE[name](rng, limbs)
    cloth = fabric(rng)
    parts = [covered(shell, cloth, Worn.BESIDE) for shell in shells]
    return [replace(mesh, vertices=mesh.vertices @ axes.T + root) for mesh in parts]


def _tube(start: FloatArray | list[float], end: FloatArray | list[float], radius: float) -> Shell:
    """A straight tube between two points."""
    start, end = np.asarray(start, np.float64), np.asarray(end, np.float64)
    along = (end - start) / np.linalg.norm(end - start)
    aside = np.cross(along, [0.0, 1.0, 0.0] if abs(along[1]) < 0.9 else [1.0, 0.0, 0.0])
    aside /= np.linalg.norm(aside)
    angle = np.linspace(0, 2 * np.pi, _SECTORS, endpoint=False)[:, None]
    ring = radius * (np.cos(angle) * aside + np.sin(angle) * np.cross(along, aside))
    here = np.arange(_SECTORS)
    next_sector = (here + 1) % _SECTORS
    quads = np.stack([here, next_sector, next_sector + _SECTORS, here + _SECTORS], axis=1)
    return np.concatenate([start + ring, end + ring]), triangles_of_quads(quads)


def _wheel(centre: FloatArray | list[float], radius: float, thick: float, spokes: int = 0) -> Shell:
    """A ring about the y axis, with spokes."""
    angle = np.linspace(0, 2 * np.pi, _AROUND, endpoint=False)[:, None]
    rim = np.asarray(centre) + radius * np.concatenate([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    parts = [_tube(rim[k], rim[(k + 1) % _AROUND], thick) for k in range(_AROUND)]
    parts += [_tube(centre, rim[k * _AROUND // spokes], 0.3 * thick) for k in range(spokes)]
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    triangles = [triangles + start for (_, triangles), start in zip(parts, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(triangles)


def _dome(top: FloatArray, radius: float, height: float, opening: FloatArray | None = None) -> Shell:
    """The upper half of an ellipsoid; with an ``opening`` direction, only the half away from it."""
    centre = top - [0, 0, height]
    vertices, triangles = ellipsoid(centre, np.array([radius, radius, height]))
    middle = vertices[triangles].mean(axis=1) - centre
    above = middle[:, 2] > 0
    if opening is not None:
        above &= middle @ opening < 0.3 * radius
    return vertices, triangles[above]


def _bicycle(rng: np.random.Generator, limbs: PersonSkeleton) -> list[Shell]:
    axle = np.array([limbs.ankle[:, 0].mean(), 0.0, limbs.ankle[:, 2].mean() - 0.06])
    ground = axle[2] - _AXLE
    rear, front = (np.array([axle[0] + x, 0.0, ground + _WHEEL]) for x in (-0.45, rng.uniform(0.58, 0.68)))
    saddle = np.array([-0.04, 0.0, limbs.pelvis[2] - 0.11])
    bar = np.array([limbs.fingers[:, 0].mean(), 0.0, limbs.fingers[:, 2].mean() - 0.02])
    neck = front + 0.85 * (bar - front)
    thick = float(rng.uniform(0.014, 0.024))
    ends = [(rear, axle), (rear, saddle), (axle, saddle), (axle, neck), (front, bar), (saddle, neck)]
    if rng.random() < 0.4:
        # A frame to step through has no upper tube.
        ends.pop()
    shells = [_tube(*end, thick) for end in ends]
    shells.append(_tube(bar + np.r_[0, 0.28, 0], bar - [0, 0.28, 0], thick))
    shells += [_tube(axle, ankle - [0, 0, 0.06], 0.012) for ankle in limbs.ankle]
    shells += [_wheel(wheel, _WHEEL, 0.02, 10) for wheel in (rear, front)]
    shells.append(ellipsoid(saddle, np.array([0.13, 0.07, 0.035])))
    if rng.random() < 0.35:
        shells.append(ellipsoid(bar + np.r_[0.14, 0, -0.08], np.array([0.15, 0.19, 0.12]), 0.5))
    return shells


def _wheelchair(rng: np.random.Generator, limbs: PersonSkeleton) -> list[Shell]:
    seat = limbs.pelvis[2] - 0.1
    ground = min(seat - 0.46, float(limbs.ankle[:, 2].min()) - 0.12)
    large, wide = float(rng.uniform(0.28, 0.32)), float(rng.uniform(0.26, 0.31))
    shells = [
        ellipsoid(np.array([0.08, 0, seat]), np.array([0.24, wide, 0.03]), 0.3),
        ellipsoid(np.array([-0.16, 0, seat + 0.22]), np.array([0.025, wide, 0.24]), 0.3),
    ]
    for side, ankle in zip((1, -1), limbs.ankle, strict=True):
        y = side * wide
        shells.append(_wheel([-0.02, y + 0.04 * side, ground + large], large, 0.018, 8))
        shells.append(_wheel([0.36, y, ground + 0.08], 0.08, 0.02, 4))
        shells += [
            _tube([-0.17, y, seat + 0.45], [-0.32, y, seat + 0.47], 0.016),
            _tube([-0.16, y, seat + 0.2], [0.2, y, seat + 0.22], 0.022),
            _tube([0.3, y, seat], [ankle[0], ankle[1], ankle[2] - 0.08], 0.014),
            _tube([0.32, y, seat], [0.36, y, ground + 0.08], 0.014),
            ellipsoid(ankle + np.r_[0.08, 0, -0.09], np.array([0.11, 0.07, 0.012]), 0.3),
        ]
    return shells


def _pram(rng: np.random.Generator, limbs: PersonSkeleton) -> list[Shell]:
    handle = np.array([limbs.fingers[:, 0].mean() + 0.03, 0.0, limbs.fingers[:, 2].mean()])
    middle = np.array([handle[0] + rng.uniform(0.35, 0.5), 0.0, rng.uniform(0.55, 0.7)])
    half = np.array([rng.uniform(0.3, 0.42), rng.uniform(0.19, 0.26), 0.14])
    towards = np.array([-1.0, 0.0, 0.0]) * rng.choice([-1.0, 1.0])
    hood = _dome(middle + np.r_[-0.4 * half[0] * towards[0], 0, 0.45], half[1] * 1.15, 0.35, towards)
    radius = float(rng.uniform(0.09, 0.15))
    shells = [ellipsoid(middle, half, 0.4), hood, _tube(handle - [0, 0.25, 0], handle + np.r_[0, 0.25, 0], 0.016)]
    for left in (half[1], -half[1]):
        shells.append(_tube(handle + np.r_[0, left, 0], middle + np.r_[0.3, left, -0.35], 0.014))
        for along in (-0.8, 0.8):
            hub = np.array([middle[0] + along * half[0], left, radius])
            shells += [_wheel(hub, radius, 0.022, 5), _tube(hub, middle + np.r_[0.2 * along, left, -0.1], 0.012)]
    return shells


def _umbrella(rng: np.random.Generator, limbs: PersonSkeleton) -> list[Shell]:
    hand = limbs.fingers[int(limbs.fingers[:, 2].argmax())]
    top = hand + np.r_[rng.normal(0, 0.06), rng.normal(0, 0.06), rng.uniform(0.62, 0.75)]
    radius = float(rng.uniform(0.45, 0.62))
    return [_tube(hand - [0, 0, 0.1], top, 0.01), _dome(top, radius, float(rng.uniform(0.18, 0.3)))]


_MADE: dict[str, Callable[[np.random.Generator, PersonSkeleton], list[Shell]]] = {
    "cycling": _bicycle, "in a wheelchair": _wheelchair, "pushing a pram": _pram, "under an umbrella": _umbrella,
}  # fmt: skip
