"""One person at rest: a body's shape, its skin, clothes, shoes, hair and what is carried."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.figures.assets import BONES, Assets, BaseBody, Garment
from tsuiseki.datamodules.scenes.figures.mesh import Mesh, Worn, ellipsoid, triangles_of_quads, vertex_normals
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray

# Names of whole suits, by sex.
SUITS = {
    "male": (
        "male_casualsuit01", "male_casualsuit02", "male_casualsuit03", "male_casualsuit04", "male_casualsuit05",
        "male_casualsuit06", "male_elegantsuit01", "male_worksuit01",
    ),
    "female": ("female_casualsuit01", "female_casualsuit02", "female_elegantsuit01", "female_sportsuit01"),
}  # fmt: skip
# Names of shoes.
SHOE_PAIRS = tuple(f"shoes0{n}" for n in range(1, 7))
# Names of hairstyles, by sex.
HAIRS = {
    "male": ("short01", "short02", "short03", "short04", "afro01"),
    "female": ("bob01", "bob02", "Braid01", "long01", "ponytail01", "short01", "short03"),
}
# Names of hats.
HATS = ("fedora", "fedora_cocked")
# Numbers of the bones below the hip.
_LEGS = [BONES.index(f"{part}.{s}") for part in ("upperleg", "lowerleg", "foot") for s in "LR"]
# Numbers of the bones from shoulder to elbow.
_UPPER_ARMS = [BONES.index(f"upperarm.{s}") for s in "LR"]
# Numbers of the bones below the elbow.
_LOWER_ARMS = [BONES.index(f"{part}.{s}") for part in ("lowerarm", "wrist") for s in "LR"]
# Numbers of the bones below the ankle.
_FEET = [BONES.index(f"foot.{s}") for s in "LR"]
# Numbers of the bones below the knee.
_SHANKS = [BONES.index(f"{part}.{s}") for part in ("lowerleg", "foot") for s in "LR"]
# Metres that a garment lies over the layer below it: layers must not lie in one another.
_OVER = 0.004


class Figure:
    """Somebody at rest, drawn at random.

    Attributes:
        meshes: in the body's axes, metres.
        joints: ``(B, 3)`` where the bones begin.
        tips: where hands and feet end, by bone.
        height: metres.
    """

    def __init__(self, rng: np.random.Generator, assets: Assets) -> None:
        sex = "male" if rng.random() < 0.55 else "female"
        age = str(rng.choice(["child", "young", "old"], p=[0.1, 0.65, 0.25]))
        shape, self.height = _shape(rng, assets, sex, age)
        body = assets.body
        worn = _clothes(rng, assets, shape, sex)
        names: list[tuple[str, str]] = []
        if rng.random() < 0.08:
            names.append(("clothes", str(rng.choice(HATS))))
        elif sex == "female" or rng.random() >= 0.1:
            names.append(("hair", str(rng.choice(HAIRS[sex]))))
        names.append(("clothes", str(rng.choice(SHOE_PAIRS))))
        others = []
        for kind, name in names:
            label = Worn.HAIR if kind == "hair" else Worn.SHOES if name in SHOE_PAIRS else Worn.EXTRA
            others.append(_fitted(body, shape, assets.garment(kind, name), label))
        fitted, hidden = zip(*others, *worn, strict=True)
        skins = [n for n, p in enumerate(assets.skins) if f"_{sex}" in p.parent.parent.name]
        skin = assets.skin(int(rng.choice(skins if skins else len(assets.skins))))
        covered = np.zeros(len(shape), dtype=np.bool_)
        covered[np.concatenate(hidden)] = True
        bare = ~covered[body.quads].all(axis=1)
        triangles, uv = triangles_of_quads(body.quads[bare]), body.uv[bare][:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3, 2)
        labels = np.full(len(triangles), Worn.SKIN, np.uint8)
        meshes = [Mesh(shape, triangles, uv, body.weights, labels, skin), *fitted]
        self.joints = np.stack([shape[at].mean(axis=0) for at in body.joints])
        meshes += _carried(rng, self.joints, self.height)
        if rng.random() < 0.12:
            meshes.append(_cap(rng, shape, body, self.joints))
        self.tips = {bone: shape[at].mean(axis=0) for bone, at in body.tips.items()}
        self.meshes = []
        for mesh in meshes:
            # Vertices that no triangle has are left out.
            used, rows = np.unique(mesh.triangles, return_inverse=True)
            vertices, weights = mesh.vertices[used], mesh.weights[used]
            self.meshes.append(replace(mesh, vertices=vertices, weights=weights, triangles=rows.reshape(-1, 3)))


def _shape(rng: np.random.Generator, assets: Assets, sex: str, age: str) -> tuple[FloatArray, float]:
    """Vertices of a random body, its feet on the ground, and its height in metres."""
    shape = assets.body.vertices.copy()
    races = ("caucasian", "african", "asian")
    first, second = rng.choice(races, 2)
    part = float(rng.uniform(0.6, 1.0))
    muscle, weight = float(rng.uniform(-0.6, 0.9)), float(np.clip(rng.normal(0.1, 0.5), -0.9, 1.0))
    shares = {f"{first}-{sex}-{age}": part, f"{second}-{sex}-{age}": 1 - part}
    for m, sm in _levels("muscle", muscle):
        for w, sw in _levels("weight", weight):
            shares[f"universal-{sex}-{age}-{m}-{w}"] = sm * sw
    for name, share in shares.items():
        at, moved = assets.target(name)
        shape[at] += share * moved
    low, high = shape[assets.body.quads.ravel(), 2].min(), shape[assets.body.quads.ravel(), 2].max()
    mean = {"male": 1.76, "female": 1.64}[sex]
    height = float(rng.uniform(1.1, 1.5)) if age == "child" else float(np.clip(rng.normal(mean, 0.07), 1.45, 2.0))
    shape[:, 2] -= low
    return shape * (height / (high - low)), height


def _levels(name: str, value: float) -> list[tuple[str, float]]:
    """The two targets about ``value`` in [-1, 1] and their shares."""
    return [(f"average{name}", 1 - abs(value)), (f"{'max' if value > 0 else 'min'}{name}", abs(value))]


def _fitted(body: BaseBody, shape: FloatArray, garment: Garment, label: int) -> tuple[Mesh, IntArray]:
    """A garment put on, and the body's vertices that it hides.

    A suit's label 0 stands for `Worn.UPPER` and `Worn.LOWER`, by the bones that move it.
    """
    scale = (shape[:, 2].max() - shape[:, 2].min()) / (body.vertices[:, 2].max() - body.vertices[:, 2].min())
    vertices = np.einsum("nk,nkd->nd", garment.shares, shape[garment.anchors]) + scale * garment.offsets
    weights = np.clip(np.einsum("nk,nkb->nb", garment.shares, body.weights[garment.anchors]), 0, None)
    weights /= weights.sum(axis=1, keepdims=True)
    low = weights[garment.triangles][:, :, [0, *_LEGS]].sum(axis=2).mean(axis=1) > 0.5
    labels = np.where(low, Worn.LOWER, Worn.UPPER) if label == 0 else np.full(len(low), label)
    labels = labels.astype(np.uint8)
    return Mesh(vertices, garment.triangles, garment.uv, weights, labels, garment.texture, True), garment.hidden


def _clothes(rng: np.random.Generator, assets: Assets, shape: FloatArray, sex: str) -> list[tuple[Mesh, IntArray]]:
    """Meshes and the body's vertices that each hides."""

    def sewn(part: str, least: float, longest: float) -> tuple[Mesh, IntArray]:
        return _sewn(rng, assets.body, shape, part, float(rng.uniform(least, longest))), np.empty(0, dtype=np.int64)

    if rng.random() < 0.6:
        suit = assets.garment("clothes", str(rng.choice(SUITS[sex])))
        worn = [_fitted(assets.body, shape, suit, 0)]
        return [*worn, sewn("upper", 0.016, 0.032)] if rng.random() < 0.25 else worn
    worn = [sewn("lower", 0.006, 0.022), sewn("upper", 0.006, 0.032)]
    return [*worn, sewn("skirt", 0.005, 0.03)] if rng.random() < (0.45 if sex == "female" else 0.06) else worn


