from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from tsuiseki.datamodules import training_images
from tsuiseki.datamodules.scenes import training_pictures
from tsuiseki.datamodules.scenes.figures import rendering
from tsuiseki.datamodules.scenes.figures.assets import Assets
from tsuiseki.datamodules.scenes.figures.figure import Figure
from tsuiseki.datamodules.scenes.figures.library import SpriteLibrary, SpriteSettings, write_sprites
from tsuiseki.datamodules.scenes.figures.mesh import Worn
from tsuiseki.datamodules.scenes.figures.rendering import Sprite, random_sprites, render_figure, smaller, steady_sides
from tsuiseki.datamodules.scenes.figures.standing_sprites import Standing, dressed, tilt_of
from tsuiseki.datamodules.scenes.people.gait import random_manner, walking
from tsuiseki.datamodules.scenes.people.person import view_from
from tsuiseki.datamodules.scenes.people.poses import draw_pose
from tsuiseki.datamodules.scenes.people.posture import Build, PersonSkeleton
from tsuiseki.datamodules.scenes.render.degrade import random_degradation
from tsuiseki.datamodules.scenes.render.shading import Light
from tsuiseki.datamodules.scenes.render.solids import Surface, boxes
from tsuiseki.datamodules.scenes.render.tracing import silhouette_box, tight
from tsuiseki.datamodules.scenes.training_pictures import random_training_scene
from tsuiseki.datamodules.scenes.training_settings import TrainingSettings, settings_of_scene
from tsuiseki.datamodules.training_images import TrainingSource
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import read_ground_truth

TILTS = SpriteSettings().tilts
CAMERA = PinholeCamera.look_at(np.array([0, 0, 3.0]), np.array([0, 12.0, 0.5]), 500, 320, 240)
BODY = boxes(np.zeros((1, 3)), np.ones((1, 3)), np.zeros(1), [Surface((0.5, 0.5, 0.5))])


def block(height: int = 40, width: int = 16) -> Sprite:
    """A grey rectangle that faces the camera; its feet are in the middle of its lower edge."""
    normal = np.zeros((height, width, 3), np.int8)
    normal[..., 0] = -127
    return Sprite(
        np.full((height, width, 3), 128, np.uint8),
        normal,
        np.full((height, width), Worn.UPPER, np.uint8),
        np.array([width / 2, height]),
        np.array([width / 2, 0.0]),
        1.75,
        0.2,
        np.array([0.0, float(width)]),
    )


def test_a_rendered_person_is_as_tall_as_asked_and_faces_the_camera(assets: Assets) -> None:
    for sprite in random_sprites(np.random.default_rng(3), assets, 4, 120, TILTS):
        height, width = sprite.label.shape
        assert 0.6 * 120 < height < 1.25 * 120
        assert width < height
        assert sprite.feet[1] == pytest.approx(height, abs=0.25 * height)
        there = sprite.label > 0
        length = np.linalg.norm(sprite.normal[there].astype(float), axis=1)
        assert np.abs(length - 127).max() < 2
        # Seen surfaces look at the camera, up to the change of its direction over the person.
        towards = np.array([-np.cos(sprite.tilt), 0.0, np.sin(sprite.tilt)])
        assert (sprite.normal[there] @ towards > -0.35 * 127).all()
        assert {Worn.SKIN} < set(np.unique(sprite.label[there]))


def test_a_steady_box_is_the_mean_of_a_walk(assets: Assets) -> None:
    rng = np.random.default_rng(8)
    figure, manner = Figure(rng, assets), random_manner(rng)
    build = Build(figure.height)
    camera = view_from(0.1, 200, figure.height, 15.0)
    # From the side, where legs and arms swing across.
    poses = [walking(build, manner, phase, 1.2) for phase in np.arange(8) / 8]
    skeletons = [PersonSkeleton(build, pose, np.zeros(2), np.pi / 2) for pose in poses]
    seen = [render_figure(figure, skeleton, camera, 0.1) for skeleton in skeletons]
    about_feet = np.array([s.steady - s.feet[0] for s in seen])
    np.testing.assert_allclose([np.ptp(s.steady) for s in seen], [s.label.shape[1] for s in seen])
    assert np.ptp(about_feet[:, 1] - about_feet[:, 0]) > 20
    steady = [steady_sides(figure, skeletons[n], skeletons, camera, seen[n]) - seen[n].feet[0] for n in (0, 3)]
    for sides in steady:
        # Some vertices stand for all: a pixel or two.
        np.testing.assert_allclose(sides, about_feet.mean(axis=0), atol=2)


