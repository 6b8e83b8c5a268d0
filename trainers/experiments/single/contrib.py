"""A tracker of OpenCV-contrib beside ours, run by the Python of an environment of its own.

Its package replaces the one that ours needs, so the two do not live in one environment.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.geometry import corners_from_xywh, xywh_from_corners
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.trainers.experiments.peers import find_peer

SCRIPT = Path(__file__).with_name("contrib_csrt.py")


@dataclass(frozen=True)
class Contrib:
    """CSRT of OpenCV-contrib.

    Attributes:
        version: of OpenCV, as that Python says.
        scales: how many sizes it tries; 1 keeps the first.
        python: of its environment.
    """

    version: str
    scales: int
    python: str


def find_contrib(python: Path, scales: int) -> Contrib:
    """CSRT of the environment of ``python``; 33 ``scales`` are its own choice.

    Raises:
        RequestError: that Python has no OpenCV-contrib.
    """
    found = find_peer(str(python), SCRIPT, "opencv-contrib-python-headless", "`contrib`")
    assert found is not None
    return Contrib(found.version, scales, found.python)


def follow_with_contrib(settings: Contrib, images: Sequence[ImageArray], box: FloatArray) -> FloatArray:
    """Boxes ``(T, 4)`` from the first one on; where it reports a failure the box before stands.

    Raises:
        RunError: the other Python broke off.
    """
    head = {
        "scales": settings.scales,
        "box": xywh_from_corners(box).tolist(),
        "shape": images[0].shape,
        "count": len(images),
    }
    with subprocess.Popen([settings.python, str(SCRIPT)], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        with suppress(BrokenPipeError), process.stdin as sent:
            sent.write(json.dumps(head).encode() + b"\n")
            for image in images:
                sent.write(np.ascontiguousarray(image[:, :, ::-1]).tobytes())
        answer = process.stdout.read()
    if process.returncode:
        raise RunError(f"expected boxes from CSRT in {settings.python}, it ended with status {process.returncode}")
    found = np.array(json.loads(answer), dtype=np.float64)
    return np.asarray(np.concatenate([box[None], corners_from_xywh(found)]))
