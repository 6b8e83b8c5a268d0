"""Siamese trackers that others or this toolkit exported: a template of the target, and its response in a wider picture.

A network of this kind sees two square pictures. The template shows the target and its surroundings. The search picture
shows a wider square of another frame. For each cell of a grid the network says how likely the target is there, and
which box it has. The layout is recognised by inputs and outputs:

* NanoTrack (after Yan et al., "LightTrack", CVPR 2021): a backbone of one picture, and a head of two maps of features,
  which gives logits of two classes and distances to the sides of the box;
* VitTrack of OpenCV's zoo: one file of two pictures, which gives maps of confidence, size and offset;
* the toolkit's own: ``template.onnx`` gives ``features``; ``search.onnx`` takes them and the picture ``search``, and
  gives ``scores`` ``(1, 1, S, S)`` in [0, 1] and ``boxes`` ``(1, 4, S, S)``, distances to left, top, right and bottom
  from the centre of each cell, pixels of the search picture. Cells lie ``stride`` pixels apart about its middle. Both
  files carry a `ModelCard` of kind ``tracker``; ``stride`` is one of its settings.

The template square of a target of width w and height h has the side sqrt((w + p) (h + p)), p = (w + h) / 2 (Bertinetto
et al., "Fully-convolutional Siamese networks", 2016, eq. 7). VitTrack's is 2 sqrt(w h).
"""

from __future__ import annotations

import math
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.foreign_options import IMAGENET_MEAN, IMAGENET_STD
from tsuiseki.tracking.network_trial import noise
from tsuiseki.tracking.onnx import (
    METADATA_KEY,
    RUN_SECONDS,
    TRIAL_SECONDS,
    OnnxModel,
    open_session,
    run_session,
)
from tsuiseki.tracking.preprocessing import standardised
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.weights import shipped_or_file

if TYPE_CHECKING:
    import onnxruntime

# What a network keeps of a target, in whatever shape.
Template = NDArray[np.float32]

# Side of NanoTrack's template picture, pixels.
NANO_TEMPLATE = 127
# Side of its search picture, pixels, where the file leaves it open.
NANO_SEARCH = 255
# Distance of two of its cells, pixels of the search picture.
NANO_STRIDE = 16.0
EXPECTED = (
    "expected a tracker of one target: NanoTrack's backbone and head, VitTrack's one file, or template.onnx and "
    "search.onnx of `tsuiseki export tracker`"
)


@dataclass(frozen=True)
class Square:
    """A square of whole pixels of an image, which may reach beyond it.

    Attributes:
        left: of its first column.
        top: of its first row.
        side: pixels, > 0.
    """

    left: int
    top: int
    side: int

    @classmethod
    def about(cls, centre: FloatArray, side: float) -> Square:
        """The one nearest to the square of ``side`` about ``centre`` ``(2,)``."""
        whole = max(round(side), 2)
        left, top = np.round(centre - whole / 2).astype(int).tolist()
        return cls(left, top, whole)

    @property
    def centre(self) -> FloatArray:
        return np.array([self.left, self.top]) + self.side / 2

    def crop(self, image: ImageArray, pixels: int) -> ImageArray:
        """``(pixels, pixels, 3)`` this part of ``(H, W, 3)``; what is outside has the image's mean colour."""
        height, width = image.shape[:2]
        right, bottom = self.left + self.side, self.top + self.side
        x1, x2 = (min(max(x, 0), width) for x in (self.left, right))
        y1, y2 = (min(max(y, 0), height) for y in (self.top, bottom))
        part = image[y1:y2, x1:x2]
        if part.shape[:2] != (self.side, self.side):
            whole = np.empty((self.side, self.side, 3), dtype=np.uint8)
            whole[:] = np.round(cv2.mean(image)[:3])
            if part.size:
                whole[y1 - self.top : y2 - self.top, x1 - self.left : x2 - self.left] = part
            part = whole
        return np.asarray(cv2.resize(part, (pixels, pixels)), dtype=np.uint8)


@dataclass(frozen=True)
class Response:
    """What a network says of a search square.

    Attributes:
        scores: ``(S, S)`` in [0, 1], how likely the target is at each cell.
        boxes: ``(S, S, 4)`` corners that each cell gives it, from the middle of the square, pixels of the search
            picture.
    """

    scores: FloatArray
    boxes: FloatArray


