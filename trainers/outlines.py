"""Outlines of bodies in clips: from silhouettes that are given, or from regions of a colour."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.tracking.bodies.contour import Extraction
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.silhouettes import FOLDER, MOST_BODIES, read_silhouettes, silhouette_of
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.video.source import open_source

# Regions smaller than this are specks, in pixels.
SMALLEST_AREA = 40.0
# Whole bodies have about the area of the largest region of a usual frame, within these shares; others are specks,
# parts, or several bodies at once.
USUAL_AREA = (0.7, 1.4)


@dataclass(frozen=True)
class Outline:
    """The outline of one body in one frame.

    Attributes:
        frame: 0-based.
        identity: of the body in its clip; 0 where that is not known.
        points: ``(P, 2)`` pixels x, y along the border.
        area: of the silhouette, pixels.
        step: ``(2,)`` pixels that its centre moves until the next frame; zero where that is not known.
    """

    frame: int
    identity: int
    points: FloatArray
    area: float
    step: tuple[float, float] = (0.0, 0.0)

    @property
    def centre(self) -> FloatArray:
        """Mean of the border points ``(2,)``."""
        return np.asarray(self.points.mean(axis=0))


def outlines_of(source: Path, extraction: Extraction | None) -> list[Outline]:
    """Outlines of the whole bodies in a clip.

    Args:
        source: a clip with a folder of silhouettes, or any video or folder of images.
        extraction: what belongs to the bodies in an image; not needed with silhouettes.

    Raises:
        RequestError: there is neither, or no body is found.
    """
    if (source / FOLDER).is_dir():
        found = _from_silhouettes(read_silhouettes(source))
    elif extraction is not None:
        found = _from_regions(source, extraction)
    else:
        raise RequestError(f"{source}: expected a folder {FOLDER} in it, found none; or give the bodies' `colour`")
    if not found:
        raise RequestError(f"{source}: expected silhouettes of whole bodies, found none")
    largest: dict[int, float] = {}
    for outline in found:
        largest[outline.frame] = max(outline.area, largest.get(outline.frame, 0.0))
    usual = float(np.median(list(largest.values())))
    return _with_steps([o for o in found if USUAL_AREA[0] * usual < o.area < USUAL_AREA[1] * usual])


def _from_silhouettes(silhouettes: ImageArray) -> list[Outline]:
    found = []
    for frame, picture in enumerate(silhouettes):
        for identity in range(1, MOST_BODIES + 1):
            found += _outlines(frame, identity, silhouette_of(picture, identity).astype(np.uint8))[:1]
    return found


def _from_regions(source: Path, extraction: Extraction) -> list[Outline]:
    opened = open_source(source)
    return [
        outline for frame in opened.frames() for outline in _outlines(frame.index, 0, extraction.pixels(frame.image))
    ]


def _outlines(frame: int, identity: int, mask: ImageArray) -> list[Outline]:
    """Those of the regions of a mask that do not touch the image's border, the largest first."""
    lines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    last = np.array([mask.shape[1] - 1, mask.shape[0] - 1])
    found = []
    for line in lines:
        points = line[:, 0].astype(np.float64)
        area = float(cv2.contourArea(line)) if len(line) > 2 else 0.0
        if area >= SMALLEST_AREA and points.min() > 0 and np.all(points.max(axis=0) < last):
            # A pixel's centre lies half a pixel behind its corner.
            found.append(Outline(frame, identity, points + 0.5, area))
    return sorted(found, key=lambda outline: -outline.area)


def _with_steps(outlines: list[Outline]) -> list[Outline]:
    """The outlines with their steps: to the same body of the next frame, or to the nearest near one."""
    by_frame: dict[int, list[Outline]] = {}
    for outline in outlines:
        by_frame.setdefault(outline.frame, []).append(outline)
    return [replace(outline, step=_step(outline, by_frame.get(outline.frame + 1, []))) for outline in outlines]


def _step(outline: Outline, later: list[Outline]) -> tuple[float, float]:
    same = [other for other in later if other.identity == outline.identity]
    steps = [other.centre - outline.centre for other in same]
    nearest = min(steps, key=lambda step: float(np.linalg.norm(step)), default=np.zeros(2))
    reach = np.sqrt(outline.area)
    return (float(nearest[0]), float(nearest[1])) if np.linalg.norm(nearest) < reach else (0.0, 0.0)
