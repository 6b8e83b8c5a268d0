"""Tracks drawn over the video: boxes with ids, short trails, dashes where no detection supports a box, ``?`` in doubt.

Bodies are drawn by their states: an ellipse where the size is known, an arrow ahead, points, the id.
"""

from __future__ import annotations

import colorsys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.tracking.association.doubtful_tracks import doubtful_tracks
from tsuiseki.tracking.types import Frame, ImageArray, IntArray, Track
from tsuiseki.tracking.types.tracks import BodyTrack, PointTable
from tsuiseki.tracking.video.webm import VideoWriter

# Turns of the circle of hues from an id to the next: by the golden ratio all of the near ones stay apart.
GOLDEN_RATIO = 0.6180339887
# Seconds of a trail.
TRAIL_SECONDS = 2.0
# Pixels of a dash, and of the gap behind it.
DASH = 4
# Grey levels between two frames that are taken for noise.
NOISE_LEVELS = 8
# Shorter side of a picture for which lines of a pixel are right.
PLAIN_SIDE = 540
# Size of letters there, times OpenCV's font.
LETTERS = 0.4
FONT = cv2.FONT_HERSHEY_SIMPLEX

Colour = tuple[int, int, int]


def track_colour(identity: int) -> Colour:
    """A bright RGB colour for an id; ids that follow each other get hues far apart."""
    hue = (identity * GOLDEN_RATIO) % 1
    red, green, blue = colorsys.hsv_to_rgb(hue, 0.75, 1.0)
    return round(255 * red), round(255 * green), round(255 * blue)


class Overlay:
    """Draws tracks into frames.

    Args:
        tracks: what to draw.
        frame_rate: of the video, for the length of the trails.
        captions: by track id, a text for each of its boxes, beside the id.
        trail_seconds: length of the trails, 0 for none; under a camera that moves they say nothing.
        doubtful: ids of tracks that rather show nobody, which are drawn thin, with a question mark.
    """

    def __init__(
        self,
        tracks: Iterable[Track],
        frame_rate: float,
        captions: Mapping[int, Sequence[str]] | None = None,
        trail_seconds: float = TRAIL_SECONDS,
        doubtful: Collection[int] = (),
    ) -> None:
        self.tracks = list(tracks)
        self.captions, self.doubtful = captions or {}, doubtful
        self.trail = max(1, round(trail_seconds * frame_rate)) if trail_seconds > 0 else 0
        frames = [track.frames for track in self.tracks]
        numbers = [np.full(len(track), n) for n, track in enumerate(self.tracks)]
        rows = [np.arange(len(track)) for track in self.tracks]
        order = np.argsort(np.concatenate(frames), kind="stable") if frames else np.empty(0, dtype=np.int64)
        self._frames, self._numbers, self._rows = (
            np.concatenate(parts)[order] if parts else np.empty(0, dtype=np.int64) for parts in (frames, numbers, rows)
        )

    @classmethod
    def of_people(
        cls, tracks: Sequence[Track], frame_rate: float, size: tuple[int, int] | None, length: int
    ) -> Callable[[Frame], ImageArray]:
        """`draw` of people's tracks in a video of so many frames; the first frame asks which are doubtful."""

        @cache
        def overlay() -> Overlay:
            doubtful = doubtful_tracks(tracks, frame_rate or 25.0, size, length)
            return cls(tracks, frame_rate, doubtful={tracks[n].id for n in np.flatnonzero(doubtful).tolist()})

        return lambda frame: overlay().draw(frame)

    def draw(self, frame: Frame) -> ImageArray:
        """The image of ``frame`` with the tracks over it, ``(H, W, 3)`` uint8 RGB; the frame itself stays as it is."""
        image = frame.image.copy()
        first, last = np.searchsorted(self._frames, [frame.index, frame.index + 1])
        present = list(zip(self._numbers[first:last].tolist(), self._rows[first:last].tolist(), strict=True))
        for number, row in present if self.trail else ():
            self._draw_trail(image, self.tracks[number], row)
        for number, row in present:
            track = self.tracks[number]
            caption = self.captions[track.id][row] if track.id in self.captions else ""
            _draw_box(image, track, row, caption, track.id in self.doubtful)
        draw_label(image, f"{frame.index + 1}", (4, image.shape[0] - 4), (60, 60, 60))
        return image

    def _draw_trail(self, image: ImageArray, track: Track, row: int) -> None:
        """The way of the feet up to ``row``."""
        recent = slice(np.searchsorted(track.frames, track.frames[row] - self.trail), row + 1)
        boxes = track.boxes[recent]
        feet = np.column_stack([(boxes[:, 0] + boxes[:, 2]) / 2, boxes[:, 3]])
        thin, colour = round(line_unit(image)), track_colour(track.id)
        cv2.polylines(image, [_pixels(feet)], isClosed=False, color=colour, thickness=thin, lineType=cv2.LINE_AA)


def write_drawn(
    path: Path,
    frames: Iterable[Frame],
    frame_rate: float,
    draw: Callable[[Frame], ImageArray],
    metadata: Mapping[str, str] | None = None,
) -> None:
    """Write what ``draw`` makes of each frame, freed of flicker, as a video with texts in its ``metadata``.

    Raises:
        RunError: the video breaks off, or cannot be written.
    """
    calm: ImageArray | None = None
    with VideoWriter(path, frame_rate, metadata) as writer:
        for frame in frames:
            calm = without_flicker(frame.image, calm)
            writer.write(draw(Frame(frame.index, frame.time, calm)))