def _sewn(rng: np.random.Generator, body: BaseBody, shape: FloatArray, part: str, loose: float) -> Mesh:
    """A garment made of the body's helper meshes, ``loose`` metres off the body."""
    quads = body.helpers["helper-skirt" if part == "skirt" else "helper-tights"]
    triangles = triangles_of_quads(quads)
    normals = vertex_normals(shape, triangles)
    vertices = shape + normals * (loose + _OVER)
    weights = body.weights[triangles].mean(axis=1)
    legs = weights[:, _LEGS].sum(axis=1)
    middle = shape[triangles][:, :, 2].mean(axis=1)
    hip = shape[body.joints[BONES.index("upperleg.L")], 2].mean()
    if part == "upper":
        # From a short shirt to a coat that reaches the knee.
        hem = hip - float(rng.choice([0.0, 0.08, 0.14, 0.4], p=[0.25, 0.4, 0.25, 0.1])) * (hip / 0.9)
        covered_faces = middle > hem
        if rng.random() < 0.35:
            covered_faces &= weights[:, _LOWER_ARMS].sum(axis=1) < 0.3
        if rng.random() < 0.08:
            covered_faces &= weights[:, _UPPER_ARMS].sum(axis=1) < 0.3
    elif part == "lower":
        covered_faces = (legs > 0.2) | (middle < hip + 0.12)
        covered_faces &= weights[:, _UPPER_ARMS + _LOWER_ARMS].sum(axis=1) < 0.1
        covered_faces &= weights[:, _FEET].sum(axis=1) < 0.45
        if rng.random() < 0.2:
            covered_faces &= weights[:, _SHANKS].sum(axis=1) < float(rng.uniform(0.1, 0.6))
    else:
        bottom = float(rng.uniform(0.1, 0.62)) * hip
        covered_faces = middle > bottom
    covered_faces &= weights[:, [BONES.index("wrist.L"), BONES.index("wrist.R")]].sum(axis=1) < 0.6
    corner = vertices[triangles]
    across = np.arctan2(corner[..., 1] - corner[..., 1].mean(), corner[..., 0]) / (2 * np.pi)
    across = np.where(np.ptp(across, axis=1, keepdims=True) > 0.5, across % 1.0, across)
    uv = np.stack([2 * across, corner[..., 2] / 0.6], axis=-1)
    labels = np.full(len(triangles), Worn.UPPER if part == "upper" else Worn.LOWER, np.uint8)
    return Mesh(vertices, triangles[covered_faces], uv[covered_faces], body.weights, labels[covered_faces], fabric(rng))


