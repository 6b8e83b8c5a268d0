"""A tiny body of boxes in the files of the real one: nothing third-party is needed."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.datamodules.scenes.figures.assets import _CUBES, _TIPS, BONES, Assets
from tsuiseki.datamodules.scenes.figures.figure import HAIRS, HATS, SHOE_PAIRS, SUITS
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.types import FloatArray

# Where bones begin: forward, left, up, metres; the arms point aside and down.
JOINTS = {
    "pelvis": (0, 0, 0.95), "trunk": (0, 0, 1.05), "head": (0, 0, 1.5),
    "upperarm.L": (0, 0.18, 1.42), "lowerarm.L": (0, 0.38, 1.25), "wrist.L": (0, 0.56, 1.08),
    "upperleg.L": (0, 0.1, 0.9), "lowerleg.L": (0, 0.1, 0.48), "foot.L": (0, 0.1, 0.08),
}  # fmt: skip
JOINTS |= {bone.replace(".L", ".R"): (x, -y, z) for bone, (x, y, z) in JOINTS.items() if bone.endswith(".L")}
TIPS = {
    "wrist.L": (0, 0.64, 1.0),
    "foot.L": (0.15, 0.1, 0.02),
    "wrist.R": (0, -0.64, 1.0),
    "foot.R": (0.15, -0.1, 0.02),
}
ENDS = {
    "pelvis": "trunk", "trunk": "head", "upperarm": "lowerarm", "lowerarm": "wrist", "upperleg": "lowerleg",
    "lowerleg": "foot",
}  # fmt: skip
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def _box(low: FloatArray, high: FloatArray) -> FloatArray:
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


def _limb(bone: str, wider: float) -> FloatArray:
    part, _, side = bone.partition(".")
    start = np.array(JOINTS[bone], dtype=np.float64)
    after = ENDS.get(part, "")
    if bone in TIPS:
        end = np.array(TIPS[bone])
    elif bone == "head":
        end = start + np.array([0, 0, 0.25])
    else:
        end = np.array(JOINTS[f"{after}.{side}" if side else after])
    half = (0.12 if bone in ("pelvis", "trunk", "head") else 0.05) + wider
    return _box(np.minimum(start, end) - np.array([half, half, 0]), np.maximum(start, end) + np.array([half, half, 0]))


class _Writer:
    def __init__(self) -> None:
        self.points: list[FloatArray] = []
        self.lines: list[str] = []
        self.bones: list[str] = []

    def add(self, group: str, box: FloatArray, bone: str) -> None:
        first = 8 * len(self.points)
        self.points.append(box)
        self.bones += [bone] * 8
        self.lines.append(f"g {group}")
        self.lines += ["f " + " ".join(f"{first + n + 1}/{k + 1}" for k, n in enumerate(q)) for q in QUADS]

    def text(self) -> str:
        # Files hold left, up, forward in decimetres.
        rows = 10 * np.concatenate(self.points)[:, [1, 2, 0]]
        head = [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in rows]
        return "\n".join([*head, "vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1", *self.lines])


def write_assets(folder: Path) -> Path:
    """The folder of a body of boxes with clothes of one quad."""
    model = folder / "model"
    writer = _Writer()
    for bone in BONES:
        writer.add("body", _limb(bone, 0.0), bone)
    for bone in BONES:
        writer.add("helper-tights", _limb(bone, 0.01), bone)
    writer.add("helper-skirt", _box(np.array([-0.2, -0.25, 0.4]), np.array([0.2, 0.25, 0.95])), "pelvis")
    for bone, cube in _CUBES.items():
        writer.add(f"joint-{cube}", _box(np.array(JOINTS[bone]) - 0.01, np.array(JOINTS[bone]) + 0.01), bone)
    for bone, cube in _TIPS.items():
        writer.add(f"joint-{cube}", _box(np.array(TIPS[bone]) - 0.01, np.array(TIPS[bone]) + 0.01), bone)
    (model / "3dobjs").mkdir(parents=True)
    (model / "3dobjs" / "base.obj").write_text(writer.text())
    rigs = model / "rigs" / "standard"
    rigs.mkdir(parents=True)
    names = {"pelvis": "root", "trunk": "spine04", "head": "neck01"}
    of_bone = {b: names.get(b, b.replace(".", "01.") if not b.startswith(("wrist", "foot")) else b) for b in BONES}
    (rigs / "rig.default.json").write_text(json.dumps({name: {"parent": ""} for name in of_bone.values()}))
    weights = {name: [[n, 1.0] for n, b in enumerate(writer.bones) if b == bone] for bone, name in of_bone.items()}
    (rigs / "weights.default.json").write_text(json.dumps({"weights": weights}))
    for sex in ("male", "female"):
        _texture(folder / "data" / "skins" / f"young_{sex}" / "textures" / "skin_diffuse.png", (90, 140, 200))
    worn = [("clothes", n) for n in (*SUITS["male"], *SUITS["female"], *SHOE_PAIRS, *HATS)]
    worn += [("hair", n) for n in {*HAIRS["male"], *HAIRS["female"]}]
    for kind, name in worn:
        _garment(folder / "data" / "proxies" / kind / name / f"{name}.json")
    return folder


def _texture(path: Path, bgr: tuple[int, int, int]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((4, 4, 3), bgr, np.uint8))


def _garment(path: Path) -> None:
    """A quad on the trunk's front."""
    _texture(path.parent / "textures" / "cloth.png", (180, 60, 60))
    first = 8 * BONES.index("trunk")
    corners = [first + n for n in (4, 6, 7, 5)]
    data = {
        "faces": [11, 0, 1, 2, 3, 0, 0, 1, 2, 3],
        "uvs": [[0, 0, 1, 0, 1, 1, 0, 1]],
        "materials": [{"mapDiffuse": "textures/cloth.png"}],
        "ref_vIdxs": [[n, n, n] for n in corners],
        "weights": [[0.5, 0.25, 0.25]] * 4,
        "offsets": [[0, 0, 0.05]] * 4,
        "metadata": {"deleteVerts": []},
    }
    path.write_text(json.dumps(data))


@pytest.fixture(scope="session")
def assets_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_assets(tmp_path_factory.mktemp("assets"))


@pytest.fixture(scope="session")
def assets(assets_folder: Path) -> Assets:
    return Assets(assets_folder)


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory, assets_folder: Path) -> Path:
    folder = tmp_path_factory.mktemp("sprites") / "library"
    words = ["simulate", "sprites", "--assets", str(assets_folder), "--people", "3", "--views", "2", "--height", "64"]
    assert main([*words, "--seed", "4", "--out", str(folder)]) == 0
    return folder
