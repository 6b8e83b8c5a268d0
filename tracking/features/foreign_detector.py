"""Detectors that people already have: ONNX files of other projects, recognised by their inputs and outputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.devices import Device, device_of
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.features.detector_layouts import LAYOUTS, TENSORFLOW, TURNED, Size, paired, with_probabilities
from tsuiseki.tracking.features.foreign_options import DetectorOptions, ImageInput, LayoutName, ScoreKind
from tsuiseki.tracking.features.layout_recognition import (
    COCO,
    COCO_FIRST,
    COCO_OWN,
    RF_DETR,
    background_first,
    class_names,
    class_of_people,
    coco_names,
    metadata_value,
    of_so_many_classes,
    plain_name,
    possible_kinds,
    possible_layouts,
    useful_outputs,
)
from tsuiseki.tracking.features.yolo_heads import RICHER_TASKS, TASKS, Part, detection_part, rows_beside_masks
from tsuiseki.tracking.formats.label_checks import BoxCheck
from tsuiseki.tracking.formats.rotated import RotatedBoxes, half_turned, turned_detections
from tsuiseki.tracking.geometry import about_rotated, clip_boxes, set_apart, suppress, suppress_rotated
from tsuiseki.tracking.network_trial import TRIED, noise, same_detections, say_one_at_a_time
from tsuiseki.tracking.onnx import RUN_SECONDS, TRIAL_SECONDS, byte_image_input, image_input, open_session, run_session
from tsuiseki.tracking.preprocessing import check_images
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray, IntArray
from tsuiseki.tracking.types.class_choice import ClassChoice, only_people

# Best detections of a picture that are compared with each other.
MOST_CANDIDATES = 400
# Intersection over union from which two detections are one person.
SAME = 0.5
# Side of the picture for recognising networks that take any size, pixels.
_TRIAL_SIDE = 320
_KINDS = {"tensor(int64)": "int64", "tensor(int32)": "int32", "tensor(float16)": "float16"}
# What other inputs may be, and their values for a picture of some height and width: boxes are wanted in its pixels.
_SIDE_INPUTS: Mapping[str, Callable[[Size], Sequence[int]]] = {
    "scale_factor": lambda _: (1, 1),
    "im_shape": lambda size: size,
    "orig_target_sizes": lambda size: size[::-1],
}


class ForeignDetector:
    """A detector of another project, exported to ONNX.

    Args:
        path: the ONNX file.
        score_threshold: detections below it are dropped; in [0, 1].
        threads: CPU threads; 0 takes all cores.
        options: what the file does not tell.
        device: what to run on, see `opened_on`; afterwards what it runs on.
        turned: turned boxes come with their angles, the longer side as height; by default as upright boxes about them.
        classes: that are detected; by default people, whose detections then bear no class.

    Attributes:
        input_size: height and width of the input, pixels; None where it takes any.
        layout: that was recognised.
        wanted: names by number, as the outputs count it, of the classes that are detected; empty where not known.
        across: boxes of different classes suppress each other.
        people_only: no other class is detected, by the names.
        scores: what the class values are; None for layouts in which they can be but one thing.
        input: what becomes of a picture.
        check: compares its boxes with the pictures.

    Raises:
        RequestError: the file is no such detector, several layouts fit it, or it lacks a class, or which one is people
            is unknown.
    """

    def __init__(
        self,
        path: str | Path,
        score_threshold: float = 0.3,
        threads: int = 0,
        options: DetectorOptions | None = None,
        device: Device = "auto",
        turned: bool = False,
        classes: ClassChoice | None = None,
    ) -> None:
        options, self.turned = options or DetectorOptions(), turned
        self.path, self.score_threshold = Path(path), score_threshold
        self._apart = True
        # Whether two pictures at once give what they give one at a time; None until a picture shows it.
        self._together: bool | None = False
        self.session = open_session(path, threads, device)
        self.device = device_of(self.session)
        self.metadata: Mapping[str, str] = self.session.get_modelmeta().custom_metadata_map
        names = {plain_name(x.name): x.name for x in self.session.get_outputs()}
        first = self.session.get_inputs()[0].shape
        self._tensorflow = names.keys() >= set(TENSORFLOW) and not (len(first) == 4 and first[1] == 3)
        # Newer files of TensorFlow give more beside them.
        self._outputs = [names[name] for name in TENSORFLOW] if self._tensorflow else list(names.values())
        if (task := self.metadata.get("task", "detect")) not in TASKS:
            raise RequestError(f"{self.path}: expected a detector, got a network for {task!r}; export one for 'detect'")
        self._part: Part | None = None
        self._seconds = TRIAL_SECONDS
        self.input_size = self._size_of_input(options)
        self.names = options.classes or class_names(self.metadata)
        trial = self._try(options)
        self.layout = self._choose_layout(trial, options)
        self.scores = self._choose_scores(list(trial.values()), options)
        self.input = self._choose_input(trial, options)
        if self.layout in TURNED and self.input.resize == "stretch":
            raise RequestError(f"{path}: turned boxes want pictures of one scale; leave `detector_options.resize` out")
        self.across, self._classed_by_user = classes is None or classes.across, classes is not None
        self.wanted = self._choose_classes(list(trial.values()), options, classes)
        self.people_only = classes is None or only_people(self.wanted)
        if self._batched and self._apart and isinstance(self._wanted.shape[0], str):
            self._together = None
            self._run([*noise(*(self.input_size or (_TRIAL_SIDE, _TRIAL_SIDE)))])
        self._seconds = RUN_SECONDS
        self.gave: set[bool] = set()
        self.check = BoxCheck(f"{self.path}, read as layout {self.layout}")

    def __str__(self) -> str:
        """How the file is read, in words."""
        classes = ", ".join(f"class {number}" + (f" {name!r}" if name else "") for number, name in self.wanted.items())
        classes = f"detects {classes}" if self._classed_by_user else f"people are {classes}"
        scores = "" if self.scores is None else f", scores by {self.scores}"
        size = "any size" if self.input_size is None else f"{self.input_size[1]}x{self.input_size[0]}"
        return f"layout {self.layout}, {classes}{scores}; pictures {self.input}, {size}"

    @property
    def facts(self) -> dict[str, Any]:
        """How the file is read, as plain values by name."""
        detected = {"wanted": dict(self.wanted)} if self._classed_by_user else {"person": self.person}
        chosen = {"layout": self.layout, **detected, "classes": self.names, "scores": self.scores}
        return {**chosen, "size": self.input_size, **asdict(self.input)}

    @property
    def person(self) -> int:
        """Number of the class of people, as the outputs count it; the first one where others are detected."""
        return next(iter(self.wanted))

    @property
    def blank(self) -> bool:
        """Whether it has run, and no picture gave anything but zeros or no rows."""
        return self.gave == {False}

    def detect(self, images: Sequence[ImageArray]) -> list[Detections]:
        """People in ``images``, each ``(H, W, 3)`` uint8 RGB; boxes are cut off at the border.

        Raises:
            RunError: the network gives NaN or infinity, or nothing but zeros where every place has
                a row.
        """
        if not check_images(images):
            return []
        fitted = [self.input.fit(image, self.input_size or image.shape[:2]) for image in images]
        outputs = self._run([image for image, _ in fitted])
        return [
            self._decode(outputs[n], fitted[n][0].shape[:2], fitted[n][1], images[n].shape[:2])
            for n in range(len(images))
        ]

    def _decode(
        self, outputs: Sequence[NDArray[Any]], fitted: Size, scale: tuple[float, float], size: Size
    ) -> Detections:
        self._check_values(outputs)
        boxes, scores, classes = self._candidates(outputs, fitted)
        good = np.flatnonzero((scores >= self.score_threshold) & (scores > 0))
        good = good[np.argsort(-scores[good], kind="stable")][:MOST_CANDIDATES]
        boxes, scores, classes = boxes[good], scores[good].clip(0, 1), classes[good]
        self.check.size = fitted[1], fitted[0]
        self.check.add(about_rotated(boxes) if self.layout in TURNED else boxes)
        if self.layout in TURNED:
            return self._turned(boxes / (*scale, *scale, 1), scores, classes, size)
        boxes = clip_boxes(boxes / np.tile(scale, 2), size[1], size[0])
        visible = ((boxes[:, 2:] - boxes[:, :2]) >= 1).all(axis=1)
        boxes, scores, classes = boxes[visible], scores[visible], classes[visible]
        if self._doubled:
            chosen = suppress(boxes if self.across else set_apart(boxes, classes), scores, SAME)
            boxes, scores, classes = boxes[chosen], scores[chosen], classes[chosen]
        return self._classed(Detections(boxes, scores), classes)

    def _candidates(self, outputs: Sequence[NDArray[Any]], fitted: Size) -> tuple[FloatArray, FloatArray, IntArray]:
        """Boxes ``(N, 4)`` or ``(N, 5)`` in pixels of the input, scores and classes, of the wanted classes."""
        outputs = with_probabilities(LAYOUTS[self.layout], outputs, self.scores)
        read = [LAYOUTS[self.layout].read(outputs, fitted, number) for number in self.wanted]
        boxes, scores = (np.concatenate([boxes_and_scores[k] for boxes_and_scores in read]) for k in (0, 1))
        return boxes, scores, np.repeat([*self.wanted], [len(boxes_and_scores[1]) for boxes_and_scores in read])

    @property
    def _doubled(self) -> bool:
        """Whether somebody may be detected twice: the network drops no doubles, or does so by class."""
        return not LAYOUTS[self.layout].suppressed or (self.across and len(self.wanted) > 1)

    def _classed(self, detections: Detections, classes: IntArray) -> Detections:
        """With their classes, where others than people are detected."""
        return replace(detections, classes=classes, names=self.wanted) if self._classed_by_user else detections

    def _turned(self, boxes: FloatArray, scores: FloatArray, classes: IntArray, size: Size) -> Detections:
        """Of ``(N, 5)`` turned boxes; a network tells neither which side is the height nor which end is up."""
        lying = boxes[:, 2] > boxes[:, 3]
        boxes[lying] = boxes[lying][:, [0, 1, 3, 2, 4]] + [0, 0, 0, 0, np.pi / 2]
        boxes[:, 4] = half_turned(boxes[:, 4])
        chosen = np.flatnonzero((boxes[:, 2:4] >= 1).all(axis=1))
        if self._doubled:
            compared = boxes if self.across else set_apart(boxes, classes)
            chosen = chosen[suppress_rotated(compared[chosen], scores[chosen], SAME)]
        boxes, scores, classes = boxes[chosen], scores[chosen], classes[chosen]
        if self.turned:
            return self._classed(turned_detections(RotatedBoxes(boxes, np.full(len(boxes), -1), scores)), classes)
        upright = clip_boxes(about_rotated(boxes), size[1], size[0])
        inside = ((upright[:, 2:] - upright[:, :2]) >= 1).all(axis=1)
        return self._classed(Detections(upright[inside], scores[inside]), classes[inside])

    def _run(self, images: Sequence[ImageArray]) -> list[list[NDArray[Any]]]:
        """Outputs of each picture without their batch axis; all in one call where the file takes any batch."""
        several = len(images) > 1 and len({image.shape for image in images}) == 1
        if self._together and several:
            batch = self._call(np.stack(images))
            return [[x[n] for x in batch] for n in range(len(images))]
        singles = [self._call(image[None]) for image in images]
        # Lists of boxes alone, such as torchvision's, have no axis of pictures.
        self._apart = any(x.ndim >= 3 for x in singles[0])
        if not self._apart:
            self._together = False
            return singles
        rows = [[x[0] for x in outputs] for outputs in singles]
        if self._together is None and several:
            self._together = self._same_together(images[:TRIED], rows[:TRIED])
        return rows

    def _same_together(self, images: Sequence[ImageArray], singles: Sequence[Sequence[NDArray[Any]]]) -> bool | None:
        """Whether ``images`` at once give what they gave one at a time; where not, that is said. None: they are empty.

        Networks that drop doubles themselves give nothing for noise, so that only a frame with people tells.
        """
        size = images[0].shape[:2]
        apart = [self._candidates(outputs, size)[:2] for outputs in singles]
        try:
            batch = self._call(np.stack(images))
        except RequestError:  # a batch of one is baked into the file
            batch = []
        verdicts: list[bool | None] = [False]
        if batch and all(len(x) == len(images) for x in batch):
            together = [self._candidates([x[n] for x in batch], size)[:2] for n in range(len(images))]
            verdicts = [same_detections(*a, *b, max(size)) for a, b in zip(apart, together, strict=True)]
        if False in verdicts:
            say_one_at_a_time(self.path, "pictures")
            return False
        return None if None in verdicts else True

    def _call(self, images: NDArray[np.uint8]) -> list[NDArray[Any]]:
        values = self.input.normalise(images, self._wanted.dtype)
        inputs: dict[str, NDArray[Any]] = {self._wanted.name: values if self._batched else values[0]}
        for side_input in self.session.get_inputs():
            if side_input.name != self._wanted.name:
                inputs[side_input.name] = self._side_input(side_input, len(images), images.shape[1:3])
        outputs = run_session(self.session, self.path, inputs, self._outputs, self._seconds)
        return outputs if self._part is None else [self._part.of(outputs[0], axes_before=1)]

    def _side_input(self, side_input: Any, count: int, size: Size) -> NDArray[Any]:
        """The value of an input beside the picture.

        Raises:
            RequestError: it is not known what the network wants there.
        """
        kind = np.dtype(_KINDS.get(side_input.type, "float32"))
        if "mask" in side_input.name and len(side_input.shape) == 3:  # of padding; there is none
            sides = zip(side_input.shape[1:], size, strict=True)
            return np.ones((count, *(side if isinstance(side, int) else actual for side, actual in sides)), kind)
        values = _SIDE_INPUTS.get(side_input.name if kind.kind == "f" else "orig_target_sizes")
        if values is not None and len(side_input.shape) == 2:
            return np.tile(np.array(values(size), kind), (count, 1))
        raise RequestError(
            f"{self.path}: expected a picture as input, and beside it at most {', '.join(_SIDE_INPUTS)}, got "
            f"{side_input.name} {tuple(side_input.shape)}; export it without"
        )

    def _size_of_input(self, options: DetectorOptions) -> Size | None:
        """Height and width, or None for a network of torchvision's or TensorFlow's kind, which takes any."""
        self._wanted = (byte_image_input if self._tensorflow else image_input)(self.session, self.path)
        self._batched = len(self._wanted.shape) == 4
        sides = self._wanted.shape[1:3] if self._tensorflow else self._wanted.shape[-2:]
        height, width = (x if isinstance(x, int) else None for x in sides)
        stated = metadata_value(self.metadata, "imgsz")
        try:
            own_height, own_width = map(int, [stated] * 2 if isinstance(stated, int) else stated)
        except (TypeError, ValueError):
            own_height = own_width = 0
        height, width = height or options.height or own_height, width or options.width or own_width
        if height and width:
            return height, width
        if self._tensorflow or len(self.session.get_outputs()) == 3:
            return None
        raise RequestError(
            f"{self.path}: height and width of its input are open and its metadata do not tell them; "
            "give `detector_options.height` and `detector_options.width`, or export with fixed ones"
        )

    def _try(self, options: DetectorOptions) -> dict[str, NDArray[Any]]:
        """Outputs by name for a noise picture; of a network that does more than detect, what is detected."""
        self.input = ImageInput("as-is", raw_nhwc=self._tensorflow)
        size = self.input_size or (_TRIAL_SIDE, _TRIAL_SIDE)
        outputs = dict(zip(self._outputs, self._run([noise(*size)[0]])[0], strict=True))
        beside_masks = rows_beside_masks(outputs, size)
        self._outputs = useful_outputs(outputs) if beside_masks is None else [beside_masks[0]]
        outputs = {name: outputs[name] for name in self._outputs}
        if len(outputs) == 1 and self._apart and options.layout not in TURNED:
            ((name, rows),) = outputs.items()
            task, classes = self.metadata.get("task", "detect"), len(self.names) if self.names else None
            masks = 0 if beside_masks is None else beside_masks[1]
            key_points = metadata_value(self.metadata, "kpt_shape")
            self._part = detection_part(rows, size, task, classes, key_points, masks)
            outputs = {name: rows if self._part is None else self._part.of(rows)}
        if not _finite(list(outputs.values())):
            raise RequestError(
                f"{self.path}: its outputs for a picture of noise are NaN or infinite; export it again in float32"
            )
        return outputs

    def _choose_layout(self, trial: Mapping[str, NDArray[Any]], options: DetectorOptions) -> LayoutName:
        size = self.input_size or (_TRIAL_SIDE, _TRIAL_SIDE)
        inputs, task = [x.name for x in self.session.get_inputs()], self.metadata.get("task")
        possible = possible_layouts(
            trial,
            size,
            inputs,
            turned=task == "obb",
            richer=task in RICHER_TASKS,
            channels_first=not self._tensorflow,
        )
        columns = {LAYOUTS[name].classes(list(trial.values())) for name in possible}
        if self.names and self.names[:3] == COCO_FIRST and len(self.names) not in columns and columns & COCO_OWN:
            self.names = None  # COCO's names without its gaps: the number of classes tells more
        fitting = of_so_many_classes(possible, list(trial.values()), len(self.names) if self.names else None)
        if options.layout is not None:
            if options.layout == "tensorflow" and not self._tensorflow:
                raise RequestError(
                    f"{self.path}: layout tensorflow asks for outputs {', '.join(TENSORFLOW)}, got {_shapes(trial)}; "
                    "convert it again with these outputs"
                )
            if options.layout not in fitting and not _readable(options.layout, trial, size):
                raise RequestError(
                    f"{self.path}: its outputs {_shapes(trial)} are not {LAYOUTS[options.layout].description}, "
                    f"as layout {options.layout} asks for"
                )
            return options.layout
        if len(fitting) == 1:
            return fitting[0]
        if possible and not fitting:
            counts = " or ".join(f"{LAYOUTS[n].classes(list(trial.values()))} (layout {n})" for n in possible)
            raise RequestError(
                f"{self.path}: expected names of as many classes as its outputs {_shapes(trial)} have, {counts}, got "
                f"{len(self.names or ())}; give them with `detector_options.classes`"
            )
        if not fitting:
            readable = " or ".join(n for n in LAYOUTS if n != "tensorflow" and _readable(n, trial, size))
            advice = f"`detector_options.layout` {readable} would read these shapes, if you know that it is"
            raise RequestError(
                f"{self.path}: its outputs {_shapes(trial)} are of no known layout; known are {', '.join(LAYOUTS)}; "
                f"its input is {size[1]}x{size[0]}; "
                + (advice if readable else "in Python, give a function from a picture to boxes")
            )
        several = " or ".join(f"{name} {LAYOUTS[name].description}" for name in fitting)
        raise RequestError(
            f"{self.path}: its outputs {_shapes(trial)} could be {several}; say which with `detector_options.layout`"
        )

    def _choose_scores(self, trial: Sequence[NDArray[Any]], options: DetectorOptions) -> ScoreKind | None:
        layout = LAYOUTS[self.layout]
        values = np.empty((0, 0)) if layout.values is None else layout.values(trial)
        names, of_rf_detr = len(self.names) if self.names else None, set(RF_DETR) <= set(self._outputs)
        kinds = possible_kinds(values, names, paired=layout.paired, rf_detr=of_rf_detr)
        if not layout.paired:
            if options.scores not in (None, *kinds):
                raise RequestError(
                    f"{self.path}: the scores of layout {self.layout} can be but one thing, {kinds[0]}; leave "
                    "`detector_options.scores` out"
                )
            return None if kinds == ["probabilities"] else kinds[0]
        if options.scores is not None:
            if options.scores == "probabilities" and kinds != ["probabilities"]:
                raise RequestError(
                    f"{self.path}: expected probabilities, got class values from {values.min():.3g} to "
                    f"{values.max():.3g}; give `detector_options.scores` as sigmoid or softmax"
                )
            return options.scores
        if len(kinds) == 1:
            return kinds[0]
        raise RequestError(
            f"{self.path}: its class values could be logits of a {' or of a '.join(kinds)}; say which with "
            "`detector_options.scores`"
        )

    def _choose_input(self, trial: Mapping[str, NDArray[Any]], options: DetectorOptions) -> ImageInput:
        """What the family wants its pictures to be, but for what the user says."""
        usual = LAYOUTS[self.layout].input
        # RT-DETR and D-FINE take plain pixels. RF-DETR, which gives dets and labels, and whatever has the 91 classes of
        # DETR take ImageNet's.
        if self.layout == "detr" and self.scores == "sigmoid" and "dets" not in trial:
            of_detr = paired(list(trial.values()))[1].shape[1] == max(COCO)
            usual = usual if of_detr else ImageInput("stretch")
        normalises = self._wanted.dtype == np.uint8  # it normalises them itself
        usual = replace(usual, pixels="bytes", mean=(0.0, 0.0, 0.0), std=(1.0, 1.0, 1.0)) if normalises else usual
        names = ("pixels", "mean", "std", "resize", "colour")
        chosen = {name: value for name in names if (value := getattr(options, name)) is not None}
        by_hand = [name for name in names[:3] if name in chosen]
        if usual.raw_nhwc and by_hand:
            raise RequestError(
                f"{self.path}: the network takes bytes and normalises them itself; leave "
                f"`detector_options.{by_hand[0]}` out"
            )
        return replace(usual, **({"resize": "as-is"} if self.input_size is None else {}) | chosen)

    def _choose_classes(
        self, trial: Sequence[NDArray[Any]], options: DetectorOptions, choice: ClassChoice | None
    ) -> Mapping[int, str]:
        """Names by number of the classes that are detected."""
        first, count = self._numbering(LAYOUTS[self.layout].classes(trial) or (len(self.names or ()) or None), trial)
        names = {first + n: name for n, name in enumerate(self.names or ())} or coco_names(count)
        if choice is not None:
            there = names.keys() if count is None else range(first, first + count)
            chosen = choice.numbers(names, there or None, self.path)
        elif options.person is None:
            chosen = (first + class_of_people(self.path, self.names, count),)
        else:
            chosen = (options.person,)
            if options.person < 0 or (count is not None and options.person >= first + count):
                among = "from 0" if count is None else f"from 0 to {first + count - 1}"
                raise RequestError(f"{self.path}: expected a class of people {among}, got {options.person}")
        return {number: names.get(number, "") for number in chosen}

    def _numbering(self, columns: int | None, trial: Sequence[NDArray[Any]]) -> tuple[int, int | None]:
        """Number of the first class that may have a name, and how many there are, where that is known."""
        if self.scores != "softmax" or columns is None:
            return LAYOUTS[self.layout].first_class, columns
        # One class is "no object": the last one, or as in SSD the first, which COCO's own numbers count, too.
        if not background_first(paired(trial)[1]):
            return 0, columns - 1
        return (1, columns - 1) if self.names and len(self.names) < columns else (0, columns)

    def _check_values(self, outputs: Sequence[NDArray[Any]]) -> None:
        # TensorFlow tells how many rows it fills even where all of their scores are zero.
        values = outputs[2:3] if self.layout in ("tensorflow", "tensorrt") else outputs
        floats = [x for x in values if np.issubdtype(x.dtype, np.floating)]
        if not _finite(outputs):
            raise RunError(
                f"{self.path}: the network gives NaN or infinity; check its normalisation, or export it in float32"
            )
        blank = not any(x.any() for x in floats)
        # Rows of zeros fill up, or there are no rows where nothing is detected.
        filled_up = LAYOUTS[self.layout].suppressed and self.layout != "torchvision"
        if blank and not filled_up and all(x.size for x in floats):
            raise RunError(f"{self.path}: the network gives nothing but zeros; export it again")
        self.gave.add(not blank)


def _readable(layout: LayoutName, trial: Mapping[str, NDArray[Any]], size: Size) -> bool:
    outputs = list(trial.values())
    # Paddle may count its rows, and NanoDet give the parts of its rows apart.
    if len(outputs) != LAYOUTS[layout].outputs and layout not in ("paddle", "nanodet", "nanodet-g"):
        return False
    try:
        classes = LAYOUTS[layout].classes(outputs)
        boxes, scores = LAYOUTS[layout].read(outputs, size, 0)
    except (IndexError, ValueError, StopIteration, AttributeError):
        return False
    return (classes is None or classes >= 1) and boxes.shape == (len(scores), 5 if layout in TURNED else 4)


def _finite(outputs: Sequence[NDArray[Any]]) -> bool:
    return all(bool(np.isfinite(x).all()) for x in outputs if np.issubdtype(x.dtype, np.floating))


def _shapes(outputs: Mapping[str, NDArray[Any]]) -> str:
    return ", ".join(f"{name} {tuple(x.shape)}" for name, x in outputs.items())
