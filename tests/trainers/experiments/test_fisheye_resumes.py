"""The omnidirectional experiment at the thesis's size, stopped while pictures are looked at, goes on where it was."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from tsuiseki.trainers.experiments import fisheye, fisheye_rooms
from tsuiseki.trainers.experiments.fisheye_rooms import (
    CROPS,
    PART,
    STAGES,
    CeilingClip,
    CeilingModels,
    frames_of,
    observe,
    parts_of,
    read_observed,
    render,
)
from tsuiseki.trainers.experiments.store import Store
from tsuiseki.trainers.experiments.study import Bench, Watch

RENDERED: list[CeilingClip] = []
STOPPED_AT = 40


class PicturesDoneError(Exception):
    """All rooms were looked at."""


class Listener(Watch):
    """Ends the experiment after its pictures."""

    def over(self, items, what, total=None):
        del total
        yield from items
        if what == "rooms":
            raise PicturesDoneError


def stopped_once(folder, sequence):
    """Stands for `render`; somebody presses Ctrl-C in the middle of one part."""
    RENDERED.append(sequence)
    folder.mkdir(parents=True)
    if len(RENDERED) == STOPPED_AT:
        raise KeyboardInterrupt
    (folder / "frames.txt").write_text(f"{sequence}")


def nobody_seen(folder, sequence, rendered, networks):
    """Stands for `observe` in an empty room."""
    del rendered, networks
    folder.mkdir(parents=True)
    count = len(frames_of(sequence))
    shapes = {"boxes": 4, "rotated": 5, "places": 2, "truth_boxes": 4, "truth_places": 2, **dict.fromkeys(CROPS, 8)}
    arrays = {name: np.empty((0, width)) for name, width in shapes.items()}
    arrays |= {name: np.empty(0) for name in ("scores", "truth_frames", "truth_ids", "truth_visibility")}
    arrays |= {f"seconds_{stage}": np.array(1.0) for stage in STAGES}
    np.savez(folder / "observed.npz", **arrays, count=np.zeros(count, dtype=int), rate=np.array(sequence.rate))


@pytest.mark.slow
def test_the_thesis_size_goes_on_where_it_was_stopped(tmp_path, monkeypatch):
    monkeypatch.setattr(fisheye, "render", stopped_once)
    monkeypatch.setattr(fisheye, "observe", nobody_seen)
    # Larger parts than the command's own, for each costs this test a while to look up.
    monkeypatch.setattr(fisheye_rooms, "PART", 900)
    RENDERED.clear()
    with pytest.raises(KeyboardInterrupt):
        fisheye.reproduce(Bench(Store(tmp_path), Listener()), full=True)
    with pytest.raises(PicturesDoneError):
        fisheye.reproduce(Bench(Store(tmp_path), Listener()), full=True)
    with pytest.raises(PicturesDoneError):
        fisheye.reproduce(Bench(Store(tmp_path), Listener()), full=True)
    times = Counter(RENDERED)
    # 7 rooms of each size at 1 frame a second, 5 at 15; two cameras, 180 s: 28 sequences of 180 pictures, 20 of 2700.
    assert len(times) == 28 + 20 * 3
    # Only the part in which it was stopped is rendered again.
    assert [part for part, n in times.items() if n > 1] == [RENDERED[STOPPED_AT - 1]]


def test_the_parts_of_a_sequence_are_the_whole():
    whole = CeilingClip("large", 3, 0, 25, 15, None)
    parts = parts_of(whole)
    assert [frame for part in parts for frame in frames_of(part)] == list(range(375))
    assert [len(frames_of(part)) for part in parts] == [PART, PART, 15]
    assert parts_of(CeilingClip("large", 3, 0, 60, 1, None)) == [CeilingClip("large", 3, 0, 60, 1, None)]


@pytest.mark.slow
def test_a_sequence_seen_in_parts_is_the_sequence_seen_whole(tmp_path, monkeypatch):
    from tsuiseki.tracking.weights import shipped

    networks = CeilingModels(None, shipped("appearance_people"))

    def seen(name):
        folders = []
        for part in parts_of(CeilingClip("small", 3, 0, 4, 1, None)):
            frames, folder = tmp_path / f"{name}-frames-{part.part}", tmp_path / f"{name}-{part.part}"
            render(frames, part)
            observe(folder, part, frames, networks)
            folders.append(folder)
        return len(folders), read_observed(folders)

    number, whole = seen("whole")
    monkeypatch.setattr(fisheye_rooms, "PART", 3)
    halves, joined = seen("joined")
    assert (number, halves) == (1, 2)
    assert joined.rate == whole.rate == 1
    assert joined.persons == whole.persons > 0
    for name in ("frames", "ids", "boxes"):
        assert np.array_equal(getattr(joined.truth, name), getattr(whole.truth, name))
    for one, other in zip(joined.described("upright", 0.2), whole.described("upright", 0.2), strict=True):
        assert np.array_equal(one.detections.boxes, other.detections.boxes)
        assert np.array_equal(one.detections.features, other.detections.features)
        assert np.array_equal(one.places, other.places)