def covered(shell: tuple[FloatArray, IntArray], cloth: ImageArray, label: Worn) -> Mesh:
    """A shell of ``cloth`` that no bone moves."""
    vertices, triangles = shell
    spread = vertices[triangles] / 0.3
    uv = np.stack([spread[..., 0] + spread[..., 1], spread[..., 2]], axis=-1)
    unmoved = np.zeros((len(vertices), len(BONES)))
    return Mesh(vertices, triangles, uv, unmoved, np.full(len(triangles), label, np.uint8), cloth)


def _rigid(rng: np.random.Generator, shell: tuple[FloatArray, IntArray], bone: str) -> Mesh:
    """A shell that moves with one bone."""
    mesh = covered(shell, fabric(rng), Worn.EXTRA)
    mesh.weights[:, BONES.index(bone)] = 1
    return mesh


def _carried(rng: np.random.Generator, joints: FloatArray, height: float) -> list[Mesh]:
    kind, size, side = rng.random(), height * float(rng.uniform(0.75, 1.2)), str(rng.choice(["L", "R"]))
    trunk, shoulder = joints[BONES.index("trunk")], joints[BONES.index("upperarm.L")]
    if kind < 0.18:
        middle = np.array([shoulder[0] - 0.115 * height, 0.0, 0.45 * trunk[2] + 0.55 * shoulder[2]])
        shell = ellipsoid(middle, size * np.array([0.055, 0.085, 0.13]), float(rng.uniform(0.5, 0.9)))
        return [_rigid(rng, shell, "trunk")]
    if kind < 0.3:
        hand = joints[BONES.index(f"wrist.{side}")]
        # In the body's rest the arms point aside; what hangs from the hand then hangs along the arm.
        along = hand - joints[BONES.index(f"lowerarm.{side}")]
        along /= np.linalg.norm(along)
        radii, left = size * np.array([0.085, 0.03, 0.07]), np.cross(along, [1.0, 0.0, 0.0])
        vertices, triangles = ellipsoid(np.zeros(3), radii, float(rng.uniform(0.45, 0.8)))
        axes = np.stack([[1.0, 0.0, 0.0], left / np.linalg.norm(left), -along], axis=1)
        return [_rigid(rng, (vertices @ axes.T + hand + along * 0.14 * size, triangles), f"wrist.{side}")]
    if kind < 0.42:
        hip = joints[BONES.index(f"upperleg.{side}")]
        middle = hip + np.array([-0.01, 0.07 * height * np.sign(hip[1]), 0.05])
        shell = ellipsoid(middle, size * np.array([0.08, 0.03, 0.065]), float(rng.uniform(0.5, 0.9)))
        return [_rigid(rng, shell, "pelvis")]
    return []


