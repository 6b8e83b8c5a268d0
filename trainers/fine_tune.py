"""`tsuiseki train detector --data FOLDER`: from the shipped detector to one of your own, scored on a held-out tenth."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np

from tsuiseki.datamodules.labelled_images import LabelledFrame, labelled_images, read_image
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.detection import evaluate_classes
from tsuiseki.tracking.features.exported import Detector
from tsuiseki.tracking.formats.label_checks import PEOPLE, same_class
from tsuiseki.tracking.formats.labelled import open_labelled
from tsuiseki.tracking.formats.yolo import ABOUT
from tsuiseki.tracking.openers.yaml_files import read_yaml, yaml_of
from tsuiseki.tracking.types.class_choice import ClassChoice
from tsuiseki.tracking.weights import LEARNING_DETECTOR, shipped
from tsuiseki.trainers.detector_labels import LOWEST_SCORE, anchor_choice
from tsuiseki.trainers.exporting.export import ModelFile
from tsuiseki.trainers.exporting.export_networks import export_detector

CONFIG = "detector_fine_tune.yaml"
# Share of each video, in the order of time, that is learnt from.
LEARNT = (0.0, 0.9)
# Share of each video, in the order of time, that scores the result.
HELD_OUT = (0.9, 1.0)


def fine_tune(arguments: Sequence[str], folder: Path, fit: Callable[[Sequence[str]], Path | None]) -> Path | None:
    """Train from the shipped detector on nine tenths of each video, export the last, and score it on the last tenth.

    The held-out tenth chooses nothing, so that its scores tell what to expect.

    Args:
        arguments: of the command, without ``--data FOLDER``; those given win over the usual ones.
        folder: labelled video of any layout, see `open_labelled`.
        fit: trains as arguments say.

    Returns:
        The last checkpoint; beside ``checkpoints/`` lies ``detector.onnx``.

    Raises:
        RequestError: unusable labels or arguments.
    """
    classes = classes_of(folder, arguments)
    print(f"learning {', '.join(classes)}", flush=True)
    held_out = labelled_images(folder, part=HELD_OUT, classes=classes)
    start = shipped(LEARNING_DETECTOR)
    config = resources.files("tsuiseki.configs") / CONFIG
    model = read_yaml(Path(str(config)), "options of training")["model"]
    anchors, line = anchor_choice(
        labelled_images(folder, part=LEARNT, classes=classes), model["anchors"], (model["height"], model["width"])
    )
    print(line, flush=True)
    usual = [
        f"--config={config}",
        f"--model.start={start}",
        f"--model.classes={json.dumps(classes)}",
        f"--model.anchors={json.dumps(anchors)}",
        *(
            f"--data.{name}={json.dumps([{'folder': str(folder), 'part': part}])}"
            for name, part in (("train", LEARNT), ("val", HELD_OUT))
        ),
    ]
    best = fit([*usual, *arguments])
    if best is None:
        return None
    last, out = best.with_name("last.ckpt"), best.parent.parent / "detector.onnx"
    export_detector(
        ModelFile(out=out, training_data=f"{folder.name}, {LEARNT[1]:.0%} of each video", overwrite=True), last
    )
    print(_compared({"shipped": start, "yours": out}, held_out, classes))
    return last


def classes_of(folder: Path, arguments: Sequence[str] = ()) -> list[str]:
    """Names of the classes to learn: those that ``--model.classes`` names, or all where the labels name their own.

    Of the layout of a benchmark people alone are learnt.

    Args:
        folder: labelled video of any layout, see `open_labelled`.
        arguments: of the command.
    """
    text, _ = option(arguments, "--model.classes")
    if text is not None:
        names = yaml_of(text, "`model.classes`", "names such as [person,car]")
        if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
            raise RequestError(f"`model.classes`: expected names such as [person,car], got {text or 'nothing'}")
        return names
    named = {
        number: name
        for video in open_labelled(folder)
        if video.labelled_classes
        for number, name in video.classes.items()
    }
    return list(dict.fromkeys(named[number] for number in sorted(named))) or [PEOPLE]


def _compared(files: dict[str, Path], held_out: Sequence[LabelledFrame], classes: Sequence[str]) -> str:
    """A line on the average precision of detectors, its mean over classes and each, on pictures that none learnt from.

    A detector's classes are those of the labels by their names.
    """
    boxes = [frame.boxes for frame in held_out]
    labels = [np.where(frame.ignored, -1, frame.classes) for frame in held_out]
    values: dict[str, tuple[float, float]] = {}
    apart: dict[str, str] = {}
    for name, file in files.items():
        class_names = Detector(file).model.card.class_names
        places = [
            next((k for k, kind in enumerate(classes, start=1) if same_class(kind, name_in_file)), 0)
            for name_in_file in class_names
        ]
        detector = Detector(file, LOWEST_SCORE, classes=ClassChoice(class_names))
        detected = [detector.detect([read_image(frame.path)])[0] for frame in held_out]
        detections = [
            replace(of_frame, classes=np.array([0, *places])[of_frame.classes], names={}) for of_frame in detected
        ]
        by_class = [
            {
                k: of_class.average_precision
                for k, of_class in evaluate_classes(boxes, labels, detections, classes, iou).items()
            }
            for iou in (0.5, 0.75)
        ]
        fifty, strict = (float(np.mean([*of_classes.values()])) for of_classes in by_class)
        values[name] = fifty, strict
        of_classes = ", ".join(f"{kind} {value:.3f}" for kind, value in by_class[0].items())
        apart[name] = f" (AP50 {of_classes})" if len(by_class[0]) > 1 else ""
    better = sum(values["yours"]) > sum(values["shipped"])
    lines = "; ".join(f"{name} AP50 {a:.3f}, AP75 {b:.3f}{apart[name]}" for name, (a, b) in values.items())
    advice = "" if better else "; keep the shipped one, or train longer (--trainer.max_epochs) or on more labels"
    return f"on {len(held_out)} held-out pictures: {lines}{advice}"


def option(arguments: Sequence[str], name: str) -> tuple[str | None, list[str]]:
    """The value of an option, "" where none follows and None where it is not given; and the other arguments."""
    for number, word in enumerate(arguments):
        if word == name:
            return next(iter(arguments[number + 1 :]), ""), [*arguments[:number], *arguments[number + 2 :]]
        if word.startswith(f"{name}="):
            return word.partition("=")[2], [*arguments[:number], *arguments[number + 1 :]]
    return None, list(arguments)


def folder_of(arguments: Sequence[str]) -> tuple[Path | None, list[str]]:
    """The folder of labels that ``--data FOLDER`` names, and the other arguments; None for a YAML file of options.

    YOLO's ``data.yaml`` stands for its folder.

    Raises:
        RequestError: no folder follows.
    """
    value, words = option(arguments, "--data")
    if value == "":
        raise RequestError("expected a folder of labelled video after `data`, got nothing")
    folder = Path(value or "")
    if value is None or (folder.name != ABOUT and folder.suffix in (".yaml", ".yml")):
        return None, list(arguments)
    return folder.parent if folder.name == ABOUT else folder, words