def test_who_walks_has_a_steady_box_and_who_stands_that_of_the_silhouette(assets: Assets) -> None:
    sprites = [s for n in range(12) for s in random_sprites(np.random.default_rng(n), assets, 1, 96, (0.0, 0.3))]
    apart = [np.abs(s.steady - [0, s.label.shape[1]]).max() for s in sprites]
    assert 0 < sum(a == 0 for a in apart) < len(sprites) / 2
    assert max(apart) > 4
    assert all(-48 < s.steady[0] < s.steady[1] < s.label.shape[1] + 48 for s in sprites)


def test_steady_sides_stand_where_the_person_does() -> None:
    sprite = replace(block(), steady=np.array([-4.0, 12.0]))
    spot = np.array([1.0, 14.0])
    ends, _ = CAMERA.project(np.array([[*spot, 0.0], [*spot, 1.75]]))
    scale = np.linalg.norm(ends[1] - ends[0]) / 40
    middle = ends[:, 0].mean()
    left, right = Standing(sprite, spot, BODY).steady_sides(CAMERA)
    assert (left, right) == pytest.approx((middle - 12 * scale, middle + 4 * scale), abs=0.2)
    np.testing.assert_allclose(smaller(sprite, 0.5).steady, [-2, 6])


@pytest.mark.slow
def test_pictures_with_steady_boxes_are_the_same_pictures(library: Path) -> None:
    settings = TrainingSettings((160, 120), people=(4, 4), clutter=(2, 2), rendered=1.0)
    stock = SpriteLibrary(library)
    shown, boxes, visibility = random_training_scene(np.random.default_rng(9), settings, stock)
    again, steady, as_visible = random_training_scene(
        np.random.default_rng(9), replace(settings, boxes="steady"), stock
    )
    np.testing.assert_array_equal(shown, again)
    np.testing.assert_array_equal(visibility, as_visible)
    np.testing.assert_array_equal(boxes[:, [1, 3]], steady[:, [1, 3]])
    moved = np.abs(boxes - steady)[:, [0, 2]].max(axis=1)
    assert 0 < moved.max() < 0.3 * (boxes[:, 3] - boxes[:, 1]).max()


def test_a_library_without_steady_sides_is_refused(library: Path, tmp_path: Path) -> None:
    rows = (library / "sprites.csv").read_text().splitlines()
    (tmp_path / "sprites.csv").write_text("\n".join(",".join(row.split(",")[:-2]) for row in rows))
    with pytest.raises(RequestError, match=r"expected columns file, .*, got none left; make it anew"):
        SpriteLibrary(tmp_path)


def test_smaller_keeps_colour_and_shape() -> None:
    half = smaller(block(), 0.5)
    assert half.label.shape == (20, 8)
    assert (half.label == Worn.UPPER).all()
    assert np.abs(half.albedo.astype(int) - 128).max() <= 1
    np.testing.assert_allclose(half.feet, [4, 20])


def test_a_sprite_stands_where_a_person_of_its_height_is_seen() -> None:
    spot = np.array([1.0, 14.0])
    ends, _ = CAMERA.project(np.array([[*spot, 0.0], [*spot, 1.75]]))
    traced = Standing(block(), spot, BODY).trace(CAMERA, 2)
    assert traced is not None
    x1, y1, x2, y2 = silhouette_box(traced, 2)
    assert (y1, y2) == pytest.approx((ends[1, 1], ends[0, 1]), abs=1)
    assert (x1 + x2) / 2 == pytest.approx(ends[:, 0].mean(), abs=1)
    assert (x2 - x1) / (y2 - y1) == pytest.approx(16 / 40, abs=0.05)


