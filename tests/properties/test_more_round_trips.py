"""What is written is read again: animals, points in space, cameras, lenses, bodies, scenes and networks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.properties.drawn import boxes_of, new_folder, seeds
from tests.properties.test_cameras import SIZE, fisheye_of, pinhole_of
from tests.properties.test_flow import graph_of
from tests.properties.test_shapes import LEARNT
from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.bodies.body import LearntBody, read_body, write_body
from tsuiseki.tracking.cameras.calibration import pose_at
from tsuiseki.tracking.cameras.camera_files import Placed, read_cameras, write_cameras
from tsuiseki.tracking.cameras.lens_files import LensFormat, read_intrinsics, read_lens, write_intrinsics, write_lens
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera
from tsuiseki.tracking.counts.scene import Scene, SceneLine, SceneZone, read_scene, scene_text
from tsuiseki.tracking.formats.body_points import read_poses_file, write_deeplabcut, write_sleap
from tsuiseki.tracking.formats.body_states import read_states, write_states
from tsuiseki.tracking.formats.sleap_hdf5 import write_sleap_analysis, write_sleap_project
from tsuiseki.tracking.formats.tracked_video import TrackedVideo
from tsuiseki.tracking.formats.world_tables import read_path3d, write_path3d, write_track3d
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import STATUSES, Position
from tsuiseki.tracking.types.measurements import SensedTrack
from tsuiseki.tracking.types.tracks import BodyTrack, Path3D, PointTable

LENGTH = 6
counts = st.integers(1, 3)


def bodies_of(rng: np.random.Generator, count: int) -> list[BodyTrack]:
    tracks = []
    for number in range(1, count + 1):
        frames = np.sort(rng.permutation(LENGTH)[: rng.integers(1, LENGTH + 1)])
        statuses = tuple(STATUSES[k] for k in rng.integers(0, 3, len(frames)))
        scores = rng.random(len(frames)).round(3)
        tracks.append(BodyTrack(number, frames, rng.normal(0, 50, (len(frames), 4)).round(4), scores, statuses))
    return tracks


def assert_equal_fields(found: object, expected: object, digits: float = 0.0) -> None:
    """All fields are the same, numbers but for a difference."""
    for name, value in vars(expected).items():
        if isinstance(value, float) or (isinstance(value, np.ndarray) and value.dtype.kind == "f"):
            np.testing.assert_allclose(vars(found)[name], value, atol=digits, rtol=digits)
        else:
            np.testing.assert_array_equal(vars(found)[name], value)


@pytest.mark.slow
@given(seed=seeds, count=counts)
def test_states_of_bodies_come_back(seed: int, count: int) -> None:
    """Frames, states, scores and statuses of bodies are those that were written."""
    tracks, fields = bodies_of(np.random.default_rng(seed), count), ("a", "b", "theta", "phi")
    with new_folder() as folder:
        write_states(folder / "states.csv", tracks, fields)
        back = read_states(folder / "states.csv", fields)
        loaded = Result.load(Result(tracks, names=fields).save(folder / "result.csv"))
    assert len(back) == len(loaded) == count
    for track, exact, expected in zip(back, loaded, tracks, strict=True):
        assert_equal_fields(track, expected, 1e-3)
        assert_equal_fields(exact, expected)


@pytest.mark.parametrize("kind", ["sleap.csv", "dlc.csv", "h5", "slp"])
@given(seed=seeds, count=counts)
def test_points_of_animals_come_back(kind: str, seed: int, count: int) -> None:
    """Points, their scores and whose they are come back from SLEAP's and DeepLabCut's files; missing ones stay so."""
    pytest.importorskip("h5py" if kind in ("h5", "slp") else "numpy")
    rng = np.random.default_rng(seed)
    frames = np.repeat(np.arange(LENGTH), count)
    names = tuple(f"track_{k}" for k in range(1, count + 1)) * LENGTH
    points, scores = rng.uniform(0, 90, (len(frames), 2, 2)).round(3), rng.random((len(frames), 2)).round(3)
    missing = rng.random(scores.shape) < 0.2
    missing[:, 0] = False
    points[missing], scores[missing] = np.nan, np.nan
    table = PointTable(("head", "tail"), frames, names, points, scores)
    with new_folder() as folder:
        path = folder / f"points.{kind}"
        write_points_of(path, kind, table)
        back = read_poses_file(path)
    assert back.nodes == table.nodes
    order = np.lexsort([names, frames])
    found = np.lexsort([back.tracks, back.frames])
    np.testing.assert_array_equal(back.frames[found], frames[order])
    assert [back.tracks[k] for k in found] == [names[k] for k in order]
    np.testing.assert_allclose(back.points[found], points[order], atol=1e-3)
    np.testing.assert_allclose(back.scores[found], scores[order], atol=1e-3)


def write_points_of(path: Path, kind: str, table: PointTable) -> None:
    if kind == "sleap.csv":
        write_sleap(path, table)
    elif kind == "dlc.csv":
        write_deeplabcut(path, table, LENGTH)
    elif kind == "h5":
        write_sleap_analysis(path, table, LENGTH)
    else:
        write_sleap_project(path, TrackedVideo([], "fish.mp4", length=LENGTH, points=table))


def positions_of(rng: np.random.Generator, count: int) -> list[Position]:
    roots = rng.normal(0, 0.1, (count, 3, 3))
    statuses = [STATUSES[k] for k in rng.integers(0, 3, count)]
    return [
        Position(k / 50, rng.normal(size=3), root @ root.T, rng.random(), status, rng.normal(size=3), rng.random(2))
        for k, (root, status) in enumerate(zip(roots, statuses, strict=True))
    ]


@pytest.mark.parametrize("ending", [".csv", ".json"])
@given(seed=seeds, count=counts)
def test_positions_in_space_come_back(ending: str, seed: int, count: int) -> None:
    """A ball's positions, covariances and speeds come back from a result, times and points from `track3d.csv`, too."""
    positions = positions_of(np.random.default_rng(seed), count)
    path3d = Path3D(np.array([p.time for p in positions]), np.stack([p.point for p in positions]))
    with new_folder() as folder:
        loaded = Result.load(Result(positions).save(folder / f"result{ending}"))
        write_track3d(folder / "track3d.csv", positions)
        write_path3d(folder / "truth.csv", path3d)
        for name in ("track3d.csv", "truth.csv"):
            assert_equal_fields(read_path3d(folder / name), path3d, 1e-3)
    for position, expected in zip(loaded, positions, strict=True):
        # Text has nine digits.
        assert_equal_fields(position, expected, 1e-8)


