"""Independent random pictures of people with exact boxes, made on the fly to train detectors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, TypeAlias

import numpy as np
from pydantic import NonNegativeFloat, NonNegativeInt
from pydantic.dataclasses import dataclass as settings_dataclass

from tsuiseki.datamodules.scenes.clip import Rays, Side, Span, people_in_view
from tsuiseki.datamodules.scenes.figures.library import SpriteLibrary
from tsuiseki.datamodules.scenes.figures.standing_sprites import Standing, dressed, pictured_things, tilt_of
from tsuiseki.datamodules.scenes.people.person import person_thing, random_person, random_pose
from tsuiseki.datamodules.scenes.render.composing import Thing, compose, darken, empty_picture
from tsuiseki.datamodules.scenes.render.degrade import automatic_exposure, by_night, degrade, random_degradation
from tsuiseki.datamodules.scenes.render.ground import Ground, draw_ground
from tsuiseki.datamodules.scenes.render.photographs import Photographs, random_facades
from tsuiseki.datamodules.scenes.render.shading import hard_sun, random_light
from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.datamodules.scenes.room_clip import ceiling_lens, looking_down
from tsuiseki.datamodules.scenes.things import street_things
from tsuiseki.datamodules.scenes.things.town import random_thing
from tsuiseki.tracking.bounds import SETTINGS, Share
from tsuiseki.tracking.cameras.camera_files import AnyCamera
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray, ImageArray

# Share of a silhouette that is in view of whoever is labelled, at least: anything at all.
LEAST_VISIBLE = 1e-9
# Cameras tried until one shows people in the wanted size.
CAMERAS = 300
# Share of the image that one piece of clutter may cover.
LARGEST = 0.12
# Things of a town in one picture of one.
TOWN = (2, 18)
# Photographed things in one picture with such.
THINGS = (0, 12)
# A hard sun's shadows have edges sharper by so much.
SHARPER = 0.35


BoxConvention: TypeAlias = Literal["silhouettes", "steady"]


@settings_dataclass(frozen=True, config=SETTINGS)
class TrainingSettings:
    """What random pictures look like.

    Attributes:
        size: width and height, pixels.
        people: (fewest, most) people that are tried.
        person_height: (least, greatest) height of a person, pixels.
        clutter: (fewest, most) things besides people.
        camera_height: (lowest, highest), metres.
        samples: rays along each side of a pixel.
        beside: share of the people who stand or walk close to another.
        night: chance of a picture by night.
        sun: chance of a hard sun, in [0, 1]: one side of everything is dark, and so are its sharp shadows.
        rendered: share of the people who are shown as sprites, where there is a library of them.
        photographs: where there are some: chance that one lies on the ground, and 0.3 times as large one that a whole
            view is one; and chance of walls that they cover.
        town: (fewest, most) things of a town: traffic lights, signs, bicycles and the like; where
            there may be any, walls with doors and shop windows too.
        things: (fewest, most) photographed things; above 0 it needs photographs.
        overhead: a fisheye camera looks straight down from ``camera_height``; nothing then goes by ``person_height``.
        boxes: ``silhouettes`` go round everybody, and swing with the legs; ``steady`` boxes of rendered people are as
            wide, and lie where, those of their whole walk are and do on average, as people label videos.
    """

    size: tuple[Side, Side] = (640, 480)
    people: Span[NonNegativeInt] = (3, 20)
    person_height: Span[NonNegativeFloat] = (20.0, 250.0)
    clutter: Span[NonNegativeInt] = (4, 22)
    camera_height: Span[NonNegativeFloat] = (1.8, 9.0)
    samples: Rays = 2
    beside: float = 0.3
    night: float = 0.0
    sun: Share = 0.0
    rendered: float = 0.9
    photographs: tuple[float, float] = (0.6, 0.5)
    town: Span[NonNegativeInt] = (0, 0)
    things: Span[NonNegativeInt] = (0, 0)
    overhead: bool = False
    boxes: BoxConvention = "silhouettes"


# An ordinary street, which the other scenes vary.
STREET = TrainingSettings()
# What a picture of each scene shows.
SCENES: Mapping[str, TrainingSettings] = {
    "street": STREET,
    # Few people among many things: what scores are calibrated on, as most of a real view is empty.
    "sparse": replace(
        STREET, people=(0, 2), clutter=(6, 26), person_height=(20.0, 200.0), night=0.1, photographs=(0.6, 0.8)
    ),
    # A few people among many things from 4 to 14 m above, up to nearly straight below.
    "aerial": replace(
        STREET, people=(0, 14), clutter=(6, 30), person_height=(13.0, 120.0), camera_height=(4.0, 14.0), night=0.05,
        photographs=(0.75, 0.2),
    ),
    # A few people who fill a good part of the picture, among many things, from about as high as their heads.
    "near": replace(STREET, people=(0, 9), clutter=(4, 16), camera_height=(1.0, 4.5), beside=0.5, night=0.15),
    # People all around below a fisheye camera, some of them right under it.
    "overhead": replace(
        STREET, people=(0, 14), clutter=(4, 24), camera_height=(2.3, 6.0), overhead=True, photographs=(0.0, 0.0),
        beside=0.4,
    ),
}  # fmt: skip
VARIED: tuple[tuple[float, dict[str, Any]], ...] = (
    (0.35, {}),
    (0.3, {"people": (25, 60), "person_height": (20.0, 170.0), "camera_height": (1.8, 8.0), "beside": 0.6}),
    (0.2, {"people": (8, 40), "person_height": (14.0, 80.0), "camera_height": (4.0, 15.0), "beside": 0.4}),
    (0.15, {"people": (0, 0), "clutter": (8, 30)}),
)
"""Shares and settings of a varied set: an ordinary street, a crowd, a view from afar, or no person at all."""


def settings_of_scene(scene: str, rng: np.random.Generator, size: tuple[int, int]) -> TrainingSettings:
    """What one picture of a ``scene`` shows: one of `SCENES`, or ``varied``, of which ``rng`` draws one of `VARIED`."""
    if scene == "varied":
        chosen = int(rng.choice(len(VARIED), p=[share for share, _ in VARIED]))
        return replace(STREET, size=size, night=0.2, **VARIED[chosen][1])
    settings = replace(SCENES[scene], size=size)
    return replace(settings, person_height=(80.0, 0.95 * size[1])) if scene == "near" else settings


def random_training_scene(
    rng: np.random.Generator, settings: TrainingSettings, sprites: SpriteLibrary | None = None,
    photographs: Photographs | None = None,
) -> tuple[ImageArray, FloatArray, FloatArray]:  # fmt: skip
    """One random picture with people.

    Args:
        rng: draws everything.
        settings: what it shows.
        sprites: rendered people; without them people are drawn.
        photographs: of places without people; without them all is drawn.

    Returns:
        The image ``(H, W, 3)`` uint8 RGB, the boxes ``(N, 4)`` in pixels of the whole silhouettes, hidden parts
        included, or as ``settings.boxes`` has them, clipped to the image, and the visibilities ``(N,)`` in (0, 1].

    Raises:
        RequestError: things are wanted, and there are no photographs of any.
    """
    camera, spots = _overhead(rng, settings) if settings.overhead else _camera_with_spots(rng, settings)
    spots = _beside(rng, spots, settings.beside)
    # Generators of their own: the rest of a picture depends neither on what is not drawn nor on the sun.
    of_people, of_photographs, of_town, of_things, of_sun = rng.spawn(5)
    light, sunny = random_light(rng), of_sun.random() < settings.sun
    light = hard_sun(of_sun) if sunny else light
    ground, sunlit = draw_ground(Ground(rng), camera, light)
    people = []
    for spot in spots:
        person = random_person(rng)
        people.append(person_thing(person, random_pose(rng, person), spot, float(rng.uniform(0, 2 * np.pi))))
        # Mostly a rendered person is shown in the place of the drawn one.
        if sprites is not None and of_people.random() < settings.rendered:
            sprite = dressed(of_people, sprites.near(of_people, tilt_of(camera, spot)))
            if sprite.pose is not None:
                # The drawn one, whose shadow is seen, does the same.
                facing = np.arctan2(*(spot - camera.position[:2])[::-1]) + sprite.heading
                people[-1] = person_thing(person, sprite.pose, spot, float(facing))
            people[-1] = Standing(sprite, spot, people[-1].solids, person.outfit)
    ground, view = _photographed(of_photographs, ground, camera, photographs, settings.photographs[0])
    static = _scenery((rng, of_photographs, of_town, of_things), settings, photographs, camera, spots, view is not None)
    picture = empty_picture(ground, settings.samples)
    softness = float(rng.uniform(0.5, 2.5)) * (SHARPER if sunny else 1.0)
    picture, _ = darken(picture, static + people, camera, light, sunlit, softness)
    # One pass: static things and people hide each other alike.
    picture, sightings = compose(picture, people + static, camera, light)
    sightings = sightings[: len(people)]
    # Without nights no number is drawn: pictures of earlier seeds stay as they were.
    night = settings.night and rng.random() < settings.night
    colour = by_night(picture.colour, rng) if night else picture.colour
    how = random_degradation(rng)
    image = degrade(colour, replace(how, exposure=how.exposure * automatic_exposure(colour)), rng)
    if settings.boxes == "steady":
        for k, thing in enumerate(people):
            # Those of rendered people have the sides of the whole walk.
            if (sighting := sightings[k]) is not None and isinstance(thing, Standing):
                left, right = thing.steady_sides(camera)
                sightings[k] = replace(sighting, box=np.array([left, sighting.box[1], right, sighting.box[3]]))
    truth, _ = people_in_view(sightings, settings.size, LEAST_VISIBLE, 0.0)
    return image, truth.boxes, truth.visibility


def _scenery(
    rngs: tuple[np.random.Generator, ...],
    settings: TrainingSettings,
    photographs: Photographs | None,
    camera: AnyCamera,
    spots: FloatArray,
    in_view: bool,
) -> list[Thing]:
    """What stands about people at ``spots`` ``(N, 2)``, less of it ``in_view`` of a whole photograph.

    ``rngs`` draw clutter, facades, things of towns, and photographed things.
    """
    rng, of_photographs, of_town, of_things = rngs
    farthest = float(np.linalg.norm(spots, axis=1).max(initial=0))
    reach, facades = max(farthest, 12.0), list[Thing]()
    if photographs is not None and not in_view and of_photographs.random() < settings.photographs[1]:
        facades = random_facades(of_photographs, photographs, int(of_photographs.integers(1, 7)), spots, reach)
    count = _count(rng, settings.clutter) // (4 if in_view else 1)
    static = street_things.clutter_around(rng, camera, count, spots, LARGEST)
    if not (in_view or settings.overhead):
        static += street_things.buildings_behind(rng, int(rng.integers(0, 3)), farthest)
    static += facades
    if settings.town[1]:
        count = _count(of_town, settings.town)
        static += street_things.clutter_around(of_town, camera, count, spots, LARGEST, random_thing)
        static += street_things.fronts_behind(of_town, 0 if in_view else int(of_town.integers(0, 4)), spots, reach)
    if settings.things[1]:
        if photographs is None or not photographs.paths["things"]:
            raise RequestError("training scenes: expected photographs of things, got none")
        count = _count(of_things, settings.things)
        static += pictured_things(of_things, photographs, camera, count, spots, LARGEST)
    return static


def _count(rng: np.random.Generator, bounds: tuple[int, int]) -> int:
    return int(rng.integers(bounds[0], bounds[1] + 1))


def _camera_with_spots(rng: np.random.Generator, settings: TrainingSettings) -> tuple[AnyCamera, FloatArray]:
    """A camera and ``(N, 2)`` places on the ground where a person has a wanted size in its image."""
    count = _count(rng, settings.people)
    for _ in range(CAMERAS):
        camera = street_things.random_camera(rng, *settings.size, settings.camera_height)
        feet = rng.uniform([-0.03, 0.05], [1.03, 1.2], (400, 2)) * settings.size
        spots = camera.ground(feet)[:, :2]
        apparent = street_things.apparent_heights(camera, spots)
        low, high = settings.person_height
        good = np.flatnonzero((apparent > low) & (apparent < high))
        if len(good) >= 40:
            break
    else:
        raise RequestError(
            f"expected a person_height that cameras {settings.camera_height} m over the ground can show, "
            f"got {settings.person_height} pixels; widen one of the two"
        )
    # Few people are as near as the image is large: draw sizes evenly on a logarithmic scale.
    heights = np.exp(rng.uniform(np.log(apparent[good].min()), np.log(apparent[good].max()), count))
    order = np.argsort(np.abs(np.log(apparent[good])[None] - np.log(heights)[:, None]), axis=1)
    return camera, spots[good[order[np.arange(count), rng.integers(0, 12, count)]]]


def _overhead(rng: np.random.Generator, settings: TrainingSettings) -> tuple[AnyCamera, FloatArray]:
    """A fisheye camera that looks down, and ``(N, 2)`` places about its foot, near ones as often as far ones."""
    count, up = _count(rng, settings.people), float(rng.uniform(*settings.camera_height))
    lens = ceiling_lens(None, *settings.size)
    turned = looking_down(float(rng.uniform(0, 2 * np.pi)), *rng.normal(0, 0.03, 2))
    camera = OmnidirectionalCamera(lens, turned, np.array([0.0, 0.0, up]))
    angle, away = rng.uniform(0, 2 * np.pi, count), up * np.exp(rng.uniform(np.log(0.1), np.log(3.0), count))
    return camera, away[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _beside(rng: np.random.Generator, spots: FloatArray, share: float) -> FloatArray:
    """``spots`` ``(N, 2)``, of which a ``share`` lie close to the one before."""
    beside = rng.random(len(spots)) < share
    beside[:1] = False
    angle = rng.uniform(0, 2 * np.pi, len(spots))
    step = rng.uniform(0.35, 1.0, len(spots))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray(np.where(beside[:, None], np.roll(spots, 1, axis=0) + step, spots))


def _photographed(
    rng: np.random.Generator, ground: Float32, camera: AnyCamera, photographs: Photographs | None, often: float
) -> tuple[Float32, Float32 | None]:
    """The picture without things, now and then with a photograph in it, and the view if it is one as a whole."""
    if photographs is None or (kind := rng.random()) >= 1.3 * often:
        return ground, None
    if kind < 0.3 * often:
        view = photographs.view(rng, camera.width, camera.height)
        return (ground, None) if view is None else (view, view)
    return photographs.covered(rng, ground, camera), None