def test_nobody_is_seen_behind_the_camera() -> None:
    assert Standing(block(), np.array([0.0, -5.0]), BODY).trace(CAMERA, 2) is None


def test_light_falls_on_the_side_it_comes_from() -> None:
    standing = Standing(block(), np.array([0.0, 14.0]), BODY)
    traced = standing.trace(CAMERA, 1)
    assert traced is not None
    layer = traced
    nothing, sun = np.zeros(3, np.float32), np.ones(3, np.float32)
    for direction, brightness in (([0, -1, 0], 1.0), ([0, 1, 0], 0.0), ([1, 0, 0], 0.0)):
        light = Light(np.array(direction, np.float32), sun, nothing, nothing)
        colours = standing.shade(layer, layer.mask, CAMERA, 1, light)
        np.testing.assert_allclose(colours, brightness * (128 / 255) ** 2, atol=0.01)


def test_clothes_change_and_shapes_do_not(assets: Assets) -> None:
    people = (random_sprites(np.random.default_rng(n), assets, 1, 80, TILTS)[0] for n in range(5, 30))
    sprite = next(sprite for sprite in people if (sprite.label == Worn.UPPER).any())
    looks = [dressed(np.random.default_rng(n), sprite) for n in range(12)]
    for other in looks:
        straight = np.array_equal(other.label, sprite.label)
        assert straight or np.array_equal(other.label[:, ::-1], sprite.label)
        assert not other.albedo[other.label == 0].any()
        if not straight:
            np.testing.assert_array_equal(other.normal[:, ::-1, 1], -sprite.normal[..., 1])
            assert other.feet[0] == pytest.approx(sprite.label.shape[1] - sprite.feet[0])
            np.testing.assert_allclose(other.steady, sprite.label.shape[1] - sprite.steady[::-1])
    assert len({tuple(o.albedo[o.label == Worn.UPPER].mean(axis=0).round()) for o in looks}) > 6


def test_a_library_comes_back_as_it_was_rendered(assets_folder: Path, library: Path, tmp_path: Path) -> None:
    again = write_sprites(tmp_path / "again", assets_folder, SpriteSettings(3, 2, 64, 1), 4)
    first, second = SpriteLibrary(library), SpriteLibrary(again)
    assert len(first) == 6
    sprites = random_sprites(np.random.default_rng([4, 1]), Assets(assets_folder), 2, 64, TILTS)
    for n in range(6):
        a, b = first.sprite(n), second.sprite(n)
        np.testing.assert_array_equal(a.albedo, b.albedo)
        np.testing.assert_array_equal(a.normal, b.normal)
    np.testing.assert_allclose(first.sprite(2).steady, sprites[0].steady, atol=1e-3)
    np.testing.assert_array_equal(first.sprite(2).albedo, sprites[0].albedo)
    np.testing.assert_array_equal(first.sprite(2).label, sprites[0].label)
    np.testing.assert_array_equal(first.sprite(2).normal, sprites[0].normal)


def test_sprites_seen_from_about_the_same_height_are_taken(library: Path) -> None:
    sprites = SpriteLibrary(library)
    wanted = float(sprites.tilts[3])
    assert sprites.near(np.random.default_rng(0), wanted).tilt == pytest.approx(wanted, abs=1e-4)
    assert tilt_of(CAMERA, np.array([0.0, 2.1])) == pytest.approx(np.pi / 4)


@pytest.fixture
def clean(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training_pictures, "random_degradation", partial(random_degradation, strength=0.0))