@given(seed=seeds, count=counts, dimensions=st.sampled_from([2, 3]), modes=st.sampled_from([0, 2]))
def test_sensed_targets_come_back(seed: int, count: int, dimensions: int, modes: int) -> None:
    """Tracks of what a sensor measured are those that were saved."""
    rng, tracks = np.random.default_rng(seed), []
    for number in range(1, count + 1):
        scans = np.sort(rng.permutation(LENGTH)[: rng.integers(1, LENGTH + 1)])
        size = len(scans)
        places, speeds = rng.normal(size=(2, size, dimensions))
        covariances = np.tile(np.diag(rng.uniform(1, 2, 2 * dimensions)), (size, 1, 1)) + 0.1
        shares = rng.random(size), rng.random((size, modes))
        tracks.append(SensedTrack(number, scans, scans / 10, places, speeds, covariances, *shares))
    with new_folder() as folder:
        back = Result.load(Result(tracks).save(folder / "result.json"))
    for track, expected in zip(back, tracks, strict=True):
        assert_equal_fields(track, expected, 1e-9)


@given(seed=seeds, floor=st.booleans(), rate=st.none() | st.floats(1, 100), offset=st.floats(-9, 9))
def test_cameras_come_back(seed: int, floor: bool, rate: float | None, offset: float) -> None:
    """A pinhole camera and a fisheye see the same after `cameras.yaml` was written and read."""
    rng = np.random.default_rng(seed)
    ceiling = pose_at(OmnidirectionalCamera(fisheye_of(rng), np.eye(3), np.zeros(3)), 3.0, 0.1, 0.2)
    room = np.array([0.0, -1, 8, 9]) if floor else None
    cameras = [Placed("door", pinhole_of(rng), rate, offset, room), Placed("ceiling", ceiling, None, 0.0, room)]
    with new_folder() as folder:
        write_cameras(folder / "cameras.yaml", cameras)
        back = read_cameras(folder / "cameras.yaml")
    pixels = rng.uniform(0, SIZE, (10, 2))
    for placed, expected in zip(back, cameras, strict=True):
        assert (placed.name, placed.frame_rate) == (expected.name, expected.frame_rate)
        assert placed.offset == pytest.approx(expected.offset)
        np.testing.assert_array_equal(placed.floor, expected.floor)
        np.testing.assert_allclose(placed.camera.rays(pixels), expected.camera.rays(pixels), atol=1e-9)
        np.testing.assert_allclose(placed.camera.position, expected.camera.position, atol=1e-9)


