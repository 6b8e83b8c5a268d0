"""Learning a body from silhouettes: it finds the bend that nobody told it of."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.datamodules.scenes import goldfish_clip
from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.datamodules.scenes.goldfish_clip import GoldfishClip, GoldfishSettings
from tsuiseki.tracking.bodies.body import parse_body, read_body, write_body
from tsuiseki.tracking.bodies.contour import EdgeImage, Extraction, point_distances, wide_noise
from tsuiseki.tracking.bodies.settings import DeformableSettings
from tsuiseki.tracking.bodies.tracker import DeformableTracker
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.colour_region import parse_colour
from tsuiseki.tracking.filters.body_motion import RandomWalk
from tsuiseki.tracking.formats.body_states import centre_inside, read_states
from tsuiseki.trainers.learn_body import Outline, area_centroids, evenly_sampled, learn_body, line_up, outlines_of

SETTINGS = GoldfishSettings(frames=60, fish=3)


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(goldfish_clip, "SPREAD", 0.0)
        return write_clip(tmp_path_factory.mktemp("clips") / "clip", GoldfishClip(SETTINGS, 5))


@pytest.fixture(scope="module")
def fit(clip):
    return learn_body(outlines_of(clip, None))


def closed_line(rng, points=256):
    """A smooth closed line without symmetry."""
    angle = np.arange(points) * 2 * np.pi / points
    radius = 30 + sum(rng.normal(0, 4 / k) * np.cos(k * angle + rng.uniform(0, 6)) for k in range(1, 6))
    return radius * np.exp(1j * angle)


def test_lines_that_differ_by_turn_and_start_only_line_up_exactly():
    rng = np.random.default_rng(0)
    line = closed_line(rng)
    turns, starts = rng.uniform(-3, 3, 20), rng.integers(0, 256, 20)
    lines = np.array([np.roll(line, s) * np.exp(1j * t) for s, t in zip(starts, turns, strict=True)])
    aligned, found = line_up(lines)
    assert np.abs(aligned - aligned[0]).max() < 1e-6
    relative = np.exp(1j * (found - found[0] - turns + turns[0]))
    assert np.abs(np.angle(relative)).max() < 1e-6


def test_centroid_and_sampling_of_a_rectangle():
    corners = np.array([[0, 0], [8, 0], [8, 2], [0, 2]], dtype=float)
    line = evenly_sampled(corners, 40)
    assert np.abs(np.diff(line)) == pytest.approx(0.5)
    assert area_centroids(line[None])[0] == pytest.approx(4 + 1j)


@pytest.mark.slow
def test_the_first_mode_is_the_bend_of_the_fish(clip, fit):
    tracks = {track.id: track for track in read_states(clip / "states.csv")}
    exact = np.array([tracks[o.identity].states[o.frame] for o in outlines_of(clip, None)])
    assert len(exact) > 150
    assert np.corrcoef(fit.states[:, 3], exact[:, 3])[0, 1] > 0.98
    ahead = np.cos(fit.states[:, 2] - exact[:, 2])
    assert ahead.min() > 0.5, "the nose is found by motion"
    assert fit.explained[0] > 0.8


def test_the_body_draws_the_outlines_it_was_learnt_from(clip, fit):
    """One number for the bend leaves less than a pixel; outlines of pixels alone leave about half of one."""
    assert fit.residual < 1.0 < fit.spread
    contours = fit.body.contour(fit.states)
    for outline, contour in list(zip(outlines_of(clip, None), contours, strict=True))[::20]:
        nearest = np.linalg.norm(contour[:, None] - outline.points[None], axis=2).min(axis=1)
        assert nearest.max() < 5.0
        assert np.median(nearest) < 1.0
    assert np.linalg.norm(contours - fit.states[:, None, :2], axis=2).max() <= fit.body.radius


def test_it_fits_fish_it_has_not_seen(fit, monkeypatch):
    """Searched over bend and heading, the learnt body lies within 5 pixels of the edges of another clip's fish."""
    rng = np.random.default_rng(2)
    extraction = Extraction(parse_colour("orange"))
    monkeypatch.setattr(goldfish_clip, "PEBBLES", 0)
    monkeypatch.setattr(goldfish_clip, "GLINTS", 0.0)
    drawn = GoldfishClip(GoldfishSettings(frames=20, fish=1), seed=77)
    for (image, _), exact in (drawn.draw_frame(number) for number in range(0, 20, 5)):
        edges = EdgeImage.of(image, extraction)
        states = np.tile([*exact[0, :3], 0.0], (20000, 1))
        low, high = fit.body.limits[3]
        states += np.column_stack([rng.normal(0, 12, (20000, 2)), rng.normal(0, 0.4, 20000), np.zeros(20000)])
        states[:, 3] = rng.uniform(low, high, 20000)
        assert point_distances(edges, fit.body.contour(states)).max(axis=1).min() < 5.0


