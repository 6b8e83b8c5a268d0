"""The rotated boxes of all detections of a source, as `tracking.formats.space.rotated` writes and reads them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from tsuiseki.tracking.formats.rotated import RotatedBoxes, half_turned
from tsuiseki.tracking.types.floor import FloorDetections
from tsuiseki.tracking.video.image_folder import ImageFolder
from tsuiseki.tracking.video.source import Source


@dataclass
class FoundBoxes:
    """Keeps what passes through.

    Attributes:
        source: of the frames; the images of a folder are named as their files without suffix, other frames by their
            number from 1.
        boxes: by the image's name.
    """

    source: Source
    boxes: dict[str, RotatedBoxes] = field(default_factory=dict)

    def watched(self, people: Iterable[FloorDetections]) -> Iterator[FloorDetections]:
        """The same, frame by frame."""
        images = self.source.images if isinstance(self.source, ImageFolder) else ()
        for index, each in enumerate(people):
            name = images[index].stem if images else str(index + 1)
            rows = each.rotated.copy()
            rows[:, 4] = half_turned(rows[:, 4])
            self.boxes[name] = RotatedBoxes(rows, np.full(len(rows), -1), each.detections.scores)
            yield each
