"""What a training refuses, in a line each: checkpoints that are none, and what other libraries say at length."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import torch

from tsuiseki.tracking.errors import RequestError, lacks_memory

# What a training that goes on needs of a checkpoint.
CHECKPOINT_PARTS = {"state_dict", "optimizer_states", "lr_schedulers", "loops", "pytorch-lightning_version"}
# How torch says that weights, or what moves them, are another network's.
FOREIGN_WEIGHTS = ("Error(s) in loading state_dict", "loaded state dict")


def checkpoint_content(path: Path, device: str, of: str) -> Any:
    """What a checkpoint ``of`` a training holds, on a device; nothing but tensors and plain values is unpickled.

    Raises:
        RequestError: it is none.
    """
    try:
        return torch.load(path, map_location=device, weights_only=True)
    except Exception as error:  # torch reads bytes as orders, so that a foreign file may end in any error
        if lacks_memory(error):
            raise
        raise RequestError(f"{path}: expected a checkpoint of {of}, got something else") from error


def check_checkpoint(path: Path) -> None:
    """Refuse a file that is no checkpoint of a training; raises RequestError."""
    held = checkpoint_content(path, "meta", "a training")
    missing = sorted(CHECKPOINT_PARTS - set(held)) if isinstance(held, dict) else ["parts of a training"]
    if missing:
        raise RequestError(f"{path}: expected a checkpoint of a training, found no {missing[0]} in it")


def in_one_line(error: Exception) -> RequestError | None:
    """What a training refused in a process that prepares images, or of a checkpoint; None where it is neither."""
    text = str(error)
    if isinstance(error, RequestError) and "RequestError: " in text:
        # Torch puts the trace of the process before the message.
        return RequestError(text.rpartition("RequestError: ")[2].strip())
    if text.startswith(FOREIGN_WEIGHTS):
        return RequestError(f"--ckpt_path: expected a checkpoint of this network, got another: {one_line(error)[:200]}")
    return None


def one_line(error: Exception) -> str:
    """The message of a parser's ``error`` without its line breaks, and without the types that were not meant."""
    reason = re.search(r"^  - (.+(?:\n    +.+)*)", str(error), re.MULTILINE)
    return " ".join((str(error) if reason is None else reason[1]).split())
