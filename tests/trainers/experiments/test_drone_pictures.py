"""Pictures of switches: of the right person and frames, in the results that they belong to."""

from __future__ import annotations

import itertools
from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.drone.observations import Observation
from tsuiseki.tracking.evaluation.action_files import LabelledActions
from tsuiseki.tracking.types import Detections, Track
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.types.tracks import ActingTrack
from tsuiseki.trainers.experiments.drone import ObservedClip
from tsuiseki.trainers.experiments.drone_pictures import (
    BAND,
    CELL,
    LINE,
    SHOWN,
    SwitchStrip,
    draw_pictures,
    draw_second,
)

FRAMES = 12
# Red, green and blue, who stand still.
COLOURS = np.array([[200, 0, 0], [0, 200, 0], [0, 0, 200]])
BOXES = np.array([[20, 20, 40, 60], [120, 20, 140, 60], [120, 140, 140, 184.0]])


@pytest.fixture
def clip(tmp_path: Path) -> ObservedClip:
    image = np.full((200, 200, 3), 90, dtype=np.uint8)
    for (x1, y1, x2, y2), colour in zip(BOXES.astype(int).tolist(), COLOURS, strict=True):
        image[y1:y2, x1:x2] = colour
    folder = tmp_path / "clip"
    (folder / "img1").mkdir(parents=True)
    for number in range(1, FRAMES + 1):
        cv2.imwrite(str(folder / "img1" / f"{number:06d}.png"), image[:, :, ::-1])
    frames, ids = np.repeat(np.arange(FRAMES), 3), np.tile([1, 2, 3], FRAMES)
    every = np.ones(len(ids), dtype=np.bool_)
    truth = GroundTruth(frames, ids, BOXES[ids - 1], every, ~every, every.astype(np.float64))
    labels = LabelledActions("clip", truth, np.zeros((len(ids), 2), np.bool_), ("Walking", "Sitting"))
    nothing = Observation(0, Detections(np.empty((0, 4)), np.empty(0)))
    return ObservedClip(folder, truth, labels, [nothing] * FRAMES, [], np.empty(0, np.int64))


def people(*switched: tuple[int, int]) -> list[list[ActingTrack]]:
    """The people of one clip, a new id from each ``(person, frame)`` on; they walk in single frames, sit in windows."""
    found, fresh = [], 10
    for person in (1, 2, 3):
        starts = [0, *sorted(frame for who, frame in switched if who == person), FRAMES]
        for n, (start, end) in enumerate(itertools.pairwise(starts)):
            frames, fresh = np.arange(start, end), fresh + 1
            boxes = np.tile(BOXES[person - 1], (len(frames), 1))
            track = Track(person if n == 0 else fresh, frames, boxes, np.ones(len(frames)))
            said = np.tile([0.9, 0.1], (len(frames), 1))
            found.append(ActingTrack(track, said, 1 - said))
    return [found]


def shown(picture: SwitchStrip, rows: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """``(rows, SHOWN, CELL, CELL, 3)`` cells of a strip."""
    image = cv2.cvtColor(cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    assert image.shape == (rows * (BAND + CELL + LINE) + BAND, SHOWN * (CELL + LINE), 3)
    lines = image[:-BAND].reshape(rows, BAND + CELL + LINE, SHOWN, CELL + LINE, 3)
    return np.asarray(lines[:, BAND : BAND + CELL, :, :CELL].transpose(0, 2, 1, 3, 4), dtype=np.uint8)


def middles(cells: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]) -> set[int]:
    """Who stands in the middle of the cells."""
    middle = cells[:, :, CELL // 2, CELL // 2].reshape(-1, 1, 3).astype(int)
    return set((np.abs(middle - COLOURS).sum(axis=2).argmin(axis=1) + 1).tolist())


def test_the_right_people_are_shown(clip: ObservedClip) -> None:
    flow = people((1, 3), (2, 6), (3, 6))
    # The switch of 1 stays, that of 3 comes a frame later, that of 2 is prevented from the second iteration on.
    iterations = [people((1, 3), (2, 6), (3, 7)), *[people((1, 3), (3, 7))] * 5]
    drawn = draw_pictures([clip], flow, iterations) | draw_second([clip], iterations)
    assert {name: picture.shows for name, picture in drawn.items()} == {
        "prevented": {"clip": "clip", "person": 2, "frame": 7},
        "remaining": {"clip": "clip", "person": 3, "frame": 8},
        "second": {"clip": "clip", "person": 2, "frame": 7},
    }
    assert middles(shown(drawn["prevented"], 4)) == {2}
    assert middles(shown(drawn["remaining"], 3)) == {3}
    assert all(len(picture.jpeg) < 150_000 for picture in drawn.values())


def test_a_row_shows_its_own_ids_and_actions(clip: ObservedClip) -> None:
    drawn = draw_second([clip], [people((2, 6)), people()])
    first, second = shown(drawn["second"], 2).astype(int)
    # Frames 5 to 9: the box turns from one colour to another in the third cell; with one id it never does.
    changes = [
        [np.abs(a - b).max() for a, b in itertools.pairwise(row)] for row in (no_numbers(first), no_numbers(second))
    ]
    assert (np.array(changes) > 100).tolist() == [[False, True, False, False], [False] * 4]
    # The same track in the first frames; what single frames say stands in one row, what windows say in the other.
    assert np.abs(no_numbers(first)[0] - no_numbers(second)[0]).max() > 100


def no_numbers(
    cells: np.ndarray[tuple[int, ...], np.dtype[np.int64]],
) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    """Cells without the number of the frame, in their lower left corner."""
    return cells[:, : CELL - 25]


def test_without_a_switch_there_is_no_picture(clip: ObservedClip) -> None:
    assert draw_pictures([clip], people(), [people()] * 6) == {}
    assert draw_second([clip], [people((1, 3)), people((1, 4))]) == {}
