"""The counter of live video agrees with the count of a finished one."""

import numpy as np
import pytest

import tsuiseki
from tsuiseki.tracking.counts.counting import count
from tsuiseki.tracking.counts.scene import Scene, SceneLine, SceneZone
from tsuiseki.tracking.counts.settings import CountSettings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import Targets, Track

SCENE = Scene(
    [SceneLine("door", np.array([[50.0, 100.0], [150.0, 130.0]]))],
    [SceneZone("shop", np.array([[60.0, 60], [140, 60], [100, 160]]))],
    ignored=[np.array([[0.0, 0], [30, 0], [30, 300], [0, 300]])],
)


def walks(rng, number):
    for k in range(number):
        feet = rng.uniform(60, 140, 2) + np.cumsum(rng.normal(0, 6, (200, 2)), axis=0)
        kept = rng.random(200) < 0.8
        boxes = np.hstack([feet - np.array([5, 40]), feet + np.array([5, 0])])
        yield Track(k + 1, np.flatnonzero(kept), boxes[kept], np.ones(kept.sum()))


def frames_of(tracks, length):
    for frame in range(length):
        rows = [(track, int(np.searchsorted(track.frames, frame))) for track in tracks if frame in track.frames]
        yield Targets(
            frame,
            np.array([track.id for track, _ in rows], dtype=np.int64),
            np.array([track.boxes[row] for track, row in rows]).reshape(-1, 4),
            np.ones(len(rows)),
            np.array(["tracking"] * len(rows), dtype="U9"),
        )


def test_random_walks_are_counted_as_afterwards_but_for_the_ends_of_paths():
    tracks = list(walks(np.random.default_rng(0), 30))
    # The end of a path is known only afterwards: there, everybody steps well away from everything.
    tracks = [
        Track(t.id, np.append(t.frames, 200), np.vstack([t.boxes, [395, 0, 405, 40]]), np.append(t.scores, 1))
        for t in tracks
    ]
    counter = tsuiseki.Counter(SCENE)
    told = [crossing for targets in frames_of(tracks, 201) for crossing in counter.update(targets)]
    found = count(tracks, SCENE, frame_rate=10)
    for direction in ("in", "out"):
        assert counter.counts["door"][direction] == found.count("door", direction)[0] > 20
        assert sum(one.direction == direction for one in told) == counter.counts["door"][direction]
    zones = found.tables["zones"]
    assert counter.counts["shop"] == {"entered": zones["entries"][0], "left": zones["exits"][0]}


def test_occupancy_is_of_the_last_frame_and_the_lost_are_passed_over():
    counter = tsuiseki.Counter(SCENE)
    boxes = np.array([[95.0, 60, 105, 100], [95, 60, 105, 110], [300, 60, 305, 100]])
    targets = Targets(0, np.array([1, 2, 3]), boxes, np.ones(3), np.array(["tracking", "lost", "searching"]))
    assert counter.update(targets) == []
    assert counter.occupancy == {"shop": 1}
    counter.update(Targets.empty(1))
    assert counter.occupancy == {"shop": 0}


def test_bad_settings_are_refused_at_once():
    for settings in ({"anchor": "floor"}, {"band": -1}, {"anchor": "nose"}):
        with pytest.raises(ValueError, match=next(iter(settings))):
            tsuiseki.Counter(SCENE, CountSettings(**settings))
    with pytest.raises(RequestError, match="no such file"):
        tsuiseki.Counter("nowhere.yaml")
