"""The commands that make the shipped models, as they stand in `docs/training.md` and `docs/rendered-people.md`."""

from __future__ import annotations

import json
import shlex
import sys
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

from tsuiseki.datamodules.scenes.figures.assets import Assets
from tsuiseki.datamodules.scenes.render.photographs import Photographs
from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.pipelines.people.demo import STREET_MODELS

SHIPPED = {kind: f"{name}.onnx" for kind, name in STREET_MODELS.items()}
# What the demo takes where there is nothing to render people of.
DRAWN = SHIPPED | {"detector": "detector_street.onnx"}

# {configs}: the configurations of the package; {work}: where checkpoints and clips go; {models}: where the models go.
COMMANDS = (
    "train detector --config {configs}/detector_scenes.yaml --out {work}/detector",
    "export detector --checkpoint {work}/detector/checkpoints/best.ckpt --float16 --out {models}/detector_street.onnx "
    "--calibrate out/cache/scenes-640x480-val --training-data 'generated scenes'",
    "train appearance --config {configs}/appearance_scenes.yaml --out {work}/appearance",
    "export appearance --checkpoint {work}/appearance/checkpoints/best.ckpt --float16 "
    "--out {models}/appearance_people.onnx --training-data 'generated scenes'",
    *(f"simulate street --seed {seed} --frames 300 --out {{work}}/streets/street-{seed}" for seed in range(8)),
    "train affinity --folders {work}/streets --detector {models}/detector_street.onnx --skips 1,2,3 "
    "--appearance {models}/appearance_people.onnx --out {models}/affinity_people.onnx",
)
# {assets}: bodies and clothes; {pictures}, {sparse}, {towns}, {sparse_towns}, {crisp}, {many}: what is rendered of
# them, as `data.train` and `data.val` take it.
RENDERED_COMMANDS = (
    "simulate sprites --assets {assets} --out {work}/sprites",
    "train detector --config {configs}/detector_rendered.yaml --out {work}/rendered "
    "--model.start {models}/detector_street.onnx --data.train {pictures} --data.val {sparse}",
    "train detector --config {configs}/detector_rendered.yaml --out {work}/rendered-2 "
    "--model.start {work}/rendered/checkpoints/last.ckpt --data.train {pictures} --data.val {sparse} "
    "--trainer.max_epochs 7 --model.learning_rate 0.0013 --data.seed 5",
    "train detector --config {configs}/detector_rendered.yaml --out {work}/rendered-3 "
    "--model.start {work}/rendered-2/checkpoints/last.ckpt --data.train {pictures} --data.val {sparse} "
    "--trainer.max_epochs 14 --data.seed 9",
    "export detector --checkpoint {work}/rendered-3/checkpoints/last.ckpt --float16 --calibrate {work}/rendered-sparse "
    "--out {work}/rendered.onnx",
    "train detector --config {configs}/detector_towns.yaml --out {work}/towns --model.start {work}/rendered.onnx "
    "--data.train {towns} --data.val {sparse_towns}",
    "export detector --checkpoint {work}/towns/checkpoints/epoch=3.ckpt "
    "--blend {work}/rendered.onnx --float16 --height 672 --width 896 --calibrate {work}/rendered-sparse "
    "--out {models}/detector_figures.onnx --training-data 'rendered people'",
    "train detector --config {configs}/detector_rendered.yaml --out {work}/people --model.start null "
    "--model.trunk mobilenet_v3_large_075 --model.height 256 --model.width 320 --trainer.max_epochs 12 "
    "--data.examples_per_epoch 1280 --model.learning_rate 0.002 --data.train {crisp} --data.val {sparse}",
    "train detector --config {configs}/detector_people.yaml --out {work}/people-2 "
    "--model.start {work}/people/checkpoints/last.ckpt --model.teacher {models}/detector_figures.onnx "
    "--data.train {many} --data.val {sparse}",
    "export detector --checkpoint {work}/people-2/checkpoints/last.ckpt --float16 --height 480 --width 640 "
    "--calibrate {work}/rendered-sparse --out {models}/detector_people.onnx --training-data 'rendered people'",
)


def make_models(folder: Path, assets: Path | None = None) -> dict[str, Path]:
    """Run `COMMANDS`, and `RENDERED_COMMANDS` where there are assets; the models come to lie in ``folder``.

    Args:
        folder: for models and trainings.
        assets: as `simulate sprites` takes it, and perhaps ``photographs/``; without, there are drawn people alone.

    Raises:
        RequestError: the `train` extra or the assets are missing.
        RunError: a command failed.
    """
    from tsuiseki.tracking.cli import main

    if assets is not None:
        # What is missing is told before hours of training.
        Assets(assets)
        if _photographs(assets):
            Photographs(assets / "photographs")
    folder.mkdir(parents=True, exist_ok=True)
    for words in commands(folder, assets):
        print(f"$ tsuiseki {shlex.join(words)}", file=sys.stderr, flush=True)
        if main(words) != 0:
            raise RunError(f"`tsuiseki {' '.join(words[:2])}` failed; its message stands above")
    return {kind: folder / name for kind, name in (DRAWN if assets is None else SHIPPED).items()}


def commands(folder: Path, assets: Path | None = None) -> list[list[str]]:
    """The words of the commands for models in ``folder``, with people rendered of ``assets`` if there are any."""
    work = folder / "training"
    rendered = partial(_rendered, work, assets)
    small = rendered("towns-900", 900, 121, town=True)
    large = rendered("towns-1280x960", 640, 321, town=True, size=(1280, 960))
    many = [
        rendered("things-varied", 1300, 777, town=True, things=True) | {"share": 0.35},
        small | {"share": 0.25},
        large | {"share": 0.2},
        rendered("things-near", 450, 221, "near", town=True, things=True) | {"share": 0.08},
        {"folder": str(work / "drawn"), "generate": 700, "seed": 11, "size": [640, 480], "share": 0.12},
    ]
    pictures = {
        "pictures": [rendered("rendered-pictures", 1900, 21)],
        "sparse": [rendered("rendered-sparse", 80, 41, "sparse")],
        "towns": [rendered("towns-pictures", 1400, 121, town=True)],
        "sparse_towns": [rendered("towns-sparse", 80, 141, "sparse", town=True)],
        "crisp": [small | {"share": 0.6}, large | {"share": 0.4}],
        "many": many,
    }
    places = {
        "configs": str(resources.files("tsuiseki.configs")),
        "work": str(work),
        "models": str(folder),
        "assets": str(assets),
    } | {name: json.dumps(footage) for name, footage in pictures.items()}
    quoted = {name: shlex.quote(place) for name, place in places.items()}
    wanted = COMMANDS if assets is None else COMMANDS + RENDERED_COMMANDS
    return [shlex.split(command.format(**quoted)) for command in wanted]


def _rendered(
    work: Path,
    assets: Path | None,
    name: str,
    count: int,
    seed: int,
    scene: str = "varied",
    town: bool = False,
    things: bool = False,
    size: tuple[int, int] = (640, 480),
) -> dict[str, Any]:
    """Footage of rendered people as `train detector` takes it, before and among photographs where there are some."""
    footage: dict[str, Any] = {"folder": str(work / name), "generate": count, "scene": scene, "seed": seed}
    footage |= {"size": list(size), "sprites": str(work / "sprites")} | ({"town": True} if town else {})
    if assets is not None and _photographs(assets):
        footage["photographs"] = str(assets / "photographs")
        if things and (assets / "photographs" / "things").is_dir():
            footage["things"] = True
    return footage


def _photographs(assets: Path) -> bool:
    return (assets / "photographs").is_dir()
