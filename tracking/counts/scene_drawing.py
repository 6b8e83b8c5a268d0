"""A scene drawn over pictures: its lines and zones, each with what was counted so far."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import cv2
import numpy as np

from tsuiseki.tracking.counts.scene import Scene, SceneLine
from tsuiseki.tracking.report.overlay import draw_label, line_unit
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import FloatArray, Frame, ImageArray

if TYPE_CHECKING:
    from tsuiseki.tracking.counts.counting import Answers

AnyResult = TypeVar("AnyResult", bound=Result[Any])
# Colour of a line or border, RGB.
INK = (255, 255, 255)
# Colour that sets it off from the picture, RGB.
EDGE = (20, 20, 20)
# Length of the arrow that shows the first direction of a line, in pixels of a plain picture.
ARROW = 18.0


def draw_scene(image: ImageArray, scene: Scene, texts: Mapping[str, str]) -> None:
    """Draw the lines and zones of a scene into an image ``(H, W, 3)`` uint8 RGB, with a text beside each name.

    An arrow points in the first direction of a line. A place that shows no pixels is left out.
    """
    thin = round(line_unit(image))
    ways = [np.round(way) for line in scene.lines if np.isfinite(way := _arrow(scene, line, image)).all()]
    places = {name: scene.pixels(points) for name, points in scene.places()}
    places = {name: np.round(points) for name, points in places.items() if np.isfinite(points).all()}
    for colour, thickness in ((EDGE, 4 * thin), (INK, 2 * thin)):
        for points in places.values():
            cv2.polylines(image, [_within(points)], len(points) > 2, colour, thickness, cv2.LINE_AA)
        for start, end in ways:
            cv2.arrowedLine(image, _within(start).tolist(), _within(end).tolist(), colour, thickness, cv2.LINE_AA,
                            tipLength=0.4)  # fmt: skip
    for name, points in places.items():
        text = f"{name}: {texts[name]}" if texts.get(name) else name
        place = tuple(_within(points[0]).tolist())
        draw_label(image, text.encode("ascii", "replace").decode(), place, EDGE)


def _within(points: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.int32]]:
    """As OpenCV takes them: a point far outside of the picture would overflow."""
    return np.clip(points, -1e4, 1e4).astype(np.int32)


def _arrow(scene: Scene, line: SceneLine, image: ImageArray) -> FloatArray:
    """``(2, 2)`` pixels: from the middle of a line in its first direction."""
    (dx, dy), centre = line.ends[1] - line.ends[0], line.ends.mean(axis=0)
    # The first direction leads to the right of the line, see `line_distances`.
    middle, beside = scene.pixels(np.array([centre, centre + 0.1 * scene.right_is * np.array([-dy, dx])]))
    ahead = (beside - middle) / max(float(np.hypot(*(beside - middle))), 1e-9)
    return np.array([middle, middle + ARROW * line_unit(image) * ahead])


def texts_of(counts: Mapping[str, Mapping[str, int]], inside: Mapping[str, int]) -> dict[str, str]:
    """What stands beside each name: crossings so far by direction of a line, people now in a zone."""
    lines = {
        name: ", ".join(f"{way} {number}" for way, number in ways.items())
        for name, ways in counts.items()
        if name not in inside
    }
    return lines | {name: str(number) for name, number in inside.items()}


def with_scene(result: AnyResult, answers: Answers) -> AnyResult:
    """A result that also draws the scene of its answers, with the counts up to each frame."""
    table, frames = answers.tables["crossings"], dict[tuple[str, str], list[int]]()
    for line in answers.scene.lines:
        frames |= {(line.name, way): [] for way in line.directions}
    for frame, line_name, way in zip(table["frame"], table["line"], table["direction"], strict=True):
        # Frames of the table count from 1.
        frames[line_name, way].append(frame - 1)
    return replace(result, painter=partial(_painted, result, answers, {key: sorted(f) for key, f in frames.items()}))


def _painted(
    result: Result[Any], answers: Answers, frames: Mapping[tuple[str, str], list[int]], frame: Frame
) -> ImageArray:
    image, counts = result.draw(frame.image, frame.index), dict[str, dict[str, int]]()
    for (line, way), crossed in frames.items():
        counts.setdefault(line, {})[way] = bisect_right(crossed, frame.index)
    inside = {name: int(people[frame.index : frame.index + 1].sum()) for name, people in answers.occupancy.items()}
    draw_scene(image, answers.scene, texts_of(counts, inside))
    return image
