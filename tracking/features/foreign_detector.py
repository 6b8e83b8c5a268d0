"""Detectors that people already have: ONNX files of other projects, recognised by their inputs and outputs."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.devices import Device, device_of
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.features.detector_layouts import LAYOUTS, TENSORFLOW, Size, paired, with_probabilities
from tsuiseki.tracking.features.foreign_options import DetectorOptions, ImageInput, LayoutName, ScoreKind
from tsuiseki.tracking.features.layout_recognition import (
    BOX_NAMES,
    background_first,
    class_names,
    class_of_people,
    plain_name,
    possible_kinds,
    possible_layouts,
)
from tsuiseki.tracking.geometry import clip_boxes, suppress
from tsuiseki.tracking.onnx import byte_image_input, image_input, open_session, run_session
from tsuiseki.tracking.types import Detections, ImageArray

_MOST_CANDIDATES = 400
# A picture side for recognising networks that take any size.
_TRIAL_SIDE = 320


class ForeignDetector:
    """A detector of another project, exported to ONNX.

    Args:
        path: the ONNX file.
        score_threshold: detections below it are dropped; in [0, 1].
        iou_threshold: of the non-maximum suppression, where the network does none itself; in [0, 1].
        threads: CPU threads; 0 takes all cores.
        options: what the file does not tell.
        device: what to run on, see `opened_on`; afterwards what it runs on.

    Attributes:
        layout: that was recognised.
        person: number of the class of people, as the outputs count it.
        scores: what the class values are; None for layouts in which they can be but one thing.
        input: what becomes of a picture.

    Raises:
        RequestError: the file is no such detector, several layouts fit it, or its class of people is unknown.
    """

    def __init__(
        self,
        path: str | Path,
        score_threshold: float = 0.3,
        iou_threshold: float = 0.5,
        threads: int = 0,
        options: DetectorOptions | None = None,
        device: Device = "auto",
    ) -> None:
        options = options or DetectorOptions()
        self.path, self.score_threshold, self.iou_threshold = Path(path), score_threshold, iou_threshold
        self.session = open_session(path, threads, device)
        self.device = device_of(self.session)
        self.metadata: Mapping[str, str] = self.session.get_modelmeta().custom_metadata_map
        names = {plain_name(x.name): x.name for x in self.session.get_outputs()}
        self._tensorflow = names.keys() >= set(TENSORFLOW)
        if self._tensorflow:  # newer files give more beside them
            self._outputs = [names[name] for name in TENSORFLOW]
        else:  # boxes first: with four classes their shape does not tell them
            every = [x.name for x in self.session.get_outputs()]
            self._outputs = sorted(every, key=lambda name: name not in BOX_NAMES)
        self._check_task()
        self.size = self._input_size(options)
        self.names = options.classes or class_names(self.metadata)
        trial = self._try()
        self.layout = self._choose_layout(trial, options)
        self.input = _changed(self.path, LAYOUTS[self.layout].input, options, whole=self.size is None)
        self.scores = self._choose_scores(list(trial.values()), options)
        self.person = self._choose_person(list(trial.values()), options)
        self._gave: set[bool] = set()

    def __str__(self) -> str:
        """How the file is read, in words."""
        number = self.person - LAYOUTS[self.layout].first_class
        name = f" {self.names[number]!r}" if self.names and 0 <= number < len(self.names) else ""
        scores = "" if self.scores is None else f", scores by {self.scores}"
        size = "any size" if self.size is None else f"{self.size[1]}x{self.size[0]}"
        return f"layout {self.layout}, people are class {self.person}{name}{scores}; pictures {self.input}, {size}"

    @property
    def facts(self) -> dict[str, Any]:
        """How the file is read, as plain values by name."""
        chosen = {"layout": self.layout, "person": self.person, "classes": self.names, "scores": self.scores}
        return {**chosen, "size": self.size, **asdict(self.input)}

    @property
    def blank(self) -> bool:
        """Whether it has looked at pictures, and none gave anything but zeros or no rows."""
        return self._gave == {False}

    @property
    def input_size(self) -> Size | None:
        """Height and width of the input, pixels; None where it takes any."""
        return self.size

    def detect(self, images: Sequence[ImageArray]) -> list[Detections]:
        """People in ``images``, each ``(H, W, 3)`` uint8 RGB; boxes are cut off at the border.

        Raises:
            RunError: the network gives NaN or infinity, or nothing but zeros where every place has
                a row.
        """
        if not images:
            return []
        fitted = [self.input.fit(image, self.size or image.shape[:2]) for image in images]
        outputs = self._run([image for image, _ in fitted])
        return [
            self._decode(outputs[n], fitted[n][0].shape[:2], fitted[n][1], images[n].shape[:2])
            for n in range(len(images))
        ]

    def _decode(
        self, outputs: Sequence[NDArray[Any]], fitted: Size, scale: tuple[float, float], size: Size
    ) -> Detections:
        self._check_values(outputs)
        if self.scores is not None:
            outputs = with_probabilities(outputs, self.scores)
        boxes, scores = LAYOUTS[self.layout].read(outputs, fitted, self.person)
        good = np.flatnonzero((scores >= self.score_threshold) & (scores > 0))
        good = good[np.argsort(-scores[good], kind="stable")][:_MOST_CANDIDATES]
        boxes, scores = clip_boxes(boxes[good] / np.tile(scale, 2), size[1], size[0]), scores[good].clip(0, 1)
        whole = ((boxes[:, 2:] - boxes[:, :2]) >= 1).all(axis=1)
        boxes, scores = boxes[whole], scores[whole]
        if not LAYOUTS[self.layout].suppressed:
            kept = suppress(boxes, scores, self.iou_threshold)
            boxes, scores = boxes[kept], scores[kept]
        return Detections(boxes, scores)

    def _run(self, images: Sequence[ImageArray]) -> list[list[NDArray[Any]]]:
        """Outputs of each picture without their batch axis; all in one call where the file takes any batch."""
        several = self._batched and isinstance(self._wanted.shape[0], str) and len(images) > 1
        if several and len({image.shape for image in images}) == 1:
            whole = self._call(np.stack(images))
            if all(len(x) == len(images) for x in whole):
                return [[x[n] for x in whole] for n in range(len(images))]
        return [[_single(x) for x in self._call(image[None])] for image in images]

    def _call(self, images: NDArray[np.uint8]) -> list[NDArray[Any]]:
        values = self.input.normalise(images, self._wanted.dtype)
        inputs: dict[str, NDArray[Any]] = {self._wanted.name: values if self._batched else values[0]}
        for other in self.session.get_inputs():
            if other.name != self._wanted.name:  # RT-DETR asks for the size that its boxes are to be in
                inputs[other.name] = np.tile(np.array(images.shape[2:0:-1], dtype=np.int64), (len(images), 1))
        return run_session(self.session, self.path, inputs, self._outputs)

    def _check_task(self) -> None:
        task = self.metadata.get("task", "detect")
        if task != "detect":
            raise RequestError(f"{self.path}: expected a detector, got a network for {task!r}; export one for 'detect'")

    def _input_size(self, options: DetectorOptions) -> Size | None:
        """Height and width, or None for a network of torchvision's or TensorFlow's kind, which takes any."""
        self._wanted = (byte_image_input if self._tensorflow else image_input)(self.session, self.path)
        self._batched = len(self._wanted.shape) == 4
        sides = self._wanted.shape[1:3] if self._tensorflow else self._wanted.shape[-2:]
        height, width = (x if isinstance(x, int) else None for x in sides)
        told = _told_size(self.metadata)
        height = height or options.height or (told[0] if told else None)
        width = width or options.width or (told[1] if told else None)
        if height and width:
            return height, width
        if self._tensorflow or len(self.session.get_outputs()) == 3:
            return None
        raise RequestError(
            f"{self.path}: height and width of its input are open and its metadata do not tell them; "
            "give `detector_options.height` and `detector_options.width`, or export with fixed ones"
        )

    def _try(self) -> dict[str, NDArray[Any]]:
        """Outputs by name for a noise picture."""
        self.input = ImageInput("as-is", raw_nhwc=self._tensorflow)
        size = self.size or (_TRIAL_SIDE, _TRIAL_SIDE)
        noise = np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8)
        outputs = dict(zip(self._outputs, self._run([noise])[0], strict=True))
        if not _finite(list(outputs.values())):
            raise RequestError(
                f"{self.path}: its outputs for a picture of noise are NaN or infinite; export it again in float32"
            )
        return outputs

    def _choose_layout(self, trial: Mapping[str, NDArray[Any]], options: DetectorOptions) -> LayoutName:
        size = self.size or (_TRIAL_SIDE, _TRIAL_SIDE)
        found = possible_layouts(trial, size, len(self.names) if self.names else None)
        if options.layout is not None:
            if options.layout == "tensorflow" and not self._tensorflow:
                raise RequestError(
                    f"{self.path}: layout tensorflow asks for outputs {', '.join(TENSORFLOW)}, got {_shapes(trial)}; "
                    "convert it again with these outputs"
                )
            if options.layout not in found and not _readable(options.layout, trial, size):
                raise RequestError(
                    f"{self.path}: its outputs {_shapes(trial)} are not {LAYOUTS[options.layout].description}, "
                    f"as layout {options.layout} asks for"
                )
            return options.layout
        if len(found) == 1:
            return found[0]
        if not found:
            raise RequestError(
                f"{self.path}: its outputs {_shapes(trial)} are of no known layout; known are {', '.join(LAYOUTS)}"
            )
        fitting = " or ".join(f"{name} {LAYOUTS[name].description}" for name in found)
        raise RequestError(
            f"{self.path}: its outputs {_shapes(trial)} could be {fitting}; say which with `detector_options.layout`"
        )

    def _choose_scores(self, trial: Sequence[NDArray[Any]], options: DetectorOptions) -> ScoreKind | None:
        if not LAYOUTS[self.layout].paired:
            if options.scores is not None:
                raise RequestError(
                    f"{self.path}: the scores of layout {self.layout} can be but one thing; leave "
                    "`detector_options.scores` out"
                )
            return None
        classes = paired(trial)[1]
        found = possible_kinds(classes, len(self.names) if self.names else None)
        if options.scores is not None:
            if options.scores == "probabilities" and found != ["probabilities"]:
                raise RequestError(
                    f"{self.path}: expected probabilities, got class values from {classes.min():.3g} to "
                    f"{classes.max():.3g}; give `detector_options.scores` as sigmoid or softmax"
                )
            return options.scores
        if len(found) == 1:
            return found[0]
        raise RequestError(
            f"{self.path}: its class values could be logits of a {' or of a '.join(found)}; say which with "
            "`detector_options.scores`"
        )

    def _choose_person(self, trial: Sequence[NDArray[Any]], options: DetectorOptions) -> int:
        columns = LAYOUTS[self.layout].classes(trial) or (len(self.names) if self.names else None)
        if self.scores != "softmax" or columns is None:
            first = LAYOUTS[self.layout].first_class if options.person is None else 0
            return first + class_of_people(self.path, self.names, columns, options.person)
        # One class is "no object": the last one, or as in SSD the first, which COCO's own numbers count, too.
        if not background_first(paired(trial)[1]):
            return class_of_people(self.path, self.names, columns - 1, options.person)
        if options.person is None and self.names and len(self.names) < columns:
            return 1 + class_of_people(self.path, self.names, columns - 1, None)
        return class_of_people(self.path, self.names, columns, options.person)

    def _check_values(self, outputs: Sequence[NDArray[Any]]) -> None:
        # TensorFlow tells how many rows it fills even where all of their scores are zero.
        told = outputs[2:3] if self.layout == "tensorflow" else outputs
        floats = [x for x in told if np.issubdtype(x.dtype, np.floating)]
        if not _finite(outputs):
            raise RunError(
                f"{self.path}: the network gives NaN or infinity; check its normalisation, or export it in float32"
            )
        blank = not any(x.any() for x in floats)
        # Rows of zeros fill up, or there are no rows where nothing is found.
        if blank and self.layout not in ("yolo-suppressed", "tensorflow") and all(x.size for x in floats):
            raise RunError(f"{self.path}: the network gives nothing but zeros; export it again")
        self._gave.add(not blank)


def _changed(path: Path, usual: ImageInput, options: DetectorOptions, *, whole: bool) -> ImageInput:
    names = ("resize", "colour", "pixels", "mean", "std")
    told = [name for name in names[2:] if getattr(options, name) is not None]
    if usual.raw_nhwc and told:
        raise RequestError(
            f"{path}: the network takes bytes and normalises them itself; leave `detector_options.{told[0]}` out"
        )
    given: dict[str, Any] = {"resize": "as-is"} if whole else {}
    given |= {name: value for name in names if (value := getattr(options, name)) is not None}
    return replace(usual, **given)


def _told_size(metadata: Mapping[str, str]) -> Size | None:
    """Height and width that the metadata tell (``imgsz``)."""
    try:
        size = ast.literal_eval(metadata["imgsz"])
        height, width = (size, size) if isinstance(size, int) else size
        return int(height), int(width)
    except (KeyError, ValueError, SyntaxError, TypeError):
        return None


def _readable(layout: LayoutName, trial: Mapping[str, NDArray[Any]], size: Size) -> bool:
    """Whether the user's choice can be read at all."""
    classes = LAYOUTS[layout].classes(list(trial.values())) if len(trial) == LAYOUTS[layout].outputs else 0
    if classes is not None and classes < 1:
        return False
    try:
        boxes, scores = LAYOUTS[layout].read(list(trial.values()), size, 0)
    except (IndexError, ValueError, StopIteration, AttributeError):
        return False
    return boxes.ndim == 2 and boxes.shape == (len(scores), 4)


def _finite(outputs: Sequence[NDArray[Any]]) -> bool:
    return all(bool(np.isfinite(x).all()) for x in outputs if np.issubdtype(x.dtype, np.floating))


def _shapes(outputs: Mapping[str, NDArray[Any]]) -> str:
    return ", ".join(f"{name} {tuple(x.shape)}" for name, x in outputs.items())


def _single(output: NDArray[Any]) -> NDArray[Any]:
    """Without the batch axis: torchvision's outputs have none."""
    return output[0] if output.ndim == 3 or (output.ndim == 2 and len(output) == 1 and output.shape[1] != 4) else output
