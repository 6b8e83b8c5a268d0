"""What networks run on: the CPU, or a CUDA GPU where the GPU build of onnxruntime is installed and works."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable
from contextlib import redirect_stdout
from typing import TYPE_CHECKING, Literal, get_args

from tsuiseki.tracking.errors import InputWarning, RequestError

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

    from tsuiseki.tracking.openvino_session import OpenvinoSession

Device = Literal["auto", "cpu", "cuda"]
CPU, CUDA = "CPUExecutionProvider", "CUDAExecutionProvider"
RECIPE = "see docs/how-to/use-a-gpu.md"


def opened_on(device: Device, create: Callable[[list[str]], InferenceSession]) -> InferenceSession:
    """A session on ``device``; ``auto`` takes CUDA where it works, and warns where it is installed and does not.

    Args:
        device: what to run on. TensorRT is never taken.
        create: makes a session for onnxruntime's names of providers, the first that works first; it raises where the
            model is at fault.

    Raises:
        RequestError: there is no such device, or CUDA is asked for and does not work.
    """
    import onnxruntime

    if device not in get_args(Device):
        raise RequestError(f"`device`: expected auto, cpu or cuda, got {device!r}")
    onnxruntime.set_default_logger_severity(4)  # what goes to the terminal in C++ comes as an exception, too
    there = CUDA in onnxruntime.get_available_providers()
    if device == "cuda" and not there:
        raise RequestError(
            f"`device`: expected an onnxruntime with CUDA, got {onnxruntime.__version__} without; {RECIPE}"
        )
    if device == "cpu" or not there:
        return create([CPU])
    with redirect_stdout(io.StringIO()):
        getattr(onnxruntime, "preload_dlls", lambda: None)()  # loads CUDA from packages of pip
    try:
        session = create([CUDA, CPU])
        reason = "CUDA or cuDNN is missing, or of another version"
    except Exception as error:
        session, reason = create([CPU]), " ".join(str(error).split())[:160]
    if device_of(session) == "cuda":
        return session
    failed = f"onnxruntime {onnxruntime.__version__} cannot use the GPU: {reason}; {RECIPE}"
    if device == "cuda":
        raise RequestError(f"`device`: {failed}, or take cpu")
    warnings.warn(f"{failed}; networks run on the CPU", InputWarning, stacklevel=2)
    return session


def device_of(session: InferenceSession | OpenvinoSession) -> str:
    """``cuda`` or ``cpu``: what a session runs on."""
    return "cuda" if session.get_providers()[0] == CUDA else "cpu"
