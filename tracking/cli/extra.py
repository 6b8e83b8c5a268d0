"""One clear line where the `train` extra is missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from tsuiseki.tracking.errors import RequestError

TRAIN_PACKAGES = ("torch", "torchvision", "lightning", "onnx", "onnxscript", "sklearn", "skl2onnx", "tensorboard")


@contextmanager
def needs_train_extra() -> Iterator[None]:
    """Import what trains within the ``with`` block.

    Raises:
        RequestError: a package of the extra is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] not in TRAIN_PACKAGES:
            raise
        raise RequestError(
            f"training needs {error.name}, which is not installed; install the extra: pip install 'tsuiseki[train]'"
        ) from error
