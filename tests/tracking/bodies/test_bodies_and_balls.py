"""Bodies that bend and a ball in space in one call, and what cannot be."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.datamodules.scenes.goldfish_clip import GoldfishClip, GoldfishSettings
from tsuiseki.datamodules.scenes.sphere_clip import ball_cameras
from tsuiseki.tracking.bodies.run import follow_deformable, track_deformable
from tsuiseki.tracking.bodies.settings import DeformableSettings
from tsuiseki.tracking.cameras.camera_files import PlacedCamera, write_cameras
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.body_states import read_states
from tsuiseki.tracking.formats.world_tables import read_path3d
from tsuiseki.tracking.sphere.run import track_sphere
from tsuiseki.tracking.sphere.settings import SphereSettings

COLOUR = "10-42,0.42-1,0.6-1"
SETTINGS = DeformableSettings(particles=300)
CENTRE, STEP = np.array([0.0, 0.0, 1.2]), np.array([1.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def fish(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fish") / "clip"
    write_clip(folder, GoldfishClip(GoldfishSettings(frames=6, fish=1), 4))
    return folder


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A disk where a ball of 10 cm lies in two cameras, which moves by 2 cm a frame."""
    folder, rng = tmp_path_factory.mktemp("film"), np.random.default_rng(0)
    cameras = ball_cameras(2)
    for name, camera in zip(("a", "b"), cameras, strict=True):
        (folder / name).mkdir()
        for t in range(4):
            image = rng.integers(90, 110, (camera.height, camera.width, 3)).astype(np.uint8)
            centre = (CENTRE + 0.02 * t * STEP)[None]
            radius = 0.1 * camera.focal[0] / camera.to_camera(centre)[0, 2]
            place = np.round(camera.project(centre)[0][0]).astype(int).tolist()
            cv2.circle(image, place, round(radius), (200, 60, 40), -1)
            cv2.imwrite(str(folder / name / f"{t + 1:06d}.png"), image)
    write_cameras(folder / "cameras.yaml", [PlacedCamera(n, c, 15.0) for n, c in zip("ab", cameras, strict=True)])
    return folder


@pytest.mark.slow
def test_the_command_writes_the_states_that_the_function_gives(fish: Path, tmp_path: Path) -> None:
    (track,) = track_deformable(fish, colour=COLOUR, settings=SETTINGS)
    words = ["track", "deformable", str(fish), "--colour", COLOUR, "--deformable.particles", "300"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    (written,) = read_states(tmp_path / "out" / "states.csv", ("a", "b", "theta", "phi"))
    np.testing.assert_allclose(track.states, written.states, atol=1e-3)


def test_bodies_come_frame_by_frame(fish: Path) -> None:
    (track,) = track_deformable(fish, colour=COLOUR, settings=SETTINGS)
    seen = list(follow_deformable(fish, colour=COLOUR, settings=SETTINGS))
    assert [frame.index for frame, _ in seen] == list(range(6))
    for (frame, (body,)), state in zip(seen, track.states, strict=True):
        assert (body.id, body.frames.tolist()) == (1, [frame.index])
        np.testing.assert_array_equal(body.states, state[None])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"body": "eel"}, "eel"),
        ({"colour": "reddish"}, "reddish"),
        ({"preset": "learnt"}, "`preset` learnt needs `motion`"),
        ({"init": [1, 2, 3]}, "expected a,b,theta,phi as 4 finite numbers"),
        ({"init": [[900, 2, 0, 0]]}, "expected a place in the image of 640x480"),
    ],
)
def test_bodies_that_cannot_be_say_so(fish: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(RequestError, match=message):
        track_deformable(fish, **options)


@pytest.mark.slow
def test_the_command_writes_the_path_that_the_function_gives(film: Path, tmp_path: Path) -> None:
    sources, settings = [film / "a", film / "b"], SphereSettings(particles=200)
    path = track_sphere(sources, film / "cameras.yaml", 0.1, start=CENTRE, settings=settings)
    assert len(path) == 4
    for t, position in enumerate(path):
        # Half a pixel at 4 m with a focal length of 700 pixels is 3 mm; the disk is drawn on whole pixels.
        np.testing.assert_allclose(position.point, CENTRE + 0.02 * t * STEP, atol=0.02)
    words = ["track", "sphere", *map(str, sources), "--cameras", str(film / "cameras.yaml"), "--radius", "0.1"]
    words += ["--start", "0,0,1.2", "--particles", "200", "--out", str(tmp_path / "out")]
    assert main(words) == 0
    written = read_path3d(tmp_path / "out" / "track3d.csv")
    np.testing.assert_allclose([p.point for p in path], written.points, atol=1e-4)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"radius": 0}, "`radius`: expected metres above 0"),
        ({"sources": ["a"]}, "at least two videos and one camera for each, got 1"),
        ({"start": (1, 2)}, "`start`: expected x, y, z"),
        ({"start": (0, 0, 99)}, "expected the ball before the cameras"),
        ({"volume": (0, 0, 0, 1, 1, 0)}, "`volume`: expected two corners"),
    ],
)
def test_balls_that_cannot_be_say_so(film: Path, options: dict[str, Any], message: str) -> None:
    given = {"sources": ["a", "b"], "radius": 0.1} | options
    sources = [film / name for name in given.pop("sources")]
    with pytest.raises(RequestError, match=message):
        track_sphere(sources, film / "cameras.yaml", **given)


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"particles": 3}, "particles"), ({"bounce": 2}, "bounce"), ({"spread": 0}, "spread")],
)
def test_settings_of_a_ball_are_checked(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        SphereSettings(**settings)


@pytest.mark.parametrize("colour", ["any", "dark"])
def test_what_stands_out_is_followed_without_a_colour(tmp_path: Path, colour: str) -> None:
    rng = np.random.default_rng(4)
    ground = cv2.GaussianBlur(rng.integers(120, 200, (160, 240, 3)).astype(np.uint8), (0, 0), 3.0)
    places = np.array([[30.0 + 12 * t, 60.0 + 3 * t] for t in range(14)])
    for t, place in enumerate(places):
        image = ground.copy()
        cv2.circle(image, np.round(place).astype(int).tolist(), 15, (40, 45, 50), -1, cv2.LINE_AA)
        cv2.imwrite(str(tmp_path / f"{t + 1:06d}.png"), image)
    settings = replace(SETTINGS, particles=1000)
    (track,) = track_deformable(tmp_path, "ball,diameter=30", colour=colour, init=[[30, 60, 0, 0]], settings=settings)
    assert np.linalg.norm(track.states[:, :2] - places, axis=1).max() < 4.0
