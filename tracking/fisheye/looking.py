"""What a detector of people looks at under a ceiling camera, and which one ships for that."""

from __future__ import annotations

from typing import Literal, TypeAlias

from tsuiseki.tracking.cameras.person_model import FloorCamera
from tsuiseki.tracking.features.networks.exported import Detect, SizedDetect
from tsuiseki.tracking.fisheye.unrolled import UnrolledDetector, UnrollingSettings

CeilingLook: TypeAlias = Literal["unrolled", "image"]
# The shipped detector for each way of looking.
DETECTORS: dict[CeilingLook, str] = {"unrolled": "detector_ceiling", "image": "detector_drone"}
# Height and width of a tile for a network that takes any size, pixels.
TILE = (480, 640)


def looking(
    detector: SizedDetect, camera: FloorCamera, look: CeilingLook, unrolling: UnrollingSettings | None = None
) -> Detect:
    """``detector`` as it looks at a ceiling camera's images: at them as they are, or at the views they unroll into."""
    if look == "image":
        return detector
    return UnrolledDetector(detector, camera, detector.input_size or TILE, unrolling)