@pytest.mark.usefixtures("clean")
def test_rendered_people_take_the_places_of_drawn_ones_and_leave_the_rest(library: Path) -> None:
    settings = TrainingSettings((160, 120), people=(4, 4), clutter=(2, 2), rendered=1.0)
    drawn, boxes, _ = random_training_scene(np.random.default_rng(9), settings)
    shown, others, _ = random_training_scene(np.random.default_rng(9), settings, SpriteLibrary(library))
    assert len(boxes) == len(others) > 0
    apart = np.abs(boxes[:, [1, 3]] - others[:, [1, 3]]).max()
    assert apart < 0.5 * (boxes[:, 3] - boxes[:, 1]).max()
    outside = np.ones((120, 160), dtype=np.bool_)
    for x1, y1, x2, y2 in np.concatenate([boxes, others]):
        outside[max(int(y1) - 2, 0) : int(y2) + 3, max(int(x1) - 2, 0) : int(x2) + 3] = False
    assert outside.mean() > 0.3
    assert np.abs(drawn[outside].astype(int) - shown[outside].astype(int)).max() <= 8
    assert np.abs(drawn.astype(int) - shown.astype(int)).max() > 8


def _varied(folder: Path, count: int, scene: Any = "varied", **given: Any) -> TrainingSource:
    return TrainingSource(str(folder), generate=count, scene=scene, **given)


@pytest.mark.slow
def test_varied_pictures_show_them(library: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training_images, "on_all_cores", lambda work, items, _: map(work, items))
    folder = tmp_path / "pictures"
    training_images.write_pictures(_varied(folder, 3, sprites=str(library), seed=1), (96, 72))
    assert len(list((folder / "img1").iterdir())) == 3
    assert len(read_ground_truth(folder / "gt" / "gt.txt").boxes) > 0


def test_things_are_refused_where_there_are_none(library: Path, tmp_path: Path) -> None:
    (tmp_path / "photographs" / "views").mkdir(parents=True)
    cv2.imwrite(str(tmp_path / "photographs" / "views" / "grey.png"), np.full((8, 8, 3), 99, np.uint8))
    for photographs in ("", str(tmp_path / "photographs")):
        source = _varied(tmp_path / "pictures", 1, sprites=str(library), photographs=photographs, things=True)
        with pytest.raises(RequestError, match="expected photographs of things"):
            training_images.write_pictures(source, (96, 72))
    assert not (tmp_path / "pictures").exists()


@pytest.mark.slow
def test_aerial_pictures_look_down_on_people(library: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training_images, "on_all_cores", lambda work, items, _: map(work, items))
    near, asked = SpriteLibrary.near, []

    def noted(self: SpriteLibrary, rng: np.random.Generator, tilt: float, pose: str | None = None) -> Sprite:
        asked.append(tilt)
        return near(self, rng, tilt, pose)

    monkeypatch.setattr(SpriteLibrary, "near", noted)
    tilts = {}
    for scene in ("varied", "aerial"):
        asked.clear()
        training_images.write_pictures(_varied(tmp_path / scene, 12, scene, sprites=str(library), seed=3), (96, 72))
        assert len(read_ground_truth(tmp_path / scene / "gt" / "gt.txt").boxes) > 5
        tilts[scene] = np.degrees(asked)
    assert np.median(tilts["aerial"]) > np.median(tilts["varied"]) + 10
    assert tilts["aerial"].max() > 45


def test_sprites_are_seen_from_as_high_as_asked(assets: Assets) -> None:
    tilts = [s.tilt for n in range(3) for s in random_sprites(np.random.default_rng(n), assets, 3, 48, (1.1, 1.3))]
    assert 1.1 <= min(tilts) < max(tilts) <= 1.3
    above = random_sprites(np.random.default_rng(0), assets, 3, 96, (1.3, 1.3))
    # Feet and head come together: at 75 degrees a person's axis is a quarter of what it is from the side.
    for sprite in above:
        assert np.linalg.norm(sprite.feet - sprite.head) < 0.6 * 96