def _cap(rng: np.random.Generator, shape: FloatArray, body: BaseBody, joints: FloatArray) -> Mesh:
    """A cap, or with luck a hood."""
    top = shape[body.quads.ravel()]
    top = top[top[:, 2] > joints[BONES.index("head"), 2] + 0.1]
    low, high = top.min(axis=0), top.max(axis=0)
    hood = rng.random() < 0.4
    radii = (high - low) / 2 + 0.018
    shell = ellipsoid((low + high) / 2 + [-0.012, 0, 0.01], radii * [1.0, 1.08, 1.04], 1.0)
    mesh = _rigid(rng, shell, "head")
    corner = shell[0][shell[1]].mean(axis=1)
    level = low[2] + (0.35 if hood else 0.55) * (high[2] - low[2])
    above_brim = corner[:, 2] + (0.6 * (low[0] + high[0]) / 2 - 0.6 * corner[:, 0] if hood else 0.0) > level
    return replace(mesh, triangles=mesh.triangles[above_brim], uv=mesh.uv[above_brim], labels=mesh.labels[above_brim])


# Width and height of a picture of cloth, pixels.
_SIDE = 128


def fabric(rng: np.random.Generator) -> ImageArray:
    """``(128, 128, 4)`` uint8 RGBA of grey cloth; its colour is chosen where it is shown."""
    level = np.full((_SIDE, _SIDE), 0.6, dtype=np.float32)
    for cells, strength in ((4, 0.05), (9, 0.05), (24, 0.03), (64, 0.03)):
        noise = rng.normal(0, strength * rng.uniform(0.4, 1.3), (cells, max(cells // 2, 2))).astype(np.float32)
        level += cv2.resize(noise, (_SIDE, _SIDE), interpolation=cv2.INTER_CUBIC)
    kind = rng.random()
    rows, columns = np.mgrid[:_SIDE, :_SIDE]
    contrast = np.float32(rng.uniform(0.45, 1.7))
    if kind < 0.12:
        level[rows // int(rng.integers(3, 14)) % 2 == 0] *= contrast
    elif kind < 0.18:
        level[columns // int(rng.integers(3, 10)) % 2 == 0] *= contrast
    elif kind < 0.26:
        side = int(rng.integers(4, 12))
        level[rows // side % 2 == 0] *= np.sqrt(contrast)
        level[columns // side % 2 == 0] *= np.sqrt(contrast)
    elif kind < 0.34:
        spots = cv2.resize(rng.random((24, 24)).astype(np.float32), (_SIDE, _SIDE))
        level[spots > 0.6] *= contrast
    grey = np.clip(level * 255, 8, 250).astype(np.uint8)
    return np.dstack([grey, grey, grey, np.full_like(grey, 255)])
