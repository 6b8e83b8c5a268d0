"""Pictures for a page: crops of who was followed, their paths on the view of the camera, and where they spent time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import cv2
import numpy as np

from tsuiseki.tracking.geometry import clip_boxes, grown
from tsuiseki.tracking.report.overlay import draw_label, line_unit, track_colour
from tsuiseki.tracking.types import FloatArray, Frame, ImageArray, IntArray, Track

# Crops of a track.
CROPS = 3
# Height of a crop, pixels: three fit into a row of the table.
CROP_HEIGHT = 96
# Share of a box that a crop shows around it.
AROUND = 0.15
# Longest side of the view, pixels.
LONGEST_SIDE = 960
# Frames that the view is the median of; who moves is in less than half of them.
VIEWS = 7
# Height of the bar below a heat map, pixels.
BAR = 26
# Room about the part of a picture in which animals were, as a share of its longer side.
ROOM = 0.15
# The same in pixels, at least: animals that stand still are whole.
LEAST_ROOM = 20.0
# Numbers at an axis at most, so that they stay apart.
MOST_NUMBERS = 5
# Between two numbers at an axis, pixels or millimetres: the first with which there are at most `MOST_NUMBERS`.
STEPS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 1e9)
# x1, y1, x2, y2 of a part of a frame, pixels.
Part: TypeAlias = tuple[int, int, int, int]
# Paths that bear their id; more would hide each other.
LABELLED = 40


@dataclass(frozen=True)
class Pictures:
    """What a video shows of tracks.

    Attributes:
        view: ``(H, W, 3)`` uint8 RGB, what the camera sees behind what moves; None where no frame was read.
        crops: ``(H, W, 3)`` each, by track id.
    """

    view: ImageArray | None = None
    crops: Mapping[int, Sequence[ImageArray]] = field(default_factory=dict)


def frames_to_show(tracks: Sequence[Track]) -> list[int]:
    """Numbers of the frames that `pictures_of` needs, in order."""
    ends = [number for track in tracks for number in (int(track.frames[0]), int(track.frames[-1]))]
    spread = np.linspace(min(ends), max(ends), VIEWS).round().astype(int).tolist() if ends else []
    return sorted({*spread, *(int(track.frames[row]) for track in tracks for row in _shown_rows(track))})


def _shown_rows(track: Track) -> list[int]:
    """The surest row of each third of a track."""
    rows = np.flatnonzero(track.observed)
    parts = np.array_split(rows if len(rows) else np.arange(len(track)), CROPS)
    return [int(part[np.nan_to_num(track.scores[part]).argmax()]) for part in parts if len(part)]


def pictures_of(frames: Iterable[Frame], tracks: Sequence[Track]) -> Pictures:
    """Crops of tracks, and the view without them, from the frames of `frames_to_show` that there are."""
    views = list[ImageArray]()

    def viewed() -> Iterator[Frame]:
        for frame in frames:
            views.append(_scaled(frame.image, LONGEST_SIDE / max(frame.image.shape[:2])))
            yield frame

    crops = crops_of(viewed(), tracks)
    views = views[:: max(1, len(views) // VIEWS)]
    return Pictures(_median(views) if views else None, crops)


def crops_of(frames: Iterable[Frame], tracks: Sequence[Track]) -> dict[int, list[ImageArray]]:
    """Crops ``(H, W, 3)`` uint8 RGB by track id: the surest row of each third of a track, where its frame is there."""
    crops = dict[int, list[ImageArray]]()
    rows = [(int(track.frames[row]), track.id, track.boxes[row]) for track in tracks for row in _shown_rows(track)]
    for frame in frames:
        for _, identity, box in (row for row in rows if row[0] == frame.index):
            crops.setdefault(identity, []).extend(_crop(frame.image, box))
    return crops


def _median(images: Sequence[ImageArray]) -> ImageArray:
    """At each place; sorted by exchanges of whole pictures, a tenth of the time of `numpy.median`."""
    ranked, last = list(images), len(images) - 1
    for end in range(last, 0, -1):
        for k in range(end):
            ranked[k], ranked[k + 1] = np.minimum(ranked[k], ranked[k + 1]), np.maximum(ranked[k], ranked[k + 1])
    return np.asarray((ranked[last // 2].astype(np.uint16) + ranked[(last + 1) // 2]) // 2, dtype=np.uint8)


def _crop(image: ImageArray, box: FloatArray) -> list[ImageArray]:
    around = clip_boxes(grown(box[None], AROUND), image.shape[1], image.shape[0])[0]
    x1, y1, x2, y2 = around.round().astype(int).tolist()
    part = image[y1:y2, x1:x2]
    return [_scaled(part, min(CROP_HEIGHT / part.shape[0], 2 * CROP_HEIGHT / part.shape[1]), 4.0)] if part.size else []


def _scaled(image: ImageArray, scale: float, largest: float = 1.0) -> ImageArray:
    scale, (high, wide) = min(scale, largest), image.shape[:2]
    size = max(1, round(wide * scale)), max(1, round(high * scale))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def canvas(view: ImageArray | None, size: FloatArray) -> tuple[ImageArray, float]:
    """A pale copy of the view, or an empty one of a picture of width and height ``(2,)``, and its scale."""
    if view is None:
        scale = min(1.0, LONGEST_SIDE / float(max(size)))
        wide, high = np.maximum(np.ceil(size * scale), 1).astype(int).tolist()
        return np.full((high, wide, 3), 236, dtype=np.uint8), scale
    grey = cv2.cvtColor(cv2.cvtColor(view, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    return np.asarray(128 + 0.5 * grey, dtype=np.uint8), view.shape[1] / float(size[0])


def paths_picture(
    view: ImageArray | None, size: FloatArray, paths: Mapping[int, FloatArray], places: Mapping[str, FloatArray]
) -> ImageArray:
    """All paths ``(T, 2)`` by id over the view, each with its id at its end, and places ``(N, 2)`` by name; in pixels.

    ``size`` ``(2,)`` has the width and height of a frame; see `Pictures`.
    """
    drawn, scale = canvas(view, size)
    _draw_places(drawn, places, scale)
    thin = round(2 * line_unit(drawn))
    for identity, points in paths.items():
        ink = tuple(round(0.8 * part) for part in track_colour(identity))
        way = np.round(np.clip(points * scale, -1e4, 1e4)).astype(np.int32)
        cv2.polylines(drawn, [way], isClosed=False, color=ink, thickness=thin, lineType=cv2.LINE_AA)
        cv2.circle(drawn, way[-1].tolist(), 2 * thin, ink, cv2.FILLED, cv2.LINE_AA)
    for identity, points in list(paths.items())[:LABELLED]:
        x, y = np.clip(points[-1] * scale, -1e4, 1e4).round().astype(int).tolist()
        draw_label(drawn, str(identity), (x + 4, y - 4), track_colour(identity))
    return drawn


def part_with(points: FloatArray, size: FloatArray) -> Part | None:
    """The part of a picture that holds all ``(N, 2)`` points, with some room; None without any."""
    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite):
        return None
    low, high = finite.min(axis=0), finite.max(axis=0)
    room = np.maximum(ROOM * (high - low).max(), LEAST_ROOM)
    (x1, y1), (x2, y2) = np.clip([low - room, high + room], 0, size).round().astype(int).tolist()
    return (x1, y1, max(x2, x1 + 1), max(y2, y1 + 1))


def with_axes(image: ImageArray, size: FloatArray, part: Part | None, scale: float | None) -> ImageArray:
    """The ``part`` of a picture of a frame of ``size``, as large as the whole, with numbers at its axes.

    Args:
        image: ``(H, W, 3)`` uint8 RGB; returned as it is where there is no part.
        size: ``(2,)`` width and height of a frame, pixels.
        part: of the frame, pixels.
        scale: millimetres of a pixel; None for pixels at the axes.
    """
    if part is None:
        return image
    (x1, y1, x2, y2), shrunk = part, image.shape[1] / float(size[0])
    left, top, right, bottom = (round(value * shrunk) for value in part)
    cut = image[top : max(bottom, top + 1), left : max(right, left + 1)]
    grown_by = image.shape[1] / cut.shape[1]
    resized = cv2.resize(cut, None, fx=grown_by, fy=grown_by, interpolation=cv2.INTER_CUBIC)
    drawn: ImageArray = np.array(resized, dtype=np.uint8)
    unit, length = ("px", 1.0) if scale is None else ("mm", scale)
    high, wide = drawn.shape[:2]
    for first, last, across in ((x1, x2, True), (y1, y2, False)):
        low, extent = first * length, (last - first) * length
        step = next(step for step in STEPS if extent / step <= MOST_NUMBERS)
        for number in np.arange(np.ceil(low / step), (low + extent) // step + 1) * step:
            at = (number - low) / extent * (wide if across else high)
            text = f"{'x' if across else 'y'} {number:g} {unit}"
            draw_label(drawn, text, (round(at), high - 4) if across else (4, round(at) - 4), (40, 40, 40))
    return drawn


def heat_picture(
    view: ImageArray | None,
    size: FloatArray,
    values: FloatArray,
    unit: str,
    places: Mapping[str, FloatArray],
    part: Part | None = None,
    scale: float | None = None,
) -> ImageArray:
    """Values over the view, in colours that the colour-blind tell apart, above a bar that says what they mean.

    They are ``(R, C)`` of equal cells of the frame, at least 0; NaN where it is not known. See `paths_picture` and,
    of ``part`` and ``scale``, `with_axes`.
    """
    drawn, shrunk = canvas(view, size)
    levels = np.nan_to_num(values)
    highest = float(levels.max(initial=0.0)) or 1.0
    high, wide = drawn.shape[:2]
    level = cv2.resize(
        (255 * (levels / highest) ** 0.5).astype(np.uint8), (wide, high), interpolation=cv2.INTER_NEAREST
    )
    paint = cv2.applyColorMap(level, cv2.COLORMAP_VIRIDIS)[..., ::-1]
    mixed = np.where(level[..., None] > 0, 0.25 * drawn + 0.75 * paint, drawn).astype(np.uint8)
    _draw_places(mixed, places, shrunk)
    mixed = with_axes(mixed, size, part, scale)
    shades = np.tile(np.linspace(0, 255, wide).astype(np.uint8), (BAR, 1))
    bar: ImageArray = np.array(cv2.applyColorMap(shades, cv2.COLORMAP_VIRIDIS)[..., ::-1], dtype=np.uint8)
    draw_label(bar, "0", (2, BAR - 5), (40, 40, 40))
    draw_label(bar, f"{_number(highest)} {unit}", (wide, BAR - 5), (40, 40, 40))
    draw_label(bar, _number(highest / 4), (wide // 2, BAR - 5), (40, 40, 40))
    return np.concatenate([mixed, bar])


def _number(value: float) -> str:
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def _draw_places(image: ImageArray, places: Mapping[str, FloatArray], scale: float) -> None:
    for name, points in places.items():
        way: IntArray = np.round(points * scale).astype(np.int32)
        cv2.polylines(image, [way], len(way) > 2, (20, 20, 20), round(2 * line_unit(image)), cv2.LINE_AA)
        draw_label(image, name.encode("ascii", "replace").decode(), tuple(way[0].tolist()), (20, 20, 20))
