"""Bends a figure into a pose: linear blend skinning along a skeleton's limbs."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.datamodules.scenes.figures.assets import BONES, LIMBS, Assets
from tsuiseki.datamodules.scenes.figures.equipment import equipment
from tsuiseki.datamodules.scenes.figures.figure import Figure
from tsuiseki.datamodules.scenes.figures.mesh import Mesh, Worn, joined, nearest, rasterise, vertex_normals
from tsuiseki.datamodules.scenes.people.gait import random_manner, standing, walking
from tsuiseki.datamodules.scenes.people.person import view_from
from tsuiseki.datamodules.scenes.people.poses import draw_pose, random_name
from tsuiseki.datamodules.scenes.people.posture import Build, PersonSkeleton, Pose
from tsuiseki.datamodules.scenes.render.tracing import tight
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import FloatArray, ImageArray


def posed(figure: Figure, skeleton: PersonSkeleton) -> list[FloatArray]:
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


def _bones(figure: Figure, skeleton: PersonSkeleton) -> tuple[list[FloatArray], list[FloatArray]]:
    """Rotations of all bones from rest, and where they begin."""
    rotation = {"pelvis": skeleton.pelvis_axes, "trunk": skeleton.trunk_axes, "head": skeleton.head_axes}
    origin = {"pelvis": figure.joints[0]}
    for b, bone in enumerate(BONES[1:], start=1):
        part, _, side = bone.partition(".")
        on = LIMBS[part][2] if side else {"trunk": "pelvis", "head": "trunk"}[bone]
        parent = f"{on}.{side}" if on in LIMBS else on
        parent_bone = BONES.index(parent)
        origin[bone] = rotation[parent] @ (figure.joints[b] - figure.joints[parent_bone]) + origin[parent]
        if side:
            children = [figure.joints[BONES.index(f"{limb}.{side}")] for limb in LIMBS if LIMBS[limb][2] == part]
            direction = rotation[parent] @ ((children[0] if children else figure.tips[bone]) - figure.joints[b])
            start, stop = (getattr(skeleton, joint)["LR".index(side)] for joint in LIMBS[part][3])
            rotation[bone] = shortest_turn(direction, stop - start) @ rotation[parent]
    return [rotation[b] for b in BONES], [origin[b] for b in BONES]


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


# Phases of a walk that a steady box is the mean of.
_PHASES = 8
# One vertex in so many counts for a steady box, which costs that much less.
_VERTEX_STEP = 4
# From further above, feet and head are too near to each other in the picture to place somebody by them, radians.
STEEP = 1.4


@dataclass(frozen=True)
class Sprite:
    """Somebody cut out, to be lit where it is shown; tight about the silhouette.

    Attributes:
        albedo: ``(h, w, 3)`` uint8 sRGB, black beside the person.
        normal: ``(h, w, 3)`` int8, 127 times the unit normal: away from the camera, left, up.
        label: ``(h, w)`` uint8 a `mesh.Worn`, 0 beside the person.
        feet: ``(2,)`` pixels of the place on the ground where the person stands; of who has a ``middle``, those of the
            left end of a line across the view, as long as the person is tall, with its own middle there.
        head: ``(2,)`` pixels of the point ``height`` above it; or of the right end of that line.
        height: metres.
        tilt: how far down the camera looked, radians.
        steady: ``(2,)`` pixels from the left border of the left and right side of a box that is as wide, and lies
            where, the silhouettes of the whole walk are and do on average; those of the silhouette of who stands.
        middle: metres over the ground of the middle of who is seen from straight above or does not stand; else 0.
        heading: where that one faces, radians to the left of away from the camera.
        pose: of who neither stands nor walks.
        drawn: name and seed of that pose, see `poses.draw_pose`.
    """

    albedo: ImageArray
    normal: NDArray[np.int8]
    label: NDArray[np.uint8]
    feet: FloatArray
    head: FloatArray
    height: float
    tilt: float
    steady: FloatArray
    middle: float = 0.0
    heading: float = 0.0
    pose: Pose | None = None
    drawn: str = ""


def random_sprites(
    rng: np.random.Generator,
    assets: Assets,
    views: int,
    height_px: float,
    tilts: tuple[float, float],
    posed_share: float = 0.0,
) -> list[Sprite]:
    """One person in ``views`` poses from as many sides, ``height_px`` pixels tall.

    ``tilts`` bound how far down the cameras look, radians; flatter ones are somewhat more common. Of the views,
    ``posed_share`` show one of the poses of `poses`, the others somebody who walks or stands.
    """
    figure, manner = Figure(rng, assets), random_manner(rng)
    sprites, build = list[Sprite](), Build(figure.height)
    for _ in range(views):
        if posed_share and rng.random() < posed_share:
            name, seed = random_name(rng), int(rng.integers(1 << 31))
            pose, heading = draw_pose(seed, build, name), float(rng.uniform(0, 2 * np.pi))
            skeleton = PersonSkeleton(build, pose, np.zeros(2), heading)
            beside = equipment(rng, name, skeleton)
            sprite = _across(rng, figure, skeleton, height_px, float(rng.uniform(*tilts)), beside)
            sprites.append(replace(sprite, heading=heading, pose=pose, drawn=f"{name} {seed}"))
            continue
        if rng.random() < 0.75:
            phase, speed = float(rng.random()), float(rng.uniform(0.4, 1.45))
            pose = walking(build, manner, phase, speed)
            cycle = [walking(build, manner, k / _PHASES, speed) for k in range(_PHASES)]
        else:
            pose, cycle = standing(rng, manner), []
        heading = float(rng.uniform(0, 2 * np.pi))
        tilt = float(tilts[0] + (tilts[1] - tilts[0]) * rng.beta(1.3, 1.9))
        skeleton, *others = (PersonSkeleton(build, stance, np.zeros(2), heading) for stance in (pose, *cycle))
        if tilt > STEEP:
            sprites.append(_across(rng, figure, skeleton, height_px, tilt))
            continue
        camera = view_from(tilt, height_px, figure.height, float(rng.uniform(6, 35)))
        sprite = render_figure(figure, skeleton, camera, tilt)
        sprites.append(replace(sprite, steady=steady_sides(figure, skeleton, others, camera, sprite)))
    return sprites


def _across(
    rng: np.random.Generator, figure: Figure, skeleton: PersonSkeleton, height_px: float, tilt: float,
    beside: list[Mesh] | None = None,
) -> Sprite:  # fmt: skip
    """``figure`` as `render_figure` has it, to be placed by its middle, from anywhere up to straight above."""
    joints = np.concatenate([skeleton.head[None], skeleton.wrist, skeleton.knee, skeleton.hip])
    middle, away = np.array([0.0, 0.0, 0.5 * float(joints[:, 2].max())]), float(rng.uniform(6, 35))
    position = middle + away * np.array([-np.cos(tilt), 0.0, np.sin(tilt)])
    size = math.ceil(2.6 * height_px)
    camera = PinholeCamera.look_at(position, middle, height_px * away / figure.height, size, size)
    across = np.array([[0.0, 0.5, 0.0], [0.0, -0.5, 0.0]]) * figure.height
    sprite = render_figure(figure, skeleton, camera, tilt, middle + across, beside)
    return replace(sprite, middle=float(middle[2]))


def steady_sides(
    figure: Figure, skeleton: PersonSkeleton, walk: list[PersonSkeleton], camera: PinholeCamera, sprite: Sprite
) -> FloatArray:
    """``(2,)`` columns of ``sprite``, ``figure`` in the pose of ``skeleton``: the mean sides in the poses of ``walk``.

    Those of the silhouette where there are none.
    """
    if not walk:
        return sprite.steady
    thin = copy.copy(figure)
    thin.meshes = [
        replace(m, vertices=m.vertices[::_VERTEX_STEP], weights=m.weights[::_VERTEX_STEP]) for m in figure.meshes
    ]
    sides = []
    for posture in (skeleton, *walk):
        columns = camera.project(np.concatenate(posed(thin, posture)))[0][:, 0]
        sides.append([columns.min(), columns.max()])
    return np.asarray(sprite.steady + (np.mean(sides[1:], axis=0) - sides[0]))


def render_figure(
    figure: Figure, skeleton: PersonSkeleton, camera: PinholeCamera, tilt: float, ends: FloatArray | None = None,
    beside: list[Mesh] | None = None,
) -> Sprite:  # fmt: skip
    """``figure`` in the pose of ``skeleton`` before ``camera``, which looks down by ``tilt`` radians.

    The steady sides are those of the silhouette. ``ends`` ``(2, 3)`` metres are what ``feet`` and ``head`` show; by
    default feet and head. What stands ``beside``, see `equipment`, is `Worn.EXTRA` where it covers the person.
    """
    meshes, vertices = [*figure.meshes, *(beside or [])], posed(figure, skeleton)
    if beside:
        # Who rides or sits is lifted, until the lowest of all stands on the ground.
        lowest = min(0.0, *(float(mesh.vertices[:, 2].min()) for mesh in beside))
        vertices = [points - [0.0, 0.0, lowest] for points in [*vertices, *(mesh.vertices for mesh in beside)]]
    parts = []
    for k, (mesh, points) in enumerate(zip(meshes, vertices, strict=True)):
        pixels, depth = camera.project(points)
        part = rasterise(pixels[mesh.triangles], depth[mesh.triangles], camera.width, camera.height)
        if mesh.cutout:
            part = part.select(np.flatnonzero(_texel(mesh, part.triangle, part.where)[:, 3] > 110))
        parts.append(replace(part, triangle=np.stack([np.full(len(part.pixel), k), part.triangle], axis=1)))
    visible = nearest(joined(parts))
    size = (camera.height, camera.width)
    albedo, normal = np.zeros((*size, 3), np.uint8), np.zeros((*size, 3), np.int8)
    label = np.zeros(size, np.uint8)
    for k, (mesh, points) in enumerate(zip(meshes, vertices, strict=True)):
        faces = visible.select(np.flatnonzero(visible.triangle[:, 0] == k))
        triangle = faces.triangle[:, 1]
        rows, columns = np.divmod(faces.pixel, camera.width)
        albedo[rows, columns] = _texel(mesh, triangle, faces.where)[:, :3]
        label[rows, columns] = mesh.labels[triangle]
        corners, where = mesh.triangles[triangle], faces.where[..., None]
        outward = (vertex_normals(points, mesh.triangles)[corners] * where).sum(axis=1)
        towards = camera.position - (points[corners] * where).sum(axis=1)
        outward *= np.where((outward * towards).sum(axis=1) < 0, -1.0, 1.0)[:, None]
        outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)
        normal[rows, columns] = np.round(127 * outward).astype(np.int8)
    if beside:
        covered = np.zeros(label.size, np.bool_)
        covered[np.concatenate([part.pixel for part in parts[: len(figure.meshes)]])] = True
        label[(label == Worn.BESIDE) & covered.reshape(size)] = Worn.EXTRA
    upright = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, figure.height]])
    pixels, _ = camera.project(upright if ends is None else ends)
    left, top, right, bottom = tight(label > 0)
    at = (slice(top, bottom), slice(left, right))
    feet, head = pixels - [left, top]
    sides = np.array([0.0, float(right - left)])
    return Sprite(albedo[at], normal[at], label[at], feet, head, figure.height, tilt, sides)


def _texel(mesh: Mesh, triangle: NDArray[np.int64], where: FloatArray) -> ImageArray:
    uv = (mesh.uv[triangle] * where[..., None]).sum(axis=1)
    h, w = mesh.texture.shape[:2]
    column = np.floor(uv[:, 0] % 1.0 * w).astype(np.int64) % w
    row = np.floor((1 - uv[:, 1] % 1.0) * h).astype(np.int64) % h
    return np.asarray(mesh.texture[row, column])


def smaller(sprite: Sprite, factor: float) -> Sprite:
    """The sprite at ``factor`` of its size; colours and normals are means over what they cover."""
    size = tuple(max(round(n * factor), 1) for n in sprite.label.shape[::-1])
    there = (sprite.label > 0).astype(np.float32)
    covered = cv2.resize(there, size, interpolation=cv2.INTER_AREA)
    visible = covered > 0.5
    over = np.where(visible, np.maximum(covered, 1e-6), np.inf)[..., None]
    albedo = cv2.resize(sprite.albedo.astype(np.float32), size, interpolation=cv2.INTER_AREA) / over
    normal = cv2.resize(sprite.normal.astype(np.float32), size, interpolation=cv2.INTER_AREA) / over
    label = np.asarray(cv2.resize(sprite.label, size, interpolation=cv2.INTER_NEAREST), np.uint8)
    label = np.where(visible, np.maximum(label, 1), 0).astype(np.uint8)
    grown = np.array(size) / sprite.label.shape[::-1]
    return replace(
        sprite, albedo=np.clip(albedo, 0, 255).astype(np.uint8), normal=normal.astype(np.int8), label=label,
        feet=sprite.feet * grown, head=sprite.head * grown, steady=sprite.steady * grown[0],
    )  # fmt: skip
