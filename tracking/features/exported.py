"""Detectors and appearance models: exported networks, and any function.

`Detector` and `Appearance` wrap ONNX files of this toolkit; those of others are read by `open_detector` and
`as_describer`. Whatever has a ``detect`` or ``describe`` of its own is used as it is. Functions are models, too:

* A detector is a function from an image, ``(H, W, 3)`` uint8 RGB, to what `as_detections` understands.
* An appearance model is a function from crops, a list of ``(h, w, 3)`` uint8 RGB images of any size, to one row of
  numbers each, ``(N, D)``. Rows are brought to unit length; a row of zeros says that nothing is known.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tsuiseki.tracking.devices import Device, device_of
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.features.foreign_detector import MOST_CANDIDATES, SAME, ForeignDetector
from tsuiseki.tracking.features.foreign_options import IMAGENET, AppearanceOptions, DetectorOptions
from tsuiseki.tracking.geometry import clip_boxes, set_apart, straddling, suppress
from tsuiseki.tracking.interchange import BadBoxes, DetectionsLike, as_detections
from tsuiseki.tracking.network_trial import most_at_once, noise
from tsuiseki.tracking.onnx import (
    RUN_SECONDS,
    TRIAL_SECONDS,
    MissingCardError,
    OnnxModel,
    image_input,
    open_session,
    run_session,
)
from tsuiseki.tracking.preprocessing import check_images, crop_boxes, fit_image, normalise
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray, IntArray, check_boxes
from tsuiseki.tracking.types.class_choice import ClassChoice, only_people
from tsuiseki.tracking.weights import shipped_or_file
from tsuiseki.tracking.weights.catalogue import find_model

# Most crops of one inference call.
BATCH = 32
# Least score of what networks in files detect.
USUAL_THRESHOLD = 0.3


class Detect(Protocol):
    """Finds people in images."""

    def detect(self, images: Sequence[ImageArray]) -> list[Detections]:
        """The boxes of each ``(H, W, 3)`` uint8 RGB image, in pixels."""


class SizedDetect(Detect, Protocol):
    """A detector that knows the size of its input."""

    @property
    def input_size(self) -> tuple[int, int] | None:
        """Height and width, pixels; None where it takes any."""


@runtime_checkable
class ChoosingDetect(Detect, Protocol):
    """A detector that chooses its tiles while the video comes."""

    def prepared(self, images: Sequence[ImageArray], workers: int = 1) -> Detect:
        """The detector for ``images``; asked for in the order of the video, run in any.

        Args:
            images: the next ones.
            workers: calls of the detector at a time, while it chooses.
        """


class Describe(Protocol):
    """Gives the appearance features of people in an image."""

    def describe(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        """``(N, D)`` unit-length features of ``(N, 4)`` boxes."""


class Detector:
    """A detector exported to ONNX: of the SSD family with raw heads, any other with boxes and scores.

    Args:
        path: the ONNX file.
        score_threshold: detections below it are dropped; in [0, 1].
        threads: CPU threads; 0 takes all cores.
        device: what to run on, see `opened_on`; afterwards what it runs on.
        classes: that are detected, numbered from 1; by default people, or all where no class is called so, whose
            detections then bear no class.

    Attributes:
        wanted: names by number of the classes that are detected; empty where they are not distinguished.
        across: boxes of different classes suppress each other.
        people_only: no other class is detected.

    Raises:
        RequestError: the file is no detector (see `OnnxModel`), or lacks a class.
    """

    def __init__(
        self,
        path: str | Path,
        score_threshold: float = 0.3,
        threads: int = 0,
        device: Device = "auto",
        classes: ClassChoice | None = None,
    ) -> None:
        self.model = OnnxModel(path, "detector", threads, device)
        self.device = self.model.device
        if not 0 <= score_threshold <= 1:
            raise RequestError(f"expected a threshold in [0, 1], got {score_threshold}")
        self.score_threshold = score_threshold
        card = self.model.card
        self._decoded = self.model.output_names == ["boxes", "scores"]
        heads = self.model.output_names == ["logits", "offsets", "anchors"] and "variances" in card.settings
        if not (heads or self._decoded):
            raise RequestError(
                f"{path}: expected outputs logits, offsets and anchors, or boxes and scores, got "
                f"{', '.join(self.model.output_names)}; export the detector again"
            )
        names = dict(enumerate(card.class_names, start=1))
        self.across = classes is None or classes.across
        self.wanted: Mapping[int, str] = (
            {} if classes is None else {n: names[n] for n in classes.numbers(names, names, path)}
        )
        self._usual = [n for n in names if only_people({n: names[n]})] or list(names)
        self.people_only = only_people(self.wanted)
        # The caches of a CPU hold the layers of one picture: it is faster one by one, and gives the same.
        most = 1 if self.device == "cpu" else BATCH
        pictures = normalise(noise(*self.input_size), card)
        self._most = most_at_once(lambda x: self.model.try_out(x)[:2], [pictures], most, self.model.path, "pictures")

    @property
    def input_size(self) -> tuple[int, int]:
        """Height and width of the input, pixels."""
        return self.model.card.input_height, self.model.card.input_width

    @property
    def calibrated(self) -> bool:
        """Whether the file says that its scores are probabilities in the video of its own camera."""
        return bool(self.model.card.settings.get("calibrated", False))

    def detect(self, images: Sequence[ImageArray]) -> list[Detections]:
        """People in ``images``, each ``(H, W, 3)`` uint8 RGB; boxes are cut off at the border."""
        return [detections for detections, _ in self.detect_at_anchors(images)]

    def detect_at_anchors(self, images: Sequence[ImageArray]) -> list[tuple[Detections, IntArray]]:
        """As `detect`, with the ``(N,)`` anchors, or rows of boxes, that the detections of each image come from."""
        if not check_images(images):
            return []
        card = self.model.card
        count = 1 if self._most == 1 else len(images)
        detections = []
        for batch in (images[start : start + count] for start in range(0, len(images), count)):
            inputs, scales = zip(*(fit_image(image, card) for image in batch), strict=True)
            outputs = self.model.run(normalise(inputs, card))
            for n, image in enumerate(batch):
                read = self._scored(outputs[1][n]) if self._decoded else self._softmax(outputs[0][n])
                detections.append(self._chosen(read, outputs, n, scales[n], image.shape[:2]))
        return detections

    def _scored(self, scores: NDArray[np.float32]) -> tuple[IntArray, NDArray[Any]]:
        """As `_softmax`, of ``(N, C)`` scores in [0, 1]."""
        candidates = np.flatnonzero(scores.max(axis=1) >= self.score_threshold)
        return candidates, self._of_classes(scores[candidates], 1)

    def _softmax(self, logits: NDArray[np.float32]) -> tuple[IntArray, NDArray[Any]]:
        """Rows of ``(A, C + 1)`` logits that may be reported, and their scores of the classes that are detected."""
        # No softmax exceeds that of its class and the background alone, so few anchors need the whole of it.
        threshold = np.clip(self.score_threshold, 1e-9, 1 - 1e-9)
        margin = logits[:, 1:].max(axis=1) - logits[:, 0]
        candidates = np.flatnonzero(margin >= np.log(threshold / (1 - threshold)))
        exponentials = np.exp(logits[candidates] - logits[candidates].max(axis=1, keepdims=True))
        return candidates, self._of_classes(exponentials, 0) / exponentials.sum(axis=1, keepdims=True)

    def _of_classes(self, values: NDArray[Any], first: int) -> NDArray[Any]:
        """Columns of the classes that are detected, or the largest of all; ``first`` is the number of column 0."""
        numbers = [number - first for number in (self.wanted or self._usual)]
        return values[:, numbers] if self.wanted else values[:, numbers].max(axis=1, keepdims=True)

    def _chosen(
        self,
        read: tuple[IntArray, NDArray[Any]],
        outputs: Sequence[NDArray[np.float32]],
        image: int,
        scale: tuple[float, float],
        size: tuple[int, int],
    ) -> tuple[Detections, IntArray]:
        """What is reported of the rows and scores that are ``read`` of an image, and the rows that it comes from."""
        candidates, of_classes = read
        rows, columns = np.nonzero(of_classes >= self.score_threshold)
        candidates, scores = candidates[rows], of_classes[rows, columns]
        if len(candidates) > MOST_CANDIDATES:
            best = np.argsort(-scores, kind="stable")[:MOST_CANDIDATES]
            candidates, scores, columns = candidates[best], scores[best], columns[best]
        if self._decoded:
            boxes = outputs[0][image][candidates].astype(np.float64) / np.tile(scale, 2)
        else:
            offsets, anchors, variances = outputs[1][image], outputs[2], self.model.card.settings["variances"]
            boxes = decode_boxes(offsets[candidates], anchors[candidates], variances) / np.tile(scale, 2)
        boxes = clip_boxes(boxes, size[1], size[0])
        visible = ((boxes[:, 2:] - boxes[:, :2]) >= 1).all(axis=1)  # clipping may leave less than a pixel
        boxes, scores, columns = boxes[visible], scores[visible], columns[visible]
        compared = boxes if self.across else set_apart(boxes, columns)
        chosen = suppress(compared, scores, SAME)
        share = self.model.card.settings.get("straddling")
        if share is not None:
            chosen = chosen[~straddling(compared[chosen], scores[chosen], share)]
        numbers = np.array([*self.wanted], dtype=np.int64)
        classes = numbers[columns[chosen]] if len(numbers) else None
        return Detections(boxes[chosen], scores[chosen], classes=classes, names=self.wanted), candidates[visible][
            chosen
        ]


class Appearance:
    """An appearance network exported to ONNX: crops in, unit-length features out.

    Args:
        path: the ONNX file.
        threads: CPU threads; 0 takes all cores.
        device: what to run on, see `opened_on`; afterwards what it runs on.

    Raises:
        RequestError: the file is no appearance network (see `OnnxModel`).
    """

    def __init__(self, path: str | Path, threads: int = 0, device: Device = "auto") -> None:
        self.model = OnnxModel(path, "appearance", threads, device)
        self.device, card = self.model.device, self.model.card
        crops = normalise(noise(card.input_height, card.input_width), card)
        self._most = most_at_once(self.model.try_out, [crops], BATCH, self.model.path, "crops")

    def describe(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        """``(N, D)`` unit-length features of the people in ``(N, 4)`` boxes of an ``(H, W, 3)`` uint8 RGB image."""
        check_images([image])
        boxes, card = check_boxes(boxes), self.model.card
        features = [np.empty((0, card.feature_length), dtype=np.float32)]
        for batch in np.array_split(boxes, range(self._most, len(boxes), self._most)):
            if len(batch):
                crops = crop_boxes(image, batch, card.input_height, card.input_width)
                features += self.model.run(normalise(crops, card))
        return np.concatenate(features).astype(np.float64)


def open_detector(
    path: str | Path,
    score_threshold: float = USUAL_THRESHOLD,
    threads: int = 0,
    options: DetectorOptions | None = None,
    device: Device = "auto",
    *,
    turned: bool = False,
    classes: ClassChoice | None = None,
) -> Detector | ForeignDetector:
    """The detector at ``path``: one of this toolkit, or any that `ForeignDetector` recognises; see both.

    A bare word stands for a shipped or downloaded one, see `shipped_or_file`.

    Raises:
        RequestError: see the three; or ``options`` for a detector of this toolkit, which needs none.
    """
    entry, path = find_model(str(path), "detector"), shipped_or_file("detector", path)
    if entry is not None:
        chosen = {} if options is None else {name: x for name, x in vars(options).items() if x is not None}
        options = DetectorOptions(**{**entry.options, **chosen})
    try:
        detector = Detector(path, score_threshold, threads, device, classes)
    except MissingCardError:
        return ForeignDetector(path, score_threshold, threads, options, device, turned, classes)
    if options not in (None, DetectorOptions()):
        raise RequestError(f"{path} tells all by itself; leave the detector options out")
    return detector


def decode_boxes(offsets: NDArray[np.float32], anchors: NDArray[np.float32], variances: Sequence[float]) -> FloatArray:
    """``(N, 4)`` x1, y1, x2, y2 from SSD box codes ``(N, 4)`` and anchors ``(N, 4)`` cx, cy, w, h, in input pixels."""
    anchors = anchors.astype(np.float64)
    middle = anchors[:, :2] + offsets[:, :2] * variances[0] * anchors[:, 2:]
    # Beyond a factor of 1000 / 16 the code of an untrained or unsure anchor would overflow.
    half = anchors[:, 2:] * np.exp(np.minimum(offsets[:, 2:] * variances[1], np.log(1000 / 16))) / 2
    return np.concatenate([middle - half, middle + half], axis=1)


DetectorLike: TypeAlias = str | Path | Detect | Callable[[ImageArray], DetectionsLike]
AppearanceLike: TypeAlias = str | Path | Describe | Callable[[Sequence[ImageArray]], ArrayLike]

# A black crop, rows by columns, for asking an appearance how long its rows are.
BLANK = np.zeros((128, 64, 3), dtype=np.uint8)


def as_detector(
    source: DetectorLike,
    score_threshold: float | None = None,
    threads: int = 0,
    options: DetectorOptions | None = None,
    device: Device = "auto",
    *,
    turned: bool = False,
    classes: ClassChoice | None = None,
) -> Detect:
    """What finds people in images.

    Args:
        source: an exported network's file, a `Detector`, or a function; see the module.
        score_threshold: of a file or a function; by default 0.3 of a file, and none of a function, whose scores may be
            of any scale. A `Detector` has its own.
        threads: CPU threads of a network that is read from a file; 0 takes all cores.
        options: what the file of another project does not tell.
        device: of such a network, see `opened_on`.
        turned: boxes of such a file may be turned.
        classes: that are detected; by default people, or whatever a function or a detector of others gives.

    Raises:
        RequestError: it is none of them, the file is no detector, or lacks a class.
    """
    if isinstance(source, str | Path):
        least = USUAL_THRESHOLD if score_threshold is None else score_threshold
        return open_detector(source, least, threads, options, device, turned=turned, classes=classes)
    if not (hasattr(source, "detect") or callable(source)):
        raise RequestError(
            f"expected the detector as a file, a Detector, or a function from an image to boxes, got "
            f"{type(source).__name__}"
        )
    detector = source if hasattr(source, "detect") else FunctionDetector(source, score_threshold)
    return detector if classes is None else ChosenClasses(detector, classes, options.classes if options else None)


def as_describer(
    source: AppearanceLike, threads: int = 0, options: AppearanceOptions | None = None, device: Device = "auto"
) -> Describe:
    """What describes people's appearance.

    Args:
        source: the file of an `Appearance` or `ForeignAppearance`, or the bare word of a shipped or downloaded one, see
            `shipped_or_file`; an `Appearance`; or a function, see the module.
        threads: CPU threads of a network that is read from a file; 0 takes all cores.
        options: what the file of another project does not tell.
        device: of such a network, see `opened_on`.

    Raises:
        RequestError: it is none of them, the file is no appearance network, or ``options`` for one of this toolkit,
            which needs none.
    """
    if isinstance(source, str | Path):
        entry, path = find_model(str(source), "appearance"), shipped_or_file("appearance", source)
        if entry is not None and options in (None, AppearanceOptions()):
            options = AppearanceOptions(**entry.options)
        try:
            appearance = Appearance(path, threads, device)
        except MissingCardError:
            return ForeignAppearance(path, threads, options, device)
        if options not in (None, AppearanceOptions()):
            raise RequestError(f"{path} tells all by itself; leave the appearance options out")
        return appearance
    if hasattr(source, "describe"):
        return source
    if callable(source):
        return FunctionAppearance(source)
    raise RequestError(
        f"expected the appearance as a file, an Appearance, or a function from crops to rows, got "
        f"{type(source).__name__}"
    )


def usual_describer(appearance: AppearanceLike | None) -> Describe:
    """`as_describer`, by default of the shipped network."""
    return as_describer("people" if appearance is None else appearance)


class FunctionDetector:
    """A detector that is a function.

    Args:
        function: gives the boxes of an image.
        least: score under which they are left out; None for none.

    Attributes:
        bad: boxes that are none, and left out.
    """

    def __init__(self, function: Callable[[ImageArray], DetectionsLike], least: float | None = None) -> None:
        self.function, self.least, self.bad = function, least, BadBoxes()

    def detect(self, images: Sequence[ImageArray]) -> list[Detections]:
        """One `Detections` an image; see `Detect`.

        Raises:
            RequestError: the function returned something else than detections.
        """
        detections = []
        for image in images:
            result = self.function(image)
            try:
                detections.append(as_detections(result, counted=self.bad).scoring(self.least))
            except RequestError as error:
                raise RequestError(f"what the detector {_name(self.function)} returned: {error}") from error
        return detections


class FunctionAppearance:
    """An appearance model that is a function."""

    def __init__(self, function: Callable[[Sequence[ImageArray]], ArrayLike]) -> None:
        self.function = function
        self._length = 0

    def describe(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        """``(N, D)`` unit-length features; NaN for a box outside the image or a row of zeros. See `Describe`.

        Raises:
            RequestError: the function returned something else than one row a crop, or rows of another length.
        """
        height, width = image.shape[:2]
        corners = np.clip(np.round(boxes), 0, [width, height, width, height]).astype(np.int64)
        inside = (corners[:, 2:] > corners[:, :2]).all(axis=1)
        crops = [image[y1:y2, x1:x2] for x1, y1, x2, y2 in corners[inside]]
        if len(boxes) and not crops and not self._length:
            self._rows([BLANK])  # How long a row is must be known where there is nothing to describe.
        rows = self._rows(crops) if crops else np.empty((0, self._length))
        length = np.linalg.norm(rows, axis=1, keepdims=True)
        features = np.full((len(boxes), self._length), np.nan)
        features[inside] = rows / np.where(length > 0, length, np.nan)
        return features

    def _rows(self, crops: list[ImageArray]) -> FloatArray:
        result: Any = self.function(crops)
        for step in ("detach", "cpu"):
            result = getattr(result, step)() if hasattr(result, step) else result
        expected = f"expected the appearance {_name(self.function)} to return {len(crops)} rows of numbers, one a crop"
        try:
            rows = np.asarray(result, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise RequestError(f"{expected}, got {type(result).__name__}") from error
        if rows.ndim != 2 or len(rows) != len(crops) or not rows.shape[1]:
            raise RequestError(f"{expected}, got an array of shape {rows.shape}")
        if not np.isfinite(rows).all():
            raise RequestError(f"{expected}, got NaN or infinity")
        if self._length not in (0, rows.shape[1]):
            raise RequestError(f"{expected}, each {self._length} long as before, got {rows.shape[1]}")
        self._length = rows.shape[1]
        return rows


def _name(function: object) -> str:
    return getattr(function, "__name__", type(function).__name__)


class ChosenClasses:
    """A detector of some classes only.

    Args:
        detector: gives classes.
        choice: those that are wanted.
        names: of the classes in order, from 0, where its detections do not tell them.
    """

    def __init__(self, detector: Detect, choice: ClassChoice, names: Sequence[str] | None = None) -> None:
        self.detector, self.choice = detector, choice
        self.names = dict(enumerate(names or ()))

    def detect(self, images: Sequence[ImageArray]) -> list[Detections]:
        """The boxes of the chosen classes in each image.

        Raises:
            RequestError: of `ClassChoice.chosen`.
        """
        named = (
            detections if detections.names else replace(detections, names=self.names)
            for detections in self.detector.detect(images)
        )
        return [self.choice.chosen(detections, "the detector") for detections in named]


class ForeignAppearance:
    """An appearance network of another project; its features are brought to unit length.

    Args:
        path: the ONNX file.
        threads: CPU threads; 0 takes all cores.
        options: what the file does not tell.
        device: what to run on, see `opened_on`; afterwards what it runs on.

    Raises:
        RequestError: the file does not turn pictures into one row of numbers each.
    """

    def __init__(
        self,
        path: str | Path,
        threads: int = 0,
        options: AppearanceOptions | None = None,
        device: Device = "auto",
    ) -> None:
        options = options or AppearanceOptions()
        self.path = Path(path)
        self.session = open_session(path, threads, device)
        self.device = device_of(self.session)
        if len(self.session.get_inputs()) != 1:
            names = ", ".join(x.name for x in self.session.get_inputs())
            raise RequestError(f"{self.path}: expected one input, the crops, got {names}; export it with crops alone")
        self._wanted = image_input(self.session, self.path, floats=True)
        height, width = (x if isinstance(x, int) else None for x in self._wanted.shape[-2:])
        self.height, self.width = height or options.height, width or options.width
        if not self.height or not self.width:
            raise RequestError(
                f"{self.path}: height and width of its input are open; give `appearance_options.height` and "
                "`appearance_options.width`"
            )
        if len(self._wanted.shape) != 4 or len(self.session.get_outputs()) != 1:
            raise RequestError(
                f"{self.path}: expected crops (N, 3, H, W) in and one output of features, got "
                f"{len(self._wanted.shape)} axes and {len(self.session.get_outputs())} outputs"
            )
        self.input = replace(IMAGENET, colour=options.colour, pixels=options.pixels, mean=options.mean, std=options.std)
        crops = noise(self.height, self.width)
        rows, black = (self._rows(x, TRIAL_SECONDS) for x in (crops[:1], np.zeros_like(crops[:1])))
        if np.array_equal(rows, black):
            raise RequestError(
                f"{self.path}: expected features that depend on the crop, got the same for two crops; export it again"
            )
        self.feature_length = int(rows.shape[1])
        most = BATCH if isinstance(self._wanted.shape[0], str) else 1
        self._most = most_at_once(lambda x: [self._rows(x, TRIAL_SECONDS)], [crops], most, self.path, "crops")

    def describe(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        """``(N, D)`` unit-length features of the people in ``(N, 4)`` boxes of an ``(H, W, 3)`` uint8 RGB image.

        Raises:
            RunError: the features of a crop are zero or not finite.
        """
        assert self.height is not None
        assert self.width is not None
        parts = np.array_split(boxes, range(self._most, len(boxes), self._most))
        features = [self._rows(crop_boxes(image, part, self.height, self.width)) for part in parts if len(part)]
        rows = np.concatenate([np.empty((0, self.feature_length)), *features])
        length = np.linalg.norm(rows, axis=1, keepdims=True)
        if not np.isfinite(length).all() or (length == 0).any():
            raise RunError(f"{self.path}: expected finite features, got zero or NaN; check its normalisation")
        return np.asarray(rows / length)

    def _rows(self, crops: NDArray[np.uint8], seconds: float = RUN_SECONDS) -> FloatArray:
        values = self.input.normalise(crops, self._wanted.dtype)
        output = run_session(self.session, self.path, {self._wanted.name: values}, seconds=seconds)[0]
        if output.ndim < 2 or len(output) != len(crops) or output[0].size != output.shape[1]:
            raise RequestError(f"{self.path}: expected features (N, D), got {output.shape} for {len(crops)} crops")
        return output.reshape(len(crops), -1).astype(np.float64)
