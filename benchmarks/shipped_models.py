"""The commands that make the shipped models: hours of training, from a checkout with the train extra.

python -m benchmarks.shipped_models --out DIR [--assets DIR]
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import yaml

from tsuiseki.datamodules.scenes.figures.assets import Assets
from tsuiseki.datamodules.scenes.render.photographs import Photographs
from tsuiseki.tracking.demo.page import STREET_MODELS
from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.weights.listing import LICENCE

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
    # Costs of the thesis's flow as printed.
    "train affinity --folders {work}/streets --detector {models}/detector_street.onnx --features thesis "
    "--appearance {models}/appearance_people.onnx --out {models}/affinity_printed_people.onnx",
)
# {assets}: bodies and clothes; {pictures}, {sparse}, {towns}, {sparse_towns}, {crisp}, {many}, {sunlit}, {silhouettes},
# {everyday}: what is rendered of them, as `data.train` and `data.val` of the configurations name it.
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
    "export detector --checkpoint {work}/rendered-3/checkpoints/last.ckpt --float16 "
    "--calibrate {work}/rendered-640x480-sparse --out {work}/rendered.onnx",
    "train detector --config {configs}/detector_towns.yaml --out {work}/towns --model.start {work}/rendered.onnx "
    "--data.train {towns} --data.val {sparse_towns}",
    "export detector --checkpoint {work}/towns/checkpoints/epoch=3.ckpt "
    "--blend {work}/rendered.onnx --float16 --height 672 --width 896 --calibrate {work}/rendered-640x480-sparse "
    "--out {models}/detector_figures.onnx --training-data 'rendered people'",
    "train detector --config {configs}/detector_rendered.yaml --out {work}/people --model.start null "
    "--model.trunk mobilenet_v3_large_075 --model.height 256 --model.width 320 --trainer.max_epochs 12 "
    "--data.batches 80 --model.learning_rate 0.002 --data.train {crisp} --data.val {sparse}",
    "train detector --config {configs}/detector_people.yaml --out {work}/people-2 "
    "--model.start {work}/people/checkpoints/last.ckpt --model.teacher.file {models}/detector_figures.onnx "
    "--data.train {many} --data.val {sparse}",
    "export detector --checkpoint {work}/people-2/checkpoints/last.ckpt --float16 --height 480 --width 640 "
    "--calibrate {work}/rendered-640x480-sparse --out {work}/people-2.onnx",
    "train detector --config {configs}/detector_people_sunlit.yaml --out {work}/people-silhouettes "
    "--model.start {work}/people-2.onnx --data.train {silhouettes} --data.val {sparse}",
    "export detector --checkpoint {work}/people-silhouettes/checkpoints/last.ckpt --float16 --height 480 --width 640 "
    "--calibrate {work}/rendered-640x480-sparse --out {work}/people-silhouettes.onnx",
    "train detector --config {configs}/detector_people_sunlit.yaml --out {work}/people-3 "
    "--model.start {work}/people-2.onnx --data.train {sunlit} --data.val {sparse}",
    "export detector --checkpoint {work}/people-3/checkpoints/last.ckpt --blend {work}/people-silhouettes.onnx "
    "--float16 --height 480 --width 640 --calibrate {work}/rendered-640x480-sparse "
    "--out {work}/people-3.onnx --training-data 'rendered people'",
    # `python -m benchmarks.detectors.long_training` teaches the branch on, and makes its scores more careful.
    "simulate sprites --assets {assets} --people 240 --views 10 --poses 0.65 --tilts=-0.1,1.5 --seed 6263 "
    "--out {work}/sprites-posed",
    "train detector --config {configs}/detector_everyday.yaml --out {work}/people-4 "
    "--model.start {work}/people-3.onnx --data.train {everyday} --data.val {sparse}",
    "export detector --checkpoint {work}/people-4/checkpoints/last.ckpt --float16 --height 480 --width 640 "
    "--calibrate {work}/rendered-640x480-sparse --out {models}/detector_people.onnx --training-data 'rendered people'",
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
        # What is missing is reported before hours of training.
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
    many = _sources("detector_people", "train", work, assets)
    sunlit = _sources("detector_people_sunlit", "train", work, assets)
    pictures = {
        "pictures": _sources("detector_rendered", "train", work, assets),
        "sparse": _sources("detector_rendered", "val", work, assets),
        "towns": _sources("detector_towns", "train", work, assets),
        "sparse_towns": _sources("detector_towns", "val", work, assets),
        "crisp": [source | {"share": share} for source, share in zip(many[1:3], (0.6, 0.4), strict=True)],
        "many": many,
        "sunlit": sunlit,
        "everyday": _sources("detector_everyday", "train", work, assets),
        "silhouettes": [
            source | {"boxes": "silhouettes", "folder": str(work / Path(source["folder"]).name.removeprefix("steady-"))}
            for source in sunlit
        ],
    }
    places = {
        "configs": str(resources.files("tsuiseki.configs")),
        "work": str(work),
        "models": str(folder),
        "assets": str(assets),
    } | {name: json.dumps(sources) for name, sources in pictures.items()}
    quoted = {name: shlex.quote(place) for name, place in places.items()}
    commands_to_run = COMMANDS if assets is None else COMMANDS + RENDERED_COMMANDS
    words = [shlex.split(command.format(**quoted)) for command in commands_to_run]
    licensed = ("export", "detector"), ("export", "appearance"), ("export", "action")
    return [line + ["--licence", LICENCE] * (tuple(line[:2]) in licensed) for line in words]


def _sources(config: str, part: Literal["train", "val"], work: Path, assets: Path | None) -> list[dict[str, Any]]:
    """``data.train`` or ``data.val`` of a configuration, its folders in ``work``, photographs where there are some."""
    photographs = None if assets is None or not _photographs(assets) else assets / "photographs"
    sources: list[dict[str, Any]]
    sources = yaml.safe_load((resources.files("tsuiseki.configs") / f"{config}.yaml").read_text())["data"][part]
    for source in sources:
        for what in {"folder", "sprites"} & source.keys():
            source[what] = str(work / Path(source[what]).name)
        if "photographs" in source:
            source["photographs"] = "" if photographs is None else str(photographs)
        if "things" in source:
            source["things"] = photographs is not None and (photographs / "things").is_dir()
    return sources


def _photographs(assets: Path) -> bool:
    return (assets / "photographs").is_dir()


def main() -> None:
    """Make the models that the words ask for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder for models and trainings")
    parser.add_argument("--assets", type=Path, help="bodies and clothes (docs/methods/rendered-people.md), and perhaps "
                        "photographs/; without them the detector learns from drawn people alone")  # fmt: skip
    words = parser.parse_args()
    for kind, path in make_models(words.out, words.assets).items():
        print(f"{kind}: {path}")


if __name__ == "__main__":
    main()