class SiameseNetwork(ABC):
    """A tracker's network, whatever its layout.

    Attributes:
        template_pixels: side of the template picture.
        search_pixels: side of the search picture.
        context: side of the search square over that of the template square.
        filter_share: of a correlation filter's vote beside the response (`filter_vote`); 0 for none.
    """

    filter_share: float = 0.0
    template_pixels: int
    search_pixels: int

    @property
    def context(self) -> float:
        return self.search_pixels / self.template_pixels

    def template_side(self, size: FloatArray) -> float:
        """Side of the template square, pixels of the image, of a target of ``size`` ``(2,)``."""
        return square_side(size)

    def search_square(self, centre: FloatArray, size: FloatArray) -> Square:
        """Where a target of ``size`` ``(2,)`` is searched about ``centre`` ``(2,)``."""
        return Square.about(centre, self.context * self.template_side(size))

    def boxes_in_image(self, response: Response, square: Square) -> FloatArray:
        """``(S, S, 4)`` corners in pixels of the image."""
        return response.boxes * (square.side / self.search_pixels) + np.tile(square.centre, 2)

    @abstractmethod
    def template(self, image: ImageArray, square: Square) -> Template:
        """What the network keeps of the target in a square of an image ``(H, W, 3)``."""

    @abstractmethod
    def respond(self, image: ImageArray, square: Square, templates: Sequence[Template]) -> list[Response]:
        """The response of each template in a search square; what they share is computed once."""


def square_side(size: FloatArray) -> float:
    """Side of the square about a target of width and height ``(2,)``, see the module.

    >>> square_side(np.array([10.0, 10.0]))
    20.0
    """
    return math.sqrt(float(np.prod(size + size.mean())))


def size_change(sizes: FloatArray, side: float, shape: float) -> FloatArray:
    """``(S, S)`` how many times larger or smaller squares about ``sizes`` are than one of a side, times that of shapes.

    Args:
        sizes: ``(S, S, 2)`` widths and heights.
        side: of the square that they are compared with, in their unit.
        shape: width over height that theirs are compared with.
    """
    size = np.sqrt(np.prod(sizes + sizes.mean(axis=-1, keepdims=True), axis=-1)) / side
    shapes = shape * sizes[..., 1] / sizes[..., 0]
    return np.asarray(np.maximum(size, 1 / size) * np.maximum(shapes, 1 / shapes))


def cell_centres(count: int, stride: float, middle: float) -> FloatArray:
    """``(count, count, 4)`` x, y, x, y of the cells' centres, in ``stride`` from the cell number ``middle``."""
    steps = (np.arange(count) - middle) * stride
    x, y = np.meshgrid(steps, steps)
    return np.stack([x, y, x, y], axis=-1)


def from_distances(distances: NDArray[np.float32], centres: FloatArray) -> FloatArray:
    """``(S, S, 4)`` corners from ``(4, S, S)`` distances to left, top, right and bottom."""
    return np.asarray(centres + np.moveaxis(distances, 0, -1) * np.array([-1.0, -1.0, 1.0, 1.0]))


