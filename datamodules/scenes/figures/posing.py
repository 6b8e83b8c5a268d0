"""Bends a figure into a pose: linear blend skinning along a skeleton's limbs."""

from __future__ import annotations

import numpy as np

from tsuiseki.datamodules.scenes.figures.assets import BONES
from tsuiseki.datamodules.scenes.figures.figure import Figure
from tsuiseki.datamodules.scenes.people.body import Skeleton
from tsuiseki.tracking.types import FloatArray

_PARENTS = {"trunk": "pelvis", "head": "trunk"} | {
    f"{bone}.{side}": parent if parent in ("trunk", "pelvis") else f"{parent}.{side}"
    for side in "LR"
    for bone, parent in (
        ("upperarm", "trunk"), ("lowerarm", "upperarm"), ("wrist", "lowerarm"),
        ("upperleg", "pelvis"), ("lowerleg", "upperleg"), ("foot", "lowerleg"),
    )
}  # fmt: skip
_NEXT = {"upperarm": "lowerarm", "lowerarm": "wrist", "upperleg": "lowerleg", "lowerleg": "foot"}


def posed(figure: Figure, skeleton: Skeleton) -> list[FloatArray]:
    """Vertices ``(N, 3)`` of each mesh of ``figure`` with limbs as the ``skeleton``'s, the lowest at height 0.

    The skeleton stands at the origin; only its directions matter, lengths are the figure's own.
    """
    rotations, origins = _bones(figure, skeleton)
    meshes = []
    for mesh in figure.meshes:
        moved = np.zeros_like(mesh.vertices)
        for b in range(len(BONES)):
            share = mesh.weights[:, b : b + 1]
            at = np.flatnonzero(share[:, 0])
            moved[at] += share[at] * ((mesh.vertices[at] - figure.joints[b]) @ rotations[b].T + origins[b])
        meshes.append(moved)
    lowest = min(v[:, 2].min() for v in meshes)
    return [v - [0.0, 0.0, lowest] for v in meshes]


def _bones(figure: Figure, skeleton: Skeleton) -> tuple[list[FloatArray], list[FloatArray]]:
    """Rotations of all bones from rest, and where they begin."""
    rotation = {"pelvis": skeleton.pelvis_axes, "trunk": skeleton.trunk_axes, "head": skeleton.head_axes}
    origin = {"pelvis": figure.joints[0]}
    for b, bone in enumerate(BONES[1:], start=1):
        parent = _PARENTS[bone]
        before = BONES.index(parent)
        origin[bone] = rotation[parent] @ (figure.joints[b] - figure.joints[before]) + origin[parent]
        if bone not in rotation:
            part, side = bone.split(".")
            end = figure.joints[BONES.index(f"{_NEXT[part]}.{side}")] if part in _NEXT else figure.tips[bone]
            rest = rotation[parent] @ (end - figure.joints[b])
            rotation[bone] = shortest_turn(rest, _direction(skeleton, part, "LR".index(side))) @ rotation[parent]
    return [rotation[b] for b in BONES], [origin[b] for b in BONES]


def _direction(s: Skeleton, part: str, k: int) -> FloatArray:
    start, end = {
        "upperarm": (s.shoulder, s.elbow),
        "lowerarm": (s.elbow, s.wrist),
        "wrist": (s.wrist, s.fingers),
        "upperleg": (s.hip, s.knee),
        "lowerleg": (s.knee, s.ankle),
        "foot": (s.ankle, s.toe),
    }[part]
    return np.asarray(end[k] - start[k])


def shortest_turn(a: FloatArray, b: FloatArray) -> FloatArray:
    """``(3, 3)`` rotation that takes the direction of ``a`` to that of ``b`` on the shortest way (Rodrigues)."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    axis, cosine = np.cross(a, b), float(a @ b)
    if cosine < -0.9999:
        side = np.cross(a, [1.0, 0.0, 0.0] if abs(a[0]) < 0.9 else [0.0, 1.0, 0.0])
        side /= np.linalg.norm(side)
        return np.asarray(2 * np.outer(side, side) - np.eye(3))
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1 + cosine))
