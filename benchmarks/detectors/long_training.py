"""The long training of one detector of people who stand, sit, fall and lie: steps, fixed sets, and the curve.

    python -m benchmarks.detectors.long_training run --until 16:50 [--option=--data.batches=100 ...]
    python -m benchmarks.detectors.long_training validate FILE [FILE ...]
    python -m benchmarks.detectors.long_training plot --out curve.png

A fresh machine needs the repository, the rendered people (configs/detector_everyday.yaml and `fixed_sets` say how), and
the real sets in ``--data``. ``run`` goes on from the shipped default, and a better file takes its place: the pages must
follow. A step is a run of configs/detector_everyday.yaml of another seed, which teaches the branch; each ``--option``
changes it. An interrupted step goes on from its last epoch. The number that must rise is ``score`` of
`fixed_sets`; no number of its parts may fall by more than .01.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import onnx
import yaml

from benchmarks.detectors.fixed_sets import FALSE, PARTS, scores_of
from benchmarks.long_training import LongTraining, command, draw_curve, next_time
from tsuiseki import configs
from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.onnx import METADATA_KEY, ModelCard
from tsuiseki.tracking.weights import PEOPLE_DETECTOR, shipped
from tsuiseki.trainers.detector import Detector
from tsuiseki.trainers.exporting.exported_weights import calibrate, calibration_of, layout_of, opened_onnx

BEST, RECORD = shipped(PEOPLE_DETECTOR), Path(__file__).with_name("detector_everyday.jsonl")
CONFIG = Path(str(configs.__path__[0])) / "detector_everyday.yaml"
# Steps before, whose pictures a step learns from again.
EARLIER = 2
# What the exported file takes, as the shipped default does, pixels.
HEIGHT, WIDTH = 480, 640
# Added to the logits of the branch: real places hold more that looks like a person who sits than generated ones do.
# Chosen of -0.5 to -1.5 on PETS 1-300 and MOT17-13: the least that costs PETS .001 and MOT17-13 .011 of AP50.
REAL_SHIFT = -1.0
# Maps of a branch.
MAPS = 3


def main() -> None:
    """Do what the words ask for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run", "validate", "plot"))
    parser.add_argument("files", type=Path, nargs="*")
    parser.add_argument("--until", type=next_time, default="23:59", help="no step begins after the next time HH:MM")
    parser.add_argument("--option", action="append", default=[], help="of `tsuiseki train detector`, behind =")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--sprites", type=Path, default=Path("out/cache/sprites-val"))
    parser.add_argument("--work", type=Path, default=Path("out/train/detector_everyday"))
    parser.add_argument("--out", type=Path, default=Path("out/detector_everyday.png"))
    words = parser.parse_args()
    if words.what == "validate":
        print(table(words.files, words.data, words.sprites))
    elif words.what == "plot":
        draw_curve(
            RECORD,
            ("score", "PETS 1-300 AP75", "MOT17-13 AP50", "recall lying", "recall half to three quarters"),
            words.out,
        )
    else:
        training(words.data, words.sprites, words.option).run(words.work, words.until)


def training(data: Path, sprites: Path, options: Sequence[str]) -> LongTraining:
    """The long training, from the best file so far."""

    def fit(best: Sequence[Path], work: Path, number: int) -> list[Path]:
        last = work / "checkpoints" / "last.ckpt"
        go_on = ["--ckpt_path", str(last)] if last.is_file() else ["--overwrite", "true"]
        start = work / "start.onnx"
        uncalibrated(best[0]).export(start, overwrite=True)
        command([
            "train", "detector", "--config", str(CONFIG), "--out", str(work), *go_on,
            "--model.start", str(start), "--data.seed", str(number), "--data.train", json.dumps(sources(number)),
            *options,
        ])  # fmt: skip
        out = work / "detector.onnx"
        command([
            "export", "detector", "--checkpoint", str(last), "--float16",
            "--height", str(HEIGHT), "--width", str(WIDTH), "--calibrate", calibration(), "--out", str(out),
            "--training-data", "rendered people", "--licence", "Apache-2.0",
        ])  # fmt: skip
        finish_branch(out, REAL_SHIFT, layout_of(best[0]).card)
        return [out]

    def score(files: Sequence[Path]) -> dict[str, float]:
        return scores_of(files[0], data, sprites)

    return LongTraining([BEST], RECORD, "score", PARTS, [FALSE], fit, score)


def uncalibrated(file: Path) -> Detector:
    """The exported detector with scores of its branch as they were learnt, which are overlaps and no probabilities.

    A calibration left in the weights is what the loss first takes out again; it doubles the loss at the start.
    """
    module = Detector(start=file, architecture="branched")
    scale, shift = layout_of(file).card.settings["branch_calibration"]
    calibrate(module.network.branch.state_dict(), 1 / scale, -shift / scale, 1)
    return module


def finish_branch(file: Path, shift: float, start: ModelCard) -> None:
    """Add ``shift`` to the logits of the branch of an exported detector, in place.

    Its card says, as that of its ``start``, how the scores of the detector of people were calibrated.
    """
    model, card = opened_onnx(file)
    shifted = 0
    for tensor in model.graph.initializer:
        if re.fullmatch(r"detector\.branch\.class_heads\.\d\.1\.bias(_half)?", tensor.name):
            bias = onnx.numpy_helper.to_array(tensor).copy()
            bias.reshape(-1, 2)[:, 1] += shift
            tensor.CopyFrom(onnx.numpy_helper.from_array(bias, tensor.name))
            shifted += 1
    if shifted != MAPS:
        raise RunError(f"{file}: expected {MAPS} heads of a branch, found {shifted}")
    scale, before = card.settings["branch_calibration"]
    said = {"branch_calibration": [scale, before + shift], "people_calibration": list(calibration_of(start))}
    card = dataclasses.replace(card, settings={**card.settings, **said})
    onnx.helper.set_model_props(model, {METADATA_KEY: card.to_json()})
    onnx.save(model, file)


def sources(number: int) -> list[dict[str, Any]]:
    """What the step of this number learns from: pictures as the configuration's, of it and of `EARLIER` steps."""
    steps = range(max(number - EARLIER, 1), number + 1)
    return [
        source | {"folder": f"{source['folder']}-{step}", "seed": 1000 * source["seed"] + step}
        for source in _data("train") for step in steps
    ]  # fmt: skip


def calibration() -> str:
    """The folder of pictures that scores are calibrated on: those that the configuration validates on."""
    return str(_data("val")[0]["folder"])


def _data(part: str) -> list[dict[str, Any]]:
    sources: list[dict[str, Any]] = yaml.safe_load(CONFIG.read_text())["data"][part]
    return sources


def table(files: Sequence[Path], data: Path, sprites: Path) -> str:
    """A line a number, a column a file."""
    columns = [scores_of(file, data, sprites) for file in files]
    head = f"{'':34}" + " ".join(f"{file.stem[-16:]:>16}" for file in files)
    rows = (f"{name:34}" + " ".join(f"{column[name]:16.3f}" for column in columns) for name in columns[0])
    return "\n".join([head, *rows])


if __name__ == "__main__":
    main()
