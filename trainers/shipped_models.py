"""The commands that make the shipped models, as they stand in `docs/training.md`."""

from __future__ import annotations

import shlex
import sys
from importlib import resources
from pathlib import Path

from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.pipelines.people.demo import STREET_MODELS

SHIPPED = {kind: f"{name}.onnx" for kind, name in STREET_MODELS.items()}

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


def make_models(folder: Path) -> dict[str, Path]:
    """Run `COMMANDS`; the models come to lie in ``folder``.

    Raises:
        RequestError: the `train` extra is missing.
        RunError: a command failed.
    """
    from tsuiseki.tracking.cli import main

    folder.mkdir(parents=True, exist_ok=True)
    for words in commands(folder):
        print(f"$ tsuiseki {shlex.join(words)}", file=sys.stderr, flush=True)
        if main(words) != 0:
            raise RunError(f"`tsuiseki {' '.join(words[:2])}` failed; its message stands above")
    return {kind: folder / name for kind, name in SHIPPED.items()}


def commands(folder: Path) -> list[list[str]]:
    """The words of `COMMANDS` for models in ``folder``."""
    places = {
        "configs": shlex.quote(str(resources.files("tsuiseki.configs"))),
        "work": shlex.quote(str(folder / "training")),
        "models": shlex.quote(str(folder)),
    }
    return [shlex.split(command.format(**places)) for command in COMMANDS]
