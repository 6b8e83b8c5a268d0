"""One call for each network: from a folder of labels to an exported file, as the commands with ``--data`` do."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

from tsuiseki.tracking.errors import RunError, a_path
from tsuiseki.tracking.features.action import STREAMS


def train_detector(
    train: str | Path,
    out: str | Path,
    *,
    start: str | Path = "people",
    classes: Sequence[str] | None = None,
    epochs: int = 5,
    batches: int = 60,
    seed: int = 0,
    overwrite: bool = False,
) -> Path:
    """Train a detector on labelled video, as ``tsuiseki train detector --data FOLDER`` does.

    The last tenth of each video chooses the best epoch, the start among them, and scores it.

    Args:
        train: labelled video of any layout that is read.
        out: folder for checkpoints, logs and the exported detector.
        start: name of a shipped detector, exported detector or checkpoint that learns on.
        classes: names of those to learn, as the labels call them; by default all that they name, else people.
        epochs: of the training.
        batches: steps of an epoch, of 8 pictures each.
        seed: of everything random.
        overwrite: replace a training in the folder.

    Returns:
        The exported detector, for `tsuiseki.Detector` and ``--detector``.

    Raises:
        RequestError: unusable labels, or a folder that already holds a training.
        RunError: no epoch was finished.
    """
    from tsuiseki.trainers.fit import fit_detector

    words = [f"--model.start={start}"]
    words += [] if classes is None else [f"--model.classes={json.dumps(list(classes))}"]
    return _trained(fit_detector, train, out, "detector.onnx", epochs, batches, seed, overwrite, words)


def train_appearance(
    train: str | Path,
    out: str | Path,
    *,
    start: str | Path = "people",
    epochs: int = 10,
    batches: int = 60,
    seed: int = 0,
    overwrite: bool = False,
) -> Path:
    """Train an appearance network on labelled video with ids, as ``tsuiseki train appearance --data FOLDER`` does.

    The last tenth of the people chooses the best epoch. Arguments and errors are those of `train_detector`.

    Returns:
        The exported network, for `tsuiseki.Appearance` and ``--appearance``.
    """
    from tsuiseki.trainers.fit import fit_appearance

    words = [f"--model.start={start}"]
    return _trained(fit_appearance, train, out, "appearance.onnx", epochs, batches, seed, overwrite, words)


def train_action(
    train: str | Path,
    out: str | Path,
    *,
    start: str | Path = "drone",
    epochs: int = 10,
    batches: int = 100,
    seed: int = 0,
    overwrite: bool = False,
) -> list[Path]:
    """Train action streams on clips labelled with actions, as ``tsuiseki train action --data FOLDER`` does.

    The last tenth of the clips chooses the best epoch. Arguments and errors are those of `train_detector`.

    Returns:
        The exported streams, a file each, for ``--actions``.
    """
    from tsuiseki.trainers.fit import fit_action

    words = [f"--model.start={start}"]
    path = _trained(fit_action, train, out, "action.onnx", epochs, batches, seed, overwrite, words)
    return [file for name in STREAMS if (file := path.with_name(f"action_{name}.onnx")).is_file()]


def train_association(
    train: str | Path,
    out: str | Path,
    *,
    detections: Literal["given", "simulated"] = "given",
    epochs: int = 6,
    batches: int = 20,
    seed: int = 0,
    overwrite: bool = False,
) -> Path:
    """Train the costs of the flow on labelled sequences, as ``tsuiseki train association --data FOLDER`` does.

    The last fifth of each sequence chooses the best epoch. Arguments and errors are those of `train_detector`.

    Args:
        detections: ``given`` takes det/det.txt of each sequence; ``simulated`` draws faulty ones from the labels.

    Returns:
        The exported costs, for ``--affinity``.
    """
    from tsuiseki.trainers.fit import fit_association

    words = [f"--data.detections={detections}"]
    return _trained(fit_association, train, out, "association.onnx", epochs, batches, seed, overwrite, words)


def _trained(
    fit: Callable[[Sequence[str]], Path | None],
    train: str | Path,
    out: str | Path,
    name: str,
    epochs: int,
    batches: int,
    seed: int,
    overwrite: bool,
    words: Sequence[str],
) -> Path:
    """The exported file of this ``name``."""
    folder = a_path(out, "out")
    options = {"out": folder, "overwrite": overwrite, "seed_everything": seed, "data.seed": seed}
    options |= {"trainer.max_epochs": epochs, "data.batches": batches}
    given = [f"--{option}={value}" for option, value in options.items()]
    if fit(["--data", str(a_path(train, "train")), *given, *words]) is None:
        raise RunError(f"expected a finished epoch of the training in {folder}, found none")
    return folder / name