def without_flicker(image: ImageArray, previous: ImageArray | None) -> ImageArray:
    """``image``, with the pixels of the ``previous`` frame where the two differ by no more than noise.

    An encoder would spend most of its bits on the noise of a still background.
    """
    if previous is None or previous.shape != image.shape:
        return image
    red, green, blue = cv2.split(cv2.absdiff(image, previous))
    changed = cv2.threshold(cv2.max(cv2.max(red, green), blue), NOISE_LEVELS, 255, cv2.THRESH_BINARY)[1]
    calm = previous.copy()
    cv2.copyTo(image, cv2.medianBlur(changed, 3), calm)
    return calm


def _draw_box(image: ImageArray, track: Track, row: int, caption: str, doubtful: bool) -> None:
    colour = track_colour(track.id)
    x1, y1, x2, y2 = np.round(track.boxes[row]).astype(int).tolist()
    if track.observed[row]:
        cv2.rectangle(image, (x1, y1), (x2, y2), colour, round((2 - doubtful) * line_unit(image)), cv2.LINE_AA)
    else:
        corners = ((x1, y1), (x2, y1), (x2, y2), (x1, y2))
        for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
            _dashed_line(image, start, end, colour)
    draw_label(image, f"{track.id}{'?' * doubtful} {caption}".rstrip(), (x1, y1 - 2), colour)


def _dashed_line(image: ImageArray, start: tuple[int, int], end: tuple[int, int], colour: Colour) -> None:
    # Clipped first: a box far outside the image would cost thousands of dashes.
    height, width = image.shape[:2]
    inside, start_clipped, end_clipped = cv2.clipLine((0, 0, width, height), start, end)
    if not inside:
        return
    a, b = np.asarray(start_clipped, dtype=np.float64), np.asarray(end_clipped, dtype=np.float64)
    count = max(2, int(np.hypot(*(b - a)) // DASH))
    points = _pixels(a + np.linspace(0, 1, count)[:, None] * (b - a))
    dashes = [points[n : n + 2] for n in range(0, count - 1, 2)]
    cv2.polylines(image, dashes, isClosed=False, color=colour, thickness=round(2 * line_unit(image)))


def draw_label(image: ImageArray, text: str, place: tuple[int, int], colour: Colour) -> None:
    """``text`` on a patch of ``colour`` whose lower left corner is ``place``, moved into the image.

    Letters and lines grow with pictures above `PLAIN_SIDE`.
    """
    unit = line_unit(image)
    scale, pad = LETTERS * unit, round(2 * unit)
    (width, height), _ = cv2.getTextSize(text, FONT, scale, round(unit))
    x = min(max(place[0], 0), image.shape[1] - width - 2 * pad)
    y = min(max(place[1], height + 2 * pad), image.shape[0] - 1)
    cv2.rectangle(image, (x, y - height - 2 * pad), (x + width + 2 * pad - 1, y), colour, cv2.FILLED)
    ink = (255, 255, 255) if np.dot(colour, (0.299, 0.587, 0.114)) < 128 else (0, 0, 0)
    cv2.putText(image, text, (x + pad, y - pad - 1), FONT, scale, ink, round(unit), lineType=cv2.LINE_AA)


def line_unit(image: ImageArray) -> float:
    """How many pixels a thin line has: 1 up to `PLAIN_SIDE`, and in proportion beyond."""
    return max(1.0, float(min(image.shape[:2])) / PLAIN_SIDE)


def _pixels(points: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> IntArray:
    return np.round(points).astype(np.int32)


# Pixels of a plain picture that the arrow of a body of unknown size has.
_ARROW = 30


def draw_marks(
    frame: Frame, tracks: Sequence[BodyTrack], names: Sequence[str], points: PointTable | None = None
) -> ImageArray:
    """The image of ``frame`` with its bodies drawn in, ``(H, W, 3)`` uint8 RGB; thin where nothing supports them.

    Args:
        frame: stays as it is.
        tracks: states that begin with the place ``a, b`` in pixels and the heading ``theta``.
        names: of all columns of the states; ``length`` and ``width`` follow where the size is known.
        points: of all bodies, where they are known.
    """
    image, sized = frame.image.copy(), tuple(names[3:5]) == ("length", "width")
    for track in tracks:
        row = int(np.searchsorted(track.frames, frame.index))
        if row == len(track) or track.frames[row] != frame.index:
            continue
        a, b, theta, *sizes = np.clip(track.states[row, :5], -1e5, 1e5).tolist()
        length, width = sizes if sized else (2 * _ARROW * line_unit(image), 0.0)
        colour, thickness = track_colour(track.id), 2 if track.statuses[row] == "tracking" else 1
        axes = (max(1, round(length / 2)), max(1, round(width / 2)))
        centre = (round(a), round(b))
        if sized:
            cv2.ellipse(image, centre, axes, float(np.degrees(theta)), 0, 360, colour, thickness, cv2.LINE_AA)
        tip = (round(a + 0.5 * length * np.cos(theta)), round(b + 0.5 * length * np.sin(theta)))
        cv2.arrowedLine(image, centre, tip, colour, thickness, cv2.LINE_AA, tipLength=0.3)
        draw_label(image, str(track.id), (centre[0] + axes[1], centre[1] - axes[1]), colour)
    if points is not None:
        for row in np.flatnonzero(points.frames == frame.index).tolist():
            for x, y in points.points[row][np.isfinite(points.points[row]).all(axis=1)].round().astype(int).tolist():
                cv2.circle(image, (x, y), 2, (255, 255, 255), cv2.FILLED, cv2.LINE_AA)
    draw_label(image, f"{frame.index + 1}", (4, image.shape[0] - 4), (60, 60, 60))
    return image