class NanoTrack(SiameseNetwork):
    """NanoTrack: a backbone, whose picture may be of both sizes, and a head.

    Raises:
        RequestError: the head does not give two classes and four distances.
    """

    def __init__(self, backbone: Path, head: Path) -> None:
        self._path, self._backbone = backbone, open_session(backbone, threads=1)
        picture = self._backbone.get_inputs()[0]
        self.template_pixels, self.search_pixels, self._picture = NANO_TEMPLATE, NANO_SEARCH, picture.name
        if isinstance(picture.shape[-1], int):
            self.search_pixels = _side(picture.shape, backbone)
            self._backbone = _of_any_side(backbone, self.search_pixels)
        self._head_path, self._head = head, open_session(head, threads=1)
        names, shapes = zip(*((x.name, x.shape) for x in self._head.get_inputs()), strict=True)
        # The template's map is the smaller one.
        self._inputs = tuple(names[k] for k in np.argsort([shape[-1] for shape in shapes], kind="stable"))
        trial, square = noise(*(self.search_pixels,) * 2)[0], Square(0, 0, self.search_pixels)
        scores, boxes = self._maps(self._features(trial, TRIAL_SECONDS), self.template(trial, square), TRIAL_SECONDS)
        if scores.shape[0] != 2 or boxes.shape[0] != 4 or scores.shape[1:] != boxes.shape[1:]:
            raise RequestError(
                f"{head}: expected maps of 2 classes and 4 distances, got {scores.shape} and {boxes.shape}"
            )
        self._centres = cell_centres(scores.shape[-1], NANO_STRIDE, scores.shape[-1] // 2)

    def template(self, image: ImageArray, square: Square) -> Template:
        return self._features(square.crop(image, self.template_pixels))

    def respond(self, image: ImageArray, square: Square, templates: Sequence[Template]) -> list[Response]:
        features = self._features(square.crop(image, self.search_pixels))
        maps = [self._maps(features, template) for template in templates]
        return [
            Response(1 / (1 + np.exp(np.clip(logits[0] - logits[1], -60, 60).astype(np.float64))),
                     from_distances(distances, self._centres))
            for logits, distances in maps
        ]  # fmt: skip

    def _features(self, picture: ImageArray, seconds: float = RUN_SECONDS) -> Template:
        values = standardised(picture[None], 1.0, (0.0,) * 3, (1.0,) * 3)
        return run_session(self._backbone, self._path, {self._picture: values}, seconds=seconds)[0]

    def _maps(
        self, features: Template, template: Template, seconds: float = RUN_SECONDS
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        inputs = dict(zip(self._inputs, (template, features), strict=True))
        outputs = run_session(self._head, self._head_path, inputs, seconds=seconds)
        classes, distances = sorted((output[0] for output in outputs[:2]), key=len)
        return classes, distances


class VitTrack(SiameseNetwork):
    """VitTrack: one file of both pictures. It keeps the template picture itself.

    Raises:
        RequestError: it does not give confidence, size and offset.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._session = path, open_session(path, threads=1)
        inputs = sorted(self._session.get_inputs(), key=lambda x: _side(x.shape, path))
        self._names = [x.name for x in inputs]
        self.template_pixels, self.search_pixels = (_side(x.shape, path) for x in inputs)
        trial = noise(*(self.search_pixels,) * 2)[0]
        square = Square(0, 0, self.search_pixels)
        outputs = self._maps(trial, self.template(trial, square), TRIAL_SECONDS)
        count = outputs[0].shape[-1]
        if [x.shape for x in outputs] != [(channels, count, count) for channels in (1, 2, 2)]:
            shapes = " and ".join(str(x.shape) for x in outputs)
            raise RequestError(f"{path}: expected maps of confidence, size and offset, got {shapes}")
        self._cells = cell_centres(count, 1.0, 0.0)[..., :2]

    def template_side(self, size: FloatArray) -> float:
        return 2 * math.sqrt(float(np.prod(size)))

    def template(self, image: ImageArray, square: Square) -> Template:
        return _as_imagenet(square.crop(image, self.template_pixels))

    def respond(self, image: ImageArray, square: Square, templates: Sequence[Template]) -> list[Response]:
        picture = square.crop(image, self.search_pixels)
        return [self._decoded(*self._maps(picture, template)) for template in templates]

    def _maps(self, picture: ImageArray, template: Template, seconds: float = RUN_SECONDS) -> list[Template]:
        values = dict(zip(self._names, (template, _as_imagenet(picture)), strict=True))
        return [output[0] for output in run_session(self._session, self._path, values, seconds=seconds)[:3]]

    def _decoded(self, confidence: Template, size: Template, offset: Template) -> Response:
        """Sizes are shares of the picture, and offsets shares of a cell from its upper left corner."""
        middle = (self._cells + np.moveaxis(offset, 0, -1)) / confidence.shape[-1] - 0.5
        half = np.moveaxis(size, 0, -1) / 2
        return Response(
            np.clip(confidence[0].astype(np.float64), 0, 1),
            np.concatenate([middle - half, middle + half], axis=-1) * self.search_pixels,
        )


class OwnTracker(SiameseNetwork):
    """The toolkit's own, of two files with their cards.

    Raises:
        RequestError: a card or a shape is another than the layout's, see the module.
    """

    # Its boxes gain from a filter's; those of a network that saw more of the world do not.
    filter_share = 0.4

    def __init__(self, template: Path, search: Path) -> None:
        self._describing, self._searching = (OnnxModel(path, "tracker", threads=1) for path in (template, search))
        self.template_pixels = self._describing.card.input_width
        self.search_pixels = self._searching.card.input_width
        trial = noise(*(self.search_pixels,) * 2)[0]
        features = self.template(trial, Square(0, 0, self.search_pixels))
        scores, boxes = self._maps(trial, features)
        count = scores.shape[-1]
        stride = float(self._searching.card.settings.get("stride", 0))
        if scores.shape != (1, count, count) or boxes.shape != (4, count, count) or not stride > 0:
            raise RequestError(
                f"{search}: expected scores (1, S, S), boxes (4, S, S) and a `stride` above 0, got {scores.shape}, "
                f"{boxes.shape} and {stride:g}; export it again with `tsuiseki export tracker`"
            )
        self._centres = cell_centres(count, stride, (count - 1) / 2)

    def template(self, image: ImageArray, square: Square) -> Template:
        card = self._describing.card
        values = standardised(square.crop(image, self.template_pixels)[None], 255.0, card.mean, card.std)
        return self._describing.run(values)[0]

    def respond(self, image: ImageArray, square: Square, templates: Sequence[Template]) -> list[Response]:
        picture = square.crop(image, self.search_pixels)
        maps = [self._maps(picture, template) for template in templates]
        return [
            Response(np.clip(scores[0].astype(np.float64), 0, 1), from_distances(distances, self._centres))
            for scores, distances in maps
        ]

    def _maps(self, picture: ImageArray, template: Template) -> tuple[Template, Template]:
        card = self._searching.card
        inputs = {"features": template, "search": standardised(picture[None], 255.0, card.mean, card.std)}
        scores, boxes = run_session(self._searching.session, self._searching.path, inputs, ["scores", "boxes"])
        return scores[0], boxes[0]


def open_network(files: Sequence[str | Path]) -> SiameseNetwork:
    """The tracker's network in one or two ONNX files, in any order.

    Args:
        files: paths; the name of one in the catalogue stands for its file.

    Raises:
        RequestError: of `open_session`; or they are of no layout that is known.
    """
    paths = [shipped_or_file("tracker", file) for file in files]
    sessions = [open_session(path, threads=1) for path in paths]
    shapes = [[list(x.shape) for x in session.get_inputs()] for session in sessions]
    pictures = [sum(len(shape) == 4 and shape[1] == 3 for shape in of) for of in shapes]
    inputs = [len(of) for of in shapes]
    named = [{x.name for x in session.get_inputs()} for session in sessions]
    carded = all(METADATA_KEY in session.get_modelmeta().custom_metadata_map for session in sessions)
    if (inputs, pictures) == ([2], [2]):
        return VitTrack(paths[0])
    if sorted(inputs) == [1, 2]:
        first, second = sorted(range(2), key=inputs.__getitem__)
        if carded and named[first] == {"template"} and named[second] == {"features", "search"}:
            return OwnTracker(paths[first], paths[second])
        if (pictures[first], pictures[second]) == (1, 0):
            return NanoTrack(paths[first], paths[second])
    got = "; ".join(f"{path.name} of {_listed(session)}" for path, session in zip(paths, sessions, strict=True))
    raise RequestError(f"`network`: {EXPECTED}; got {got or 'no file'}")


def _listed(session: onnxruntime.InferenceSession) -> str:
    return ", ".join(f"{x.name} {'x'.join(map(str, x.shape))}" for x in session.get_inputs())


def _side(shape: Sequence[int | str | None], path: Path) -> int:
    """Side of a square picture ``(N, 3, H, W)``."""
    height, width = shape[-2:]
    if not isinstance(width, int) or height != width:
        raise RequestError(f"{path}: expected square pictures of one size, got {'x'.join(map(str, shape))}")
    return width


def _as_imagenet(picture: ImageArray) -> Template:
    return standardised(picture[None], 255.0, IMAGENET_MEAN, IMAGENET_STD)


def _of_any_side(path: Path, side: int) -> onnxruntime.InferenceSession:
    """A backbone for square pictures of any side, whose file names one.

    Its layers take any side; only the sizes that the file declares for its input stand in the way. In the file (ONNX
    is a protocol buffer) they are the fields ``dim_value`` of the input's shape: each becomes a ``dim_param``, a name
    as long as the number was.

    Raises:
        RequestError: the file declares its size otherwise.
    """
    number = bytes([0x08, side & 0x7F | 0x80, side >> 7])
    length, names = bytes([0x0A, len(number)]), (b"\x12\x01h", b"\x12\x01w")
    content = path.read_bytes()
    if content.count((length + number) * 2) != 1:
        raise RequestError(f"{path}: expected one picture of {side}x{side}; export it again with sides of any length")
    content = content.replace((length + number) * 2, b"".join(length + name for name in names))
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "backbone.onnx"
        copy.write_bytes(content)
        return open_session(copy, threads=1)
