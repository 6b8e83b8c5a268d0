"""Reads the free body model of MakeHuman and its clothes from a folder of unpacked packages.

Nothing of it is part of this project: `docs/methods/rendered-people.md` says how to get the folder, and the terms. Read
are the base mesh, shape targets, rig and skin weights as MPFB keeps them, and clothes, hair and skins as JSON with
textures.
"""

from __future__ import annotations

import gzip
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.figures.mesh import triangles_of_quads
from tsuiseki.datamodules.scenes.render.photographs import shrunk
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.openers.images import decoded_image
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray

# Of each limb the rig's bone that begins it, the cube there, what it hangs on, and its ends in a `PersonSkeleton`.
LIMBS = {
    "upperarm": ("upperarm01", "shoulder", "trunk", ("shoulder", "elbow")),
    "lowerarm": ("lowerarm01", "elbow", "upperarm", ("elbow", "wrist")),
    "wrist": ("wrist", "hand", "lowerarm", ("wrist", "fingers")),
    "upperleg": ("upperleg01", "upper-leg", "pelvis", ("hip", "knee")),
    "lowerleg": ("lowerleg01", "knee", "upperleg", ("knee", "ankle")),
    "foot": ("foot", "ankle", "lowerleg", ("ankle", "toe")),
}
# Bones that are moved.
BONES = ("pelvis", "trunk", "head", *(f"{limb}.{side}" for side in "LR" for limb in LIMBS))
# Of the rig's bones those that carry along all that hang on them, and the bone of `BONES` that moves them.
_ROOTS = {"root": "pelvis", "spine04": "trunk", "neck01": "head"} | {
    f"{LIMBS[limb][0]}.{side}": f"{limb}.{side}" for limb in LIMBS for side in "LR"
}
# The cube of the base mesh whose middle is where each bone begins.
_CUBES = {"pelvis": "pelvis", "trunk": "spine-4", "head": "neck"} | {
    f"{limb}.{side}": f"{side.lower()}-{LIMBS[limb][1]}" for limb in LIMBS for side in "LR"
}
# The cube at the end of each hand and foot.
_TIPS = {f"wrist.{s}": f"{s.lower()}-finger-3-1" for s in "LR"} | {f"foot.{s}": f"{s.lower()}-toe-3-1" for s in "LR"}
# Widest picture of cloth that is kept, pixels.
_LARGEST_TEXTURE = 512
# Of a decimetre, the files' unit.
_METRES = 0.1


class Garment:
    """Something that is worn: a mesh whose vertices hang on those of the body.

    Attributes:
        triangles: ``(T, 3)``.
        uv: ``(T, 3, 2)``.
        anchors: ``(N, 3)`` vertices of the body that each vertex hangs on.
        shares: ``(N, 3)`` of each of them.
        offsets: ``(N, 3)`` metres from there, for a body of the base's size.
        hidden: vertices of the body that are covered.
        texture: ``(h, w, 4)`` uint8 RGBA.
    """

    def __init__(self, path: Path) -> None:
        data: dict[str, Any] = read_json(path, "clothes of MakeHuman")
        rows = np.array(data["faces"]).reshape(-1, 10)
        if not (rows[:, 0] == 11).all():
            raise RequestError(f"expected quads with a material and texture coordinates in {path}, got other faces")
        self.triangles = triangles_of_quads(rows[:, 1:5])
        uv = np.array(data["uvs"][0]).reshape(-1, 2)[rows[:, 6:10]]
        self.uv = uv[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3, 2)
        self.anchors, self.shares = np.array(data["ref_vIdxs"]), np.array(data["weights"])
        self.offsets = _axes(np.array(data["offsets"]))
        self.hidden = np.flatnonzero(data["metadata"].get("deleteVerts") or [])
        textures = [path.parent / m["mapDiffuse"] for m in data["materials"] if m.get("mapDiffuse")]
        self.texture = read_texture(textures[0])


