"""Counts at lines and in zones: what holds for any way that people walk."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.properties.drawn import seeds
from tsuiseki.tracking.counts.counting import Answers, count
from tsuiseki.tracking.counts.polygons import inside
from tsuiseki.tracking.counts.scene import Scene, SceneLine, SceneZone
from tsuiseki.tracking.counts.settings import CountSettings
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import FloatArray, Track

SIZE = (640, 480)
# From one side of the picture to the other: nobody can go around it.
LINE = SceneLine("line", np.array([[0.0, 240.0], [640.0, 240.0]]), ("down", "up"))
SHORT = SceneLine("line", np.array([[200.0, 200.0], [420.0, 280.0]]), ("down", "up"))
ZONE = SceneZone("zone", np.array([[200.0, 150], [450, 150], [400, 350], [220, 330]]))
HEIGHT = 40.0


def walkers(seed: int, people: int = 3, length: int = 25) -> list[Track]:
    """People who wander, apart from each other in time so that none hides another; each ends near the line."""
    rng, tracks = np.random.default_rng(seed), []
    for k in range(people):
        feet = rng.uniform([100, 100], [540, 400]) + np.cumsum(rng.normal(0, 25, (length, 2)), axis=0)
        feet[-1, 1] = rng.uniform(230, 250)
        tracks.append(walker(np.clip(feet, 20, [620, 460]), k + 1, 2 * k * length))
    return tracks


def walker(feet: FloatArray, number: int = 1, start: int = 0) -> Track:
    boxes = np.column_stack([feet[:, 0] - 8, feet[:, 1] - HEIGHT, feet[:, 0] + 8, feet[:, 1]])
    return Track(number, start + np.arange(len(feet)), boxes, np.ones(len(feet)))


def feet_of(track: Track) -> FloatArray:
    return np.column_stack([track.boxes[:, ::2].mean(axis=1), track.boxes[:, 3]])


def answers(tracks: list[Track], scene: Scene, scale: float = 1.0, band: float = 0.2) -> Answers:
    size = (round(scale * SIZE[0]), round(scale * SIZE[1]))
    return count(Result(tracks, "v", 10.0, size), replace(scene, size=size), CountSettings(band=band))


def crossed(tracks: list[Track], line: SceneLine = LINE, **changes: float) -> dict[str, int]:
    """How often a line was crossed, by direction."""
    found = answers(tracks, Scene([line]), **changes)
    return {direction: found.count("line", direction)[0] for direction in line.directions}


def backwards(track: Track) -> Track:
    """The track as if the film ran backwards."""
    return replace(track, frames=1000 - track.frames[::-1], boxes=track.boxes[::-1])


@given(seed=seeds, times=st.integers(0, 4))
def test_who_goes_over_a_line_and_back_is_counted_once_each_way(seed: int, times: int) -> None:
    """So many ways there and back are so many crossings in each direction, and none is left over."""
    rng = np.random.default_rng(seed)
    sides = [140.0, *[340.0, 140.0] * times]
    ys = np.concatenate(
        [[140.0], *(np.linspace(a, b, int(rng.integers(3, 9)))[1:] for a, b in itertools.pairwise(sides))]
    )
    feet = np.column_stack([300 + np.cumsum(rng.normal(0, 4, len(ys))), ys])
    assert crossed([walker(feet)]) == {"down": times, "up": times}


@given(seed=seeds)
def test_crossings_add_up_to_the_change_of_side(seed: int) -> None:
    """At a line that nobody can go around, those one way less those back are those who end on another side."""
    tracks = walkers(seed)
    ends = np.array([(feet_of(track)[[0, -1], 1] > 240) for track in tracks]).astype(int)
    found = crossed(tracks)
    assert found["down"] - found["up"] == (ends[:, 1] - ends[:, 0]).sum()


@pytest.mark.slow
@pytest.mark.parametrize("line", [LINE, SHORT])
@given(seed=seeds)
def test_a_film_that_runs_backwards_exchanges_the_directions(line: SceneLine, seed: int) -> None:
    """Backwards, each crossing is one in the other direction."""
    tracks = walkers(seed)
    forwards, reversed_ = crossed(tracks, line), crossed([backwards(track) for track in tracks], line)
    assert reversed_ == {"down": forwards["up"], "up": forwards["down"]}


@pytest.mark.slow
@pytest.mark.parametrize("line", [LINE, SHORT])
@given(seed=seeds)
def test_a_line_drawn_from_its_other_end_exchanges_the_directions(line: SceneLine, seed: int) -> None:
    """Ends in the other order exchange left and right, and leave the rest."""
    tracks, turned = walkers(seed), replace(line, ends=line.ends[::-1])
    found = crossed(tracks, line)
    assert crossed(tracks, turned) == {"down": found["up"], "up": found["down"]}


@pytest.mark.slow
@given(seed=seeds, scale=st.sampled_from([0.5, 2.0, 3.0]))
def test_counts_do_not_depend_on_the_size_of_the_picture(seed: int, scale: float) -> None:
    """A picture with all that is drawn in it may be enlarged."""
    tracks = walkers(seed)
    larger = [replace(track, boxes=scale * track.boxes) for track in tracks]
    assert crossed(larger, replace(SHORT, ends=scale * SHORT.ends), scale=scale) == crossed(tracks, SHORT)
    zones = [answers(part, Scene(zones=[replace(ZONE, corners=k * ZONE.corners)]), k).tables["stays"]
             for part, k in ((tracks, 1.0), (larger, scale))]  # fmt: skip
    assert zones[0] == zones[1]


@given(seed=seeds)
def test_entries_and_exits_add_up_to_the_change_of_those_within(seed: int) -> None:
    """Those who enter a zone less those who leave are those within at the end less those at the start."""
    tracks = walkers(seed)
    within = np.array([inside(feet_of(track)[[0, -1]], ZONE.corners) for track in tracks]).astype(int)
    table = answers(tracks, Scene(zones=[ZONE])).tables["zones"]
    assert table["entries"][0] - table["exits"][0] == (within[:, 1] - within[:, 0]).sum()


@given(seed=seeds)
def test_the_time_in_a_zone_is_that_of_its_occupancy(seed: int) -> None:
    """Without a band, the seconds of all stays are the people in the zone, summed over the frames."""
    found = answers(walkers(seed), Scene(zones=[ZONE]), band=0.0)
    assert sum(found.tables["stays"]["seconds"]) == pytest.approx(found.occupancy["zone"].sum() / 10)


@given(seed=seeds, names=st.permutations(range(1, 4)))
def test_counts_do_not_depend_on_names_or_their_order(seed: int, names: list[int]) -> None:
    """Other ids, and tracks in another order, give the same counts, and each crossing to whom it is."""
    tracks = walkers(seed)
    renamed = [replace(track, id=number) for track, number in zip(tracks, names, strict=True)]
    found, shuffled = (answers(part, Scene([LINE])).tables["crossings"] for part in (tracks, renamed[::-1]))
    assert shuffled["frame"] == found["frame"]
    assert shuffled["id"] == [names[number - 1] for number in found["id"]]


@given(seed=seeds, gaps=st.integers(1, 10))
def test_a_straight_way_with_gaps_is_the_whole_way(seed: int, gaps: int) -> None:
    """Frames missing on a straight way change neither counts nor the frame of a crossing."""
    rng = np.random.default_rng(seed)
    whole = walker(np.linspace(rng.uniform([100, 60], [500, 150]), rng.uniform([100, 300], [500, 440]), 30))
    rows = np.delete(np.arange(30), 1 + rng.permutation(28)[:gaps])
    parts = replace(
        whole, **{name: getattr(whole, name)[rows] for name in ("frames", "boxes", "scores", "observed", "origin")}
    )
    tables = [answers([track], Scene([LINE])).tables["crossings"] for track in (whole, parts)]
    assert tables[0]["frame"] == tables[1]["frame"]
    assert len(tables[0]["frame"]) == 1
