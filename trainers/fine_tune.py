"""`tsuiseki train detector --data FOLDER`: from the shipped detector to one of your own, scored on a held-out tenth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jsonargparse import Namespace

from tsuiseki.datamodules.labelled_images import LabelledFrame, LabelledPart, held_out, labelled_images
from tsuiseki.datamodules.video_pictures import read_image
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.detection import evaluate_classes
from tsuiseki.tracking.features.exported import Detector
from tsuiseki.tracking.formats.label_checks import PEOPLE, same_class
from tsuiseki.tracking.formats.labelled import open_labelled
from tsuiseki.tracking.onnx import OnnxModel
from tsuiseki.tracking.types.class_choice import ClassChoice
from tsuiseki.tracking.weights import shipped_or_file
from tsuiseki.trainers.detector_labels import LOWEST_SCORE, anchor_choice
from tsuiseki.trainers.detector_network import USUAL, detector_parts


@dataclass(frozen=True)
class Recipe:
    """How a detector learns from another one.

    Attributes:
        start: the detector that it starts from.
        classes: names of those that it learns.
        held_out: pictures that score it.
        val_share: of each video, those pictures.
    """

    start: Path
    classes: list[str]
    held_out: list[LabelledFrame]
    val_share: float


def complete_options(options: Namespace, folder: Path) -> Recipe:
    """Fill in classes and anchors where the labels decide them.

    Args:
        options: of the command, changed in place.
        folder: labelled video of any layout, see `open_labelled`.

    Raises:
        RequestError: unusable labels.
    """
    model, share = options.model, options.data.val_share
    if options.data.val is not None:
        raise RequestError(
            "expected no `data.val` beside --data FOLDER, of which the last part validates; set `data.val_share`, or "
            "give a --config"
        )
    model.classes = classes = model.classes or classes_of(folder)
    print(f"learning {', '.join(classes)}", flush=True)
    start = shipped_or_file("detector", model.start)
    asked = {name: getattr(model, name, None) for name in ("architecture", "height", "width")}
    parts = detector_parts({**dict.fromkeys(USUAL), **asked}, None, start)
    learnt, held = held_out([LabelledPart(str(folder))], share)
    later = labelled_images(folder, part=held[0].part, classes=classes)
    if model.anchors is None and parts["architecture"] != "branched":
        labels = labelled_images(folder, part=learnt[0].part, classes=classes)
        anchors, line = anchor_choice(labels, parts["anchors"], (parts["height"], parts["width"]))
        model.anchors = [[list(size) for size in level] for level in anchors]
        print(line, flush=True)
    return Recipe(start, classes, later, share)


def classes_of(folder: Path) -> list[str]:
    """Names of the classes to learn: all where the labels name their own, else people.

    Of the layout of a benchmark people alone are learnt.

    Args:
        folder: labelled video of any layout, see `open_labelled`.
    """
    named = {
        number: name
        for video in open_labelled(folder)
        if video.labelled_classes
        for number, name in video.classes.items()
    }
    return list(dict.fromkeys(named[number] for number in sorted(named))) or [PEOPLE]


def compared(files: dict[str, Path], held_out: Sequence[LabelledFrame], classes: Sequence[str], epoch: int) -> str:
    """A line on the average precision of detectors, its mean over classes and each, on pictures that none learnt from.

    Args:
        files: exported detectors by name, among them ``shipped`` and ``yours``; their classes are those of the labels
            by their names.
        held_out: the pictures, which chose the epoch.
        classes: that are scored.
        epoch: that was chosen; 0 for the start.
    """
    boxes = [frame.boxes for frame in held_out]
    labels = [np.where(frame.ignored, -1, frame.classes) for frame in held_out]
    values: dict[str, tuple[float, float]] = {}
    apart: dict[str, str] = {}
    for name, file in files.items():
        class_names = OnnxModel(file, "detector").card.class_names
        places = [
            next((k for k, kind in enumerate(classes, start=1) if same_class(kind, name_in_file)), 0)
            for name_in_file in class_names
        ]
        detector = Detector(file, LOWEST_SCORE, classes=ClassChoice(class_names))
        detected = [detector.detect([read_image(frame.picture)])[0] for frame in held_out]
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
    chosen = f"epoch {epoch}" if epoch else "the start, as no epoch was better"
    return f"on {len(held_out)} held-out pictures, which chose {chosen}: {lines}{advice}"
