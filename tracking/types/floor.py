"""People found over a floor: boxes in the image with the places where they stand."""

from __future__ import annotations

from dataclasses import dataclass

from tsuiseki.tracking.types import Detections, FloatArray


@dataclass(frozen=True)
class FloorDetections:
    """People found in one frame, and where they stand.

    Attributes:
        detections: boxes in the image, with features where something described them.
        rotated: ``(N, 5)`` rotated boxes, see `tsuiseki.tracking.cameras.person_model`.
        places: ``(N, 2)`` metres.
    """

    detections: Detections
    rotated: FloatArray
    places: FloatArray

    def __post_init__(self) -> None:
        if self.rotated.shape != (len(self.detections), 5) or self.places.shape != (len(self.detections), 2):
            raise ValueError(
                f"expected {len(self.detections)} rotated boxes and places, got shapes {self.rotated.shape} and "
                f"{self.places.shape}"
            )

    def __len__(self) -> int:
        return len(self.detections)
