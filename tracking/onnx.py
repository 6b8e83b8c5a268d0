"""Exported models: the file, its contract in the metadata, and the check of both.

Every file carries one JSON text under the metadata key ``tsuiseki``: the fields of `ModelCard`. A file without it,
of another kind or of a newer format version is refused with what was expected and what came.
"""

from __future__ import annotations

import dataclasses
import json
import os
import re
import shutil
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.devices import Device, device_of, opened_on
from tsuiseki.tracking.errors import RequestError, a_path, lacks_memory
from tsuiseki.tracking.openers.json_files import json_of
from tsuiseki.tracking.openvino_session import FORMATS, OpenvinoSession

if TYPE_CHECKING:
    import onnxruntime

Kind = Literal["detector", "appearance", "action", "affinity", "association", "objectness", "quality", "tracker"]
METADATA_KEY = "tsuiseki"
# Of the card; a file of a later one is refused.
FORMAT_VERSION = 1
# Longest that a call of a network may take, seconds: it is stopped rather than waited for without end.
RUN_SECONDS = 600.0
# The same of a trial before the first frame, of one or two rows.
TRIAL_SECONDS = 30.0
_PIXELS = {"tensor(float)": "float32", "tensor(float16)": "float16", "tensor(uint8)": "uint8"}
# How a file names another that holds weights: the key, then the length of the name and the name itself.
_WEIGHTS_AT = re.compile(rb"\n\x08location\x12([\x01-\x7f])")


class MissingCardError(RequestError):
    """An ONNX file that this toolkit has not exported."""


@dataclass(frozen=True)
class ModelCard:
    """What a model expects and gives.

    Attributes:
        kind: what the model does.
        format_version: of this contract; a reader refuses newer ones.
        name: architecture, for people to read.
        class_names: what each output class means, without the background; for affinities the feature names.
        input_height: of the network's input, pixels; 0 where the input is no image.
        input_width: of the network's input, pixels; 0 where the input is no image.
        resize: ``letterbox`` keeps the aspect ratio and pads right and below with the mean, ``stretch`` does not.
        layout: ``NCHW`` for images, ``NF`` for feature rows.
        colour_order: ``RGB``, of all.
        mean: subtracted from the channels after scaling them to [0, 1].
        std: divides the channels after that.
        feature_length: of an appearance feature; 0 otherwise.
        settings: numbers that only this kind has (detector: variances of the box code; affinity: alpha, beta, ...).
        training_data: what the weights were fitted to, in words.
        licence: of the weights, by its SPDX identifier; empty where nobody has said.
        project_version: of the toolkit that wrote the file.
    """

    kind: Kind
    name: str
    class_names: tuple[str, ...] = ()
    input_height: int = 0
    input_width: int = 0
    resize: Literal["letterbox", "stretch"] = "stretch"
    layout: Literal["NCHW", "NF"] = "NCHW"
    colour_order: ClassVar[str] = "RGB"
    mean: tuple[float, ...] = (0.485, 0.456, 0.406)
    std: tuple[float, ...] = (0.229, 0.224, 0.225)
    feature_length: int = 0
    settings: dict[str, Any] = field(default_factory=dict)
    training_data: str = ""
    licence: str = ""
    project_version: str = ""
    format_version: int = FORMAT_VERSION

    def to_json(self) -> str:
        """The text that goes under `METADATA_KEY`."""
        return json.dumps({**dataclasses.asdict(self), "colour_order": self.colour_order}, sort_keys=True)

    @classmethod
    def from_json(cls, text: str, where: str = METADATA_KEY) -> ModelCard:
        """The card in ``text``, which messages look for in ``where``; raises ValueError where it is none."""
        values = json_of(text, where, "a model card")
        if not isinstance(values, dict) or {"kind", "name", "format_version"} - values.keys():
            raise ValueError("no model card")
        if values["format_version"] > FORMAT_VERSION:
            raise ValueError(f"format version {values['format_version']}")
        names = {f.name for f in dataclasses.fields(cls)}
        values = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items() if k in names}
        return cls(**values)