@pytest.mark.parametrize("kind", ["ocam", "py-ocam"])
@settings(max_examples=8)
@given(seed=seeds)
def test_lenses_of_ocamcalib_come_back(kind: LensFormat, seed: int) -> None:
    """The lens in OCamCalib's text and in py-OCamCalib's JSON sees along the same rays."""
    rng = np.random.default_rng(seed)
    lens = fisheye_of(rng)
    with new_folder() as folder:
        path = folder / f"lens{'.txt' if kind == 'ocam' else '.json'}"
        apart = write_lens(path, lens, kind)
        back = read_lens(path, SIZE)
    pixels = rng.uniform([200, 120], [440, 360], (20, 2))
    np.testing.assert_allclose(back.rays(pixels), lens.rays(pixels), atol=1e-6)
    assert np.nanmax(apart) < 0.01


@given(seed=seeds)
def test_intrinsics_come_back(seed: int) -> None:
    """What is written as OpenCV's calibration does is the same lens when read."""
    camera = pinhole_of(np.random.default_rng(seed))
    with new_folder() as folder:
        write_intrinsics(folder / "lens.yaml", camera, 0.2)
        back = read_intrinsics(folder / "lens.yaml")
    assert (back.width, back.height) == SIZE
    for name in ("focal", "principal_point", "distortion"):
        np.testing.assert_allclose(getattr(back, name), getattr(camera, name))


@given(seed=seeds, modes=st.integers(1, 3))
def test_learnt_bodies_come_back(seed: int, modes: int) -> None:
    """A body that was learnt draws the same contours when read."""
    rng = np.random.default_rng(seed)
    shapes = rng.normal(0, 5, (2, modes, 12, 2)).round(4)
    body = LearntBody("worm", LEARNT.mean.round(4), *shapes, np.tile([-1.5, 2.0], (modes, 1)))
    with new_folder() as folder:
        write_body(folder / "body.json", body)
        back = read_body(folder / "body.json")
    states = rng.normal(0, 2, (5, 3 + modes))
    np.testing.assert_array_equal(back.contour(states), body.contour(states))
    assert (back.name, back.fields) == (body.name, body.fields)


@given(seed=seeds, metres=st.booleans(), ignored=st.booleans())
def test_scenes_come_back(seed: int, metres: bool, ignored: bool) -> None:
    """Lines, zones and regions of a scene are those that were drawn."""
    rng = np.random.default_rng(seed)
    line = SceneLine("Tür", rng.uniform(0, 300, (2, 2)), ("hinein", "hinaus"))
    (x1, y1, x2, y2), *_ = boxes_of(rng, 1)
    corners = np.array([[x1, y1], [x2, y1], [x2, y2], [x1, y2]])
    scene = Scene([line], [SceneZone("shop", corners)], (640, 480), "pixels", 0.02 if metres else None, None,
                  2 * corners, [corners + 1] if ignored else [])  # fmt: skip
    with new_folder() as folder:
        (folder / "scene.yaml").write_text(scene_text(scene), encoding="utf-8")
        back = read_scene(folder / "scene.yaml")
    assert (back.size, back.unit, back.scale) == (scene.size, scene.unit, scene.scale)
    assert (back.lines[0].name, back.lines[0].directions) == ("Tür", ("hinein", "hinaus"))
    np.testing.assert_array_equal(back.lines[0].ends, line.ends)
    np.testing.assert_array_equal(back.zones[0].corners, corners)
    np.testing.assert_array_equal(back.region, 2 * corners)
    np.testing.assert_array_equal(back.ignored, [corners + 1] if ignored else [])


@given(seed=seeds, count=st.integers(0, 6))
def test_networks_come_back(seed: int, count: int) -> None:
    """The network that a video was solved on has the same costs, links and detections."""
    rng = np.random.default_rng(seed)
    graph = graph_of(seed, count)
    origin, track = rng.integers(-1, 5, (count, 2)), rng.integers(0, 3, count)
    network = SolvedNetwork(
        np.arange(count), boxes_of(rng, count), rng.random(count), origin, graph, track, 3, 20, 12.5
    )
    with new_folder() as folder:
        network.write(folder / "flow.npz")
        back = SolvedNetwork.read(folder / "flow.npz")
    assert_equal_fields(back.graph, graph, 1e-6)
    for name in ("frames", "boxes", "scores", "origin", "track", "fewest", "fill", "rate"):
        np.testing.assert_array_equal(getattr(back, name), getattr(network, name))