class BaseBody:
    """The base mesh with its helpers and rig; axes forward, left, up, metres.

    Attributes:
        vertices: ``(N, 3)``.
        quads: ``(F, 4)`` of the skin.
        uv: ``(F, 4, 2)``.
        helpers: quads of each group of helpers, by name: what clothes can be made from.
        weights: ``(N, B)`` of `BONES`.
        joints: vertices whose mean is where each bone begins, in the order of `BONES`.
        tips: the same for where hands and feet end.
    """

    def __init__(self, model: Path) -> None:
        points: list[list[str]] = []
        places: list[list[str]] = []
        quads: dict[str, list[list[list[int]]]] = {}
        group = ""
        for line in (model / "3dobjs" / "base.obj").read_text().splitlines():
            kind, *fields = line.split() or [""]
            if kind == "v":
                points.append(fields[:3])
            elif kind == "vt":
                places.append(fields[:2])
            elif kind == "g":
                group = fields[0]
            elif kind == "f":
                quads.setdefault(group, []).append([[int(n) - 1 for n in corner.split("/")] for corner in fields])
        skin = np.array(quads["body"])
        self.vertices, self.quads = _axes(np.array(points, dtype=np.float64)), skin[..., 0]
        self.uv = np.array(places, dtype=np.float64)[skin[..., 1]]
        self.helpers = {name: np.array(q)[..., 0] for name, q in quads.items() if name.startswith("helper-")}
        cubes = {name[6:]: np.unique(np.array(q)[..., 0]) for name, q in quads.items() if name.startswith("joint-")}
        self.joints = [cubes[_CUBES[bone]] for bone in BONES]
        self.tips = {bone: cubes[cube] for bone, cube in _TIPS.items()}
        rig = read_json(model / "rigs" / "standard" / "rig.default.json", "a rig of MakeHuman")
        moved = read_json(model / "rigs" / "standard" / "weights.default.json", "weights of MakeHuman")["weights"]
        weights = np.zeros((len(self.vertices), len(BONES)))
        for name, entries in moved.items():
            bone = name
            while bone and bone not in _ROOTS:
                bone = rig[bone]["parent"]
            at = np.array(entries, dtype=np.float64).reshape(-1, 2)
            np.add.at(weights[:, BONES.index(_ROOTS[bone or "root"])], at[:, 0].astype(np.int64), at[:, 1])
        weights[weights.sum(axis=1) == 0, 0] = 1
        self.weights = np.asarray(weights / weights.sum(axis=1, keepdims=True))


class Assets:
    """What a folder with the unpacked packages holds.

    Raises:
        RequestError: a needed file is not there.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        base = next(iter(sorted(self.folder.rglob("3dobjs/base.obj"))), None)
        if base is None:
            raise _lacking(f"the unpacked body packages under {self.folder} with a file 3dobjs/base.obj")
        self.model = base.parent.parent
        proxies = next(iter(sorted(self.folder.rglob("proxies/clothes"))), None)
        skins = sorted(self.folder.rglob("skins/*/textures/*diffuse*.png"))
        if proxies is None or not skins:
            raise _lacking(f"{'proxies/clothes' if proxies is None else 'skins with textures'} under {self.folder}")
        self.proxies = proxies.parent
        self.skins = skins
        self.body = BaseBody(self.model)

    @lru_cache(maxsize=64)  # noqa: B019
    def target(self, name: str) -> tuple[IntArray, FloatArray]:
        """Moved vertices ``(n,)`` and by how much ``(n, 3)``, metres; nothing for a target that is not there."""
        path = self.model / "targets" / "macrodetails" / f"{name}.target.gz"
        if not path.exists():
            return np.empty(0, dtype=np.int64), np.empty((0, 3))
        text = gzip.decompress(path.read_bytes()).decode()
        lines = [line.split() for line in text.splitlines() if line[:1].isdigit()]
        rows = np.array(lines, dtype=np.float64).reshape(-1, 4)
        return rows[:, 0].astype(np.int64), _axes(rows[:, 1:])

    @lru_cache(maxsize=32)  # noqa: B019
    def garment(self, kind: str, name: str) -> Garment:
        """The clothes or the hair (``kind``) of this name."""
        path = self.proxies / kind / name / f"{name}.json"
        if not path.exists():
            raise _lacking(str(path))
        return Garment(path)

    @lru_cache(maxsize=8)  # noqa: B019
    def skin(self, number: int) -> ImageArray:
        """``(h, w, 4)`` uint8 RGBA."""
        return read_texture(self.skins[number])


def _lacking(what: str) -> RequestError:
    return RequestError(f"expected {what}, got none; docs/methods/rendered-people.md says how to get the packages")


def read_texture(path: Path) -> ImageArray:
    """``(h, w, 4)`` uint8 RGBA, at most `_LARGEST_TEXTURE` wide."""
    image = decoded_image(path, cv2.IMREAD_UNCHANGED)
    if image is None:
        raise RequestError(f"expected a picture at {path}, got something that cannot be decoded; unpack it again")
    codes = {1: cv2.COLOR_GRAY2RGBA, 3: cv2.COLOR_BGR2RGBA, 4: cv2.COLOR_BGRA2RGBA}
    small = shrunk(image, _LARGEST_TEXTURE / image.shape[1])
    return np.asarray(cv2.cvtColor(small, codes[np.atleast_3d(small).shape[2]]), np.uint8)


def _axes(points: FloatArray) -> FloatArray:
    """From the files' left, up, forward in decimetres to forward, left, up in metres."""
    return np.asarray(points[:, [2, 0, 1]] * _METRES)