@pytest.mark.slow
def test_the_tracker_follows_a_body_that_nobody_drew(fit, monkeypatch):
    """On the fish of another clip, and of the size that was learnt."""
    monkeypatch.setattr(goldfish_clip, "SPREAD", 0.0)
    frames = list(GoldfishClip(GoldfishSettings(frames=40, fish=1), seed=78).frames())
    extraction = Extraction(parse_colour("orange"))
    tracker = DeformableTracker(fit.body, RandomWalk(wide_noise(fit.body)), extraction, DeformableSettings(2000))
    for index, ((image, _), _) in enumerate(frames):
        tracker.update_edges(index, EdgeImage.of(image, extraction))
    (track,) = tracker.tracks()
    silhouettes = np.stack([shown for (_, shown), _ in frames])
    assert centre_inside(silhouettes, 1, track.states[:, :2]).all()
    exact = np.array([states[0] for _, states in frames])
    assert np.cos(track.states[:, 2] - exact[:, 2]).min() > 0.5
    assert np.corrcoef(track.states[:, 3], exact[:, 3])[0, 1] > 0.8


def test_without_silhouettes_a_colour_does(clip):
    from_colour = learn_body(outlines_of(clip, None))
    (clip / "silhouettes").rename(clip / "hidden")
    try:
        with pytest.raises(RequestError, match="colour"):
            outlines_of(clip, None)
        found = learn_body(outlines_of(clip, Extraction(parse_colour("orange"))))
    finally:
        (clip / "hidden").rename(clip / "silhouettes")
    difference = found.body.contour(np.zeros((1, 4))) - from_colour.body.contour(np.zeros((1, 4)))
    assert np.abs(np.ptp(difference, axis=1)).max() < 12.0
    assert found.explained[0] > 0.6


def test_files_and_commands(clip, fit, tmp_path, capsys):
    write_body(tmp_path / "mine.json", fit.body)
    states = fit.states[:20]
    assert parse_body(str(tmp_path / "mine.json")).contour(states) == pytest.approx(fit.body.contour(states), abs=0.01)
    words = ["train", "body", str(clip), "--out", str(tmp_path / "fish.json"), "--plot", str(tmp_path / "fish.png")]
    assert main(words) == 0
    assert "180 silhouettes" in capsys.readouterr().out
    assert read_body(tmp_path / "fish.json").name == "fish"
    assert (tmp_path / "fish.png").read_bytes().startswith(b"\x89PNG")
    assert main(words) == 2
    assert "--overwrite" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--modes", "0"], "--modes: expected a number greater than 0"),
        (["--modes", "100"], "at least 202 whole silhouettes"),
        (["--colour", "orange", "--smooth", "4"], "odd number"),
        (["--colour", "beige"], "expected a colour"),
    ],
)
def test_wrong_requests_are_refused_in_one_line(clip, tmp_path, capsys, words, message):
    assert main(["train", "body", str(clip), "--out", str(tmp_path / "x.json"), *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "x.json").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "got no JSON"),
        ("[]", "got something else"),
        ('{"format": "tsuiseki-motion-1"}', "tsuiseki-body-1"),
        ('{"format": "tsuiseki-body-1", "name": "x"}', "broken body file"),
        ('{"format": "tsuiseki-body-1", "name": "x", "mean": [[0, NaN]], "modes": [], "curves": [], "bends": []}',
         "broken body file"),
    ],
)  # fmt: skip
def test_broken_files_are_refused(tmp_path, text, message):
    (tmp_path / "b.json").write_text(text)
    with pytest.raises(RequestError, match=message):
        read_body(tmp_path / "b.json")


def test_no_file_is_refused(tmp_path):
    with pytest.raises(RequestError, match="train body"):
        read_body(tmp_path / "none.json")


def test_rigid_silhouettes_and_too_few_are_refused():
    line = closed_line(np.random.default_rng(1))
    points = np.stack([line.real, line.imag], axis=1)
    outlines = [Outline(n, 1, points + n, 2800.0, (1.0, 1.0)) for n in range(30)]
    with pytest.raises(RequestError, match="that bend"):
        learn_body(outlines)
    with pytest.raises(RequestError, match="at least 10 whole silhouettes"):
        learn_body(outlines[:9])