def test_folders_without_what_is_needed_are_refused(
    tmp_path: Path, assets_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(RequestError, match=r"expected a folder of rendered people with a file sprites\.csv"):
        SpriteLibrary(tmp_path)
    with pytest.raises(ValidationError, match="people"):
        SpriteSettings(people=0)
    for tilts in ((0.2, 1.6), (1.0, 0.5), (float("nan"), 1.0)):
        with pytest.raises(ValidationError, match="tilts"):
            SpriteSettings(tilts=tilts)
    assert main(["simulate", "sprites", "--assets", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "3dobjs/base.obj" in line
    assert not (tmp_path / "out").exists()
    with pytest.raises(RequestError, match="clothes/nothing"):
        Assets(assets_folder).garment("clothes", "nothing")


@pytest.fixture(scope="module")
def posed(tmp_path_factory: pytest.TempPathFactory, assets_folder: Path) -> SpriteLibrary:
    settings = SpriteSettings(2, 3, 64, 1, (0.9, 1.55), poses=1.0)
    return SpriteLibrary(write_sprites(tmp_path_factory.mktemp("posed") / "library", assets_folder, settings, 6))


def test_poses_come_back_from_a_library(posed: SpriteLibrary) -> None:
    for number in range(len(posed)):
        sprite = posed.sprite(number)
        name, seed = sprite.drawn.rsplit(" ", 1)
        assert sprite.pose == draw_pose(int(seed), Build(sprite.height), name)
        assert 0.1 < sprite.middle < 1.2
    with pytest.raises(ValidationError, match="poses"):
        SpriteSettings(poses=1.5)


@pytest.mark.parametrize(
    ("name", "beyond"),
    [("cycling", 1.1), ("in a wheelchair", 1.05), ("pushing a pram", 1.3), ("under an umbrella", 1.2)],
)
def test_boxes_go_round_people_and_not_what_they_ride_or_push(
    name: str, beyond: float, assets: Assets, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rendering, "random_name", lambda _: name)
    larger = []
    for seed in range(4):
        (sprite,) = random_sprites(np.random.default_rng(seed), assets, 1, 96, (0.1, 0.2), 1.0)
        traced = Standing(dressed(np.random.default_rng(seed), sprite), np.array([0.0, 14.0]), BODY).trace(CAMERA, 2)
        assert traced is not None
        layer = traced
        whole, box = tight(layer.mask), silhouette_box(layer, 2) * 2 - [layer.left, layer.top] * 2
        assert (box[:2] >= whole[:2]).all()
        assert (box[2:] <= whole[2:]).all()
        larger.append(np.prod(whole[2:] - whole[:2]) / np.prod(box[2:] - box[:2]))
    assert np.median(larger) > beyond


@pytest.mark.parametrize("spot", [(0.02, 0.0), (1.5, -1.0)])
def test_who_is_seen_from_above_is_placed_by_the_middle(posed: SpriteLibrary, spot: tuple[float, float]) -> None:
    camera = PinholeCamera.look_at(np.array([0, 0, 6.0]), np.array([0.0, 0.01, 0.0]), 300, 320, 320)
    for number in range(len(posed)):
        sprite, place = posed.sprite(number), np.array(spot)
        scale = 300 / (6.0 - sprite.middle) * sprite.height / 64
        for shown in (sprite, *(dressed(np.random.default_rng(n), sprite) for n in range(3))):
            traced = Standing(shown, place, BODY).trace(camera, 1)
            assert traced is not None
            box = silhouette_box(traced, 1)
            middle = camera.project(np.array([[*place, sprite.middle]]))[0][0]
            assert np.linalg.norm((box[:2] + box[2:]) / 2 - middle) < 0.6 * scale * 64
            assert sorted(box[2:] - box[:2])[1] < 1.5 * scale * max(sprite.label.shape)


@pytest.mark.usefixtures("clean")
def test_pictures_from_straight_above_show_people_within_the_lens(posed: SpriteLibrary) -> None:
    settings = replace(
        settings_of_scene("overhead", np.random.default_rng(0), (120, 120)),
        people=(6, 6),
        clutter=(2, 2),
        samples=1,
    )
    for seed in range(3):
        image, boxes, visibility = random_training_scene(np.random.default_rng(seed), settings, posed)
        assert image[:3, :3].max() < 30
        assert image[40:80, 40:80].mean() > 30
        assert len(boxes) == len(visibility) > 2
        assert (np.hypot(*(((boxes[:, :2] + boxes[:, 2:]) / 2 - 60).T)) < 62).all()