@dataclass(frozen=True)
class WantedInput:
    """The picture that a network takes.

    Attributes:
        name: of the input.
        shape: ``(N, 3, H, W)`` or ``(3, H, W)``; text where an axis is open.
        dtype: float32, float16, or uint8 of a network that normalises its pictures itself.
    """

    name: str
    shape: tuple[int | str | None, ...]
    dtype: np.dtype[Any]


def cores_of(threads: int, option: str = "threads") -> int:
    """``threads``, or for 0 the number of cores that this process may use."""
    if not isinstance(threads, int) or threads < 0:
        raise RequestError(f"`{option}`: expected 0 or more, got {threads}")
    if threads:
        return threads
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def open_session(
    path: str | Path, threads: int = 0, device: Device = "cpu"
) -> onnxruntime.InferenceSession | OpenvinoSession:
    """The network at ``path``, ready to run.

    Args:
        path: an ONNX file, or one in a format that OpenVINO reads, see `OpenvinoSession`.
        threads: CPU threads of a call; 0 takes all cores.
        device: what to run on, see `opened_on`.

    Raises:
        RequestError: the file or one of its weights is missing, it is not ONNX, or newer than onnxruntime can read; or
            the device does not work.
    """
    import onnxruntime

    path = a_path(path)
    if path.suffix.lower() in FORMATS:
        if device == "cuda":
            raise RequestError(f"`device`: expected auto or cpu, for {path} runs on the CPU only, got cuda")
        return OpenvinoSession(path, cores_of(threads))
    if not path.is_file():
        raise RequestError(f"expected an ONNX file at {path}, found none; check the path, or export one")
    weights = weight_files(path)
    for file in weights:
        if not file.is_file():
            raise RequestError(f"{path}: expected its weights in {file}, found none; keep both files together")
    options = onnxruntime.SessionOptions()
    # By itself onnxruntime would bind its threads to cores, where other work of this program may be.
    options.intra_op_num_threads = cores_of(threads)
    options.log_severity_level = 4

    def create(providers: list[str]) -> onnxruntime.InferenceSession:
        # Left to itself, onnxruntime goes over to the CPU without a word.
        return onnxruntime.InferenceSession(name, options, providers=providers, enable_fallback=0)

    try:
        with _plain_name(path, weights) as name:
            return opened_on(device, create)
    except RequestError:
        raise
    except Exception as error:
        if lacks_memory(error):
            raise MemoryError(f"{path} needs more") from error
        newer = re.search(r"(opset|IR version:) (\d+)", str(error), re.IGNORECASE)
        if newer:
            what = newer.group(1).replace(":", "").replace("Opset", "opset")
            raise RequestError(
                f"{path}: its {what} {newer.group(2)} is newer than onnxruntime {onnxruntime.__version__} "
                "reads; export it with a lower opset, such as 17"
            ) from error
        raise RequestError(
            f"{path} is not a readable ONNX model; export it again; onnxruntime says: {_reason(error)}"
        ) from error


@contextmanager
def _plain_name(path: Path, weights: Sequence[Path]) -> Iterator[str]:
    """The name of an ONNX file for onnxruntime, which takes UTF-8 only: of a copy for now, where it is another."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        with TemporaryDirectory() as folder:
            for file in weights:
                copy = Path(folder) / file.relative_to(path.parent)
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, copy)
            yield str(shutil.copyfile(path, Path(folder) / "model.onnx"))
    else:
        yield str(path)


def weight_files(path: Path) -> list[Path]:
    """The files beside the ONNX file at ``path`` that hold weights of it.

    Raises:
        RequestError: one lies outside its folder.
    """
    content = path.read_bytes()
    names = {content[at.end() : at.end() + at[1][0]].decode(errors="replace") for at in _WEIGHTS_AT.finditer(content)}
    if outside := [name for name in names if Path(name).is_absolute() or ".." in Path(name).parts]:
        raise RequestError(f"{path}: expected its weights in its own folder, got {min(outside)}; export it again")
    return [path.parent / name for name in sorted(names)]


def run_session(
    session: onnxruntime.InferenceSession | OpenvinoSession,
    path: Path,
    inputs: Mapping[str, NDArray[Any]],
    outputs: Sequence[str] | None = None,
    seconds: float = RUN_SECONDS,
) -> list[NDArray[Any]]:
    """The named outputs of a network of others for ``inputs`` by name; by default all, in the order of the file.

    Args:
        session: of the network.
        path: of its file, for messages.
        inputs: arrays by name.
        outputs: names of those that are computed.
        seconds: after which the network is stopped.

    Raises:
        RequestError: the network cannot work on them, with onnxruntime's reason, in one line; or does not end in time.
    """
    import onnxruntime

    options = onnxruntime.RunOptions()
    options.log_severity_level = 4
    bound = threading.Timer(seconds, setattr, (options, "terminate", True))
    bound.daemon = True
    try:
        bound.start()
        arrays: list[NDArray[Any]] = session.run(outputs, dict(inputs), options)
    except Exception as error:
        if options.terminate:
            raise RequestError(
                f"{path}: expected the network to end within {seconds:g} s, it did not; does it hold a loop without "
                "an end? export it again"
            ) from error
        if lacks_memory(error):
            raise MemoryError(f"{path} needs more") from error
        runtime = "OpenVINO" if isinstance(session, OpenvinoSession) else "onnxruntime"
        raise RequestError(f"{path}: the network refuses its input; {runtime} says: {_reason(error)}") from error
    finally:
        bound.cancel()
    return arrays


def _reason(error: Exception) -> str:
    """What onnxruntime says, in one line of bearable length, without the path that is named before it."""
    words = " ".join(str(error).split())
    return words.rpartition(" failed:")[2][:160]


def image_input(
    session: onnxruntime.InferenceSession | OpenvinoSession, path: Path, *, floats: bool = False
) -> WantedInput:
    """The picture that a network of others takes; ``floats`` refuses bytes, ``path`` is for messages.

    Raises:
        RequestError: its input is no one picture with the channels before the rows.
    """
    pictures = [x for x in session.get_inputs() if len(x.shape) in (3, 4) and x.type in _PIXELS]
    if len(pictures) > 1:
        named = " and ".join(f"{x.name} {_shown(x.shape)}" for x in pictures)
        raise RequestError(f"{path}: expected one picture as input, got {named}; export a network of one picture")
    first = pictures[0] if pictures else session.get_inputs()[0]
    shape, shape_text = tuple(first.shape), _shown(first.shape)
    if first.type not in _PIXELS or (floats and _PIXELS[first.type] == "uint8"):
        kind = first.type.removeprefix("tensor(").removesuffix(")")
        raise RequestError(f"{path}: expected a float32 or float16 input, got {kind}; export it with floats in")
    if len(shape) not in (3, 4):
        raise RequestError(f"{path}: expected pictures (N, 3, H, W) as input, got {first.name} {shape_text}")
    if shape[-3] != 3 and shape[-1] == 3:
        raise RequestError(
            f"{path}: expected the channels before the rows (N, 3, H, W), got {shape_text}; export it as NCHW"
        )
    if isinstance(shape[-3], int) and shape[-3] != 3:
        raise RequestError(f"{path}: expected pictures of 3 channels, got {first.name} {shape_text}")
    if len(shape) == 4 and isinstance(shape[0], int) and shape[0] != 1:
        raise RequestError(f"{path}: expected a batch of 1 or any, got {shape[0]}; export it with batch 1")
    return WantedInput(first.name, shape, np.dtype(_PIXELS[first.type]))


def _shown(shape: Sequence[object]) -> str:
    return "x".join(str(x) for x in shape)


def byte_image_input(session: onnxruntime.InferenceSession | OpenvinoSession, path: Path) -> WantedInput:
    """The picture ``(N, H, W, 3)`` uint8 that a network takes which normalises it itself.

    Raises:
        RequestError: its input is another.
    """
    first = session.get_inputs()[0]
    shape, kind = tuple(first.shape), first.type.removeprefix("tensor(").removesuffix(")")
    one_or_any = len(shape) == 4 and not (isinstance(shape[0], int) and shape[0] != 1)
    if kind != "uint8" or not one_or_any or shape[3] != 3:
        raise RequestError(
            f"{path}: expected pictures (N, H, W, 3) of uint8, N 1 or any, as input of a file of TensorFlow's, got "
            f"{first.name} {_shown(shape)} {kind}; convert it again from `image_tensor`"
        )
    return WantedInput(first.name, shape, np.dtype(np.uint8))


def card_of(path: str | Path) -> ModelCard:
    """The card of the ONNX file at ``path``, of whatever kind.

    Raises:
        RequestError: the file is missing or not ONNX, or carries no card.
    """
    text = open_session(path, threads=1).get_modelmeta().custom_metadata_map.get(METADATA_KEY, "")
    try:
        return ModelCard.from_json(text, str(path))
    except ValueError as error:
        raise MissingCardError(
            f"{path}: expected the metadata of a network of tsuiseki, got none; export it"
        ) from error


def kind_of(path: str | Path) -> str:
    """What the ONNX file at ``path`` says it is; empty where it says nothing.

    Raises:
        RequestError: the file is missing or not ONNX.
    """
    text = open_session(path, threads=1).get_modelmeta().custom_metadata_map.get(METADATA_KEY, "{}")
    try:
        return str(json_of(text, str(path), "a model card").get("kind", ""))
    except (ValueError, AttributeError):
        return ""


class OnnxModel:
    """An exported model in an onnxruntime session, with its card.

    Args:
        path: the ONNX file.
        kind: what the caller needs the model to be.
        threads: CPU threads of a call; 0 takes all cores.
        device: what to run on, see `opened_on`.

    Attributes:
        device: what it runs on, ``cuda`` or ``cpu``.

    Raises:
        RequestError: see `open_session`; or it is without a card (`MissingCardError`), of another kind or of a newer
            format version.
    """

    def __init__(self, path: str | Path, kind: Kind, threads: int = 0, device: Device = "cpu") -> None:
        self.path = a_path(path)
        self.session = open_session(path, threads, device)
        self.device = device_of(self.session)
        self.card = self._read_card(kind)
        self.input_names = [x.name for x in self.session.get_inputs()]
        self.output_names = [x.name for x in self.session.get_outputs()]

    def _read_card(self, kind: Kind) -> ModelCard:
        metadata = self.session.get_modelmeta().custom_metadata_map
        if METADATA_KEY not in metadata:
            raise MissingCardError(
                f"{self.path} is ONNX but carries no tsuiseki metadata; export it with `tsuiseki export {kind}`"
            )
        try:
            card = ModelCard.from_json(metadata[METADATA_KEY], str(self.path))
        except RequestError:
            raise
        except (ValueError, TypeError) as error:
            raise RequestError(
                f"{self.path}: expected metadata of format version up to {FORMAT_VERSION}, got {error}; "
                "update tsuiseki or export the model again"
            ) from error
        if card.kind != kind:
            raise RequestError(f"{self.path}: expected a model of kind {kind!r}, got {card.kind!r}")
        return card

    def run(self, *inputs: NDArray[Any]) -> list[NDArray[Any]]:
        """The outputs for ``inputs``, in the order of the file."""
        return run_session(self.session, self.path, self._named(inputs))

    def _named(self, inputs: Sequence[NDArray[Any]]) -> dict[str, NDArray[Any]]:
        return dict(zip(self.input_names, inputs, strict=True))

    def try_out(self, *inputs: NDArray[Any]) -> list[NDArray[Any]]:
        """As `run`, before the first frame: it ends within `TRIAL_SECONDS`."""
        return run_session(self.session, self.path, self._named(inputs), seconds=TRIAL_SECONDS)
