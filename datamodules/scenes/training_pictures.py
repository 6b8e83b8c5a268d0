"""Independent random pictures of people with exact boxes, made on the fly to train detectors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, get_args

import numpy as np

from tsuiseki.datamodules.scenes.figures.library import SpriteLibrary
from tsuiseki.datamodules.scenes.figures.standing import Standing, dressed, pictured_things, tilt_of
from tsuiseki.datamodules.scenes.people.person import person_solids, random_person, random_pose
from tsuiseki.datamodules.scenes.render.degrade import automatic_exposure, by_night, degrade, random_degradation
from tsuiseki.datamodules.scenes.render.ground import draw_ground, random_ground
from tsuiseki.datamodules.scenes.render.motion_blur import smeared
from tsuiseki.datamodules.scenes.render.photographs import Photographs, random_facades
from tsuiseki.datamodules.scenes.render.scene import Sighting, Thing, compose, darken, empty_picture
from tsuiseki.datamodules.scenes.render.shading import hard_sun, random_light
from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.datamodules.scenes.things.clutter import (
    apparent_heights,
    buildings_behind,
    clutter_around,
    fronts_behind,
    random_camera,
)
from tsuiseki.datamodules.scenes.things.town import random_town_thing
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.geometry import clip_boxes
from tsuiseki.tracking.types import FloatArray, ImageArray

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


@dataclass(frozen=True)
class Stock:
    """What pictures can be made of beside drawn shapes.

    Attributes:
        sprites: rendered people.
        photographs: of places without people.
    """

    sprites: SpriteLibrary | None = None
    photographs: Photographs | None = None


NOTHING = Stock()


@dataclass(frozen=True)
class TrainingSettings:
    """What random pictures look like.

    Attributes:
        width: pixels.
        height: pixels.
        people: (fewest, most) people that are tried.
        person_height: (least, greatest) height of a person, pixels.
        clutter: (fewest, most) things that are nobody.
        camera_height: (lowest, highest), metres.
        degradation: strength of blur, noise and the like; 0 for none.
        samples: rays along each side of a pixel.
        beside: share of the people who stand or walk close to another.
        night: chance of a picture by night.
        sun: chance of a hard sun, in [0, 1]: one side of everything is dark, and so are its sharp shadows.
        rendered: share of the people who are shown as sprites, where there is a library of them.
        photographs: chance that a photograph lies on the ground, and 0.3 times as large one that a whole view is one,
            where there are photographs.
        facades: chance of walls that photographs cover, likewise.
        town: (fewest, most) things of a town that are nobody: traffic lights, signs, bicycles and the like; where
            there may be any, walls with doors and shop windows too.
        things: (fewest, most) photographed things that are nobody; where there may be any, there must be photographs.
        motion: chance that people, and perhaps the camera, move while the shutter is open, in [0, 1].
        boxes: how people are boxed, see `street.conventions.labelled`.
    """

    width: int = 640
    height: int = 480
    people: tuple[int, int] = (3, 20)
    person_height: tuple[float, float] = (20.0, 250.0)
    clutter: tuple[int, int] = (4, 22)
    camera_height: tuple[float, float] = (1.8, 9.0)
    degradation: float = 1.0
    samples: int = 2
    beside: float = 0.3
    night: float = 0.0
    sun: float = 0.0
    rendered: float = 0.9
    photographs: float = 0.6
    facades: float = 0.5
    town: tuple[int, int] = (0, 0)
    things: tuple[int, int] = (0, 0)
    motion: float = 0.0
    boxes: BoxConvention = "silhouettes"

    def __post_init__(self) -> None:
        for name in ("people", "person_height", "clutter", "camera_height", "town", "things"):
            low, high = getattr(self, name)
            if not 0 <= low <= high:
                raise RequestError(f"training scenes: expected {name} as (least, greatest) from 0, got {low}, {high}")
        if min(self.width, self.height) < 32 or not 1 <= self.samples <= 8 or self.degradation < 0:
            raise RequestError(
                "training scenes: expected at least 32x32 pixels, samples 1-8 and no negative degradation, "
                f"got {self.width}x{self.height}, {self.samples} and {self.degradation}"
            )
        for name in ("sun", "motion"):
            if not 0 <= getattr(self, name) <= 1:
                raise RequestError(f"training scenes: expected {name} as a chance in [0, 1], got {getattr(self, name)}")
        if self.boxes not in get_args(BoxConvention):
            named = ", ".join(get_args(BoxConvention))
            raise RequestError(f"training scenes: expected boxes as one of {named}, got {self.boxes!r}")


def varied_settings(rng: np.random.Generator, width: int, height: int) -> TrainingSettings:
    """What one picture of a varied set shows: an ordinary street, a crowd, a view from afar, or nobody at all."""
    night = 0.2
    kinds = (
        TrainingSettings(width, height, night=night),
        TrainingSettings(
            width,
            height,
            people=(25, 60),
            person_height=(20.0, 170.0),
            camera_height=(1.8, 8.0),
            beside=0.6,
            night=night,
        ),
        TrainingSettings(
            width,
            height,
            people=(8, 40),
            person_height=(14.0, 80.0),
            camera_height=(4.0, 15.0),
            beside=0.4,
            night=night,
        ),
        TrainingSettings(width, height, people=(0, 0), clutter=(8, 30), night=night),
    )
    return kinds[int(rng.choice(len(kinds), p=(0.35, 0.3, 0.2, 0.15)))]


def sparse_settings(width: int, height: int) -> TrainingSettings:
    """Few people among many things: what scores are calibrated on, as most of a real view shows nobody."""
    return TrainingSettings(
        width, height, people=(0, 2), clutter=(6, 26), person_height=(20.0, 200.0), night=0.1, facades=0.8
    )


def near_settings(width: int, height: int) -> TrainingSettings:
    """A few people who fill a good part of the picture, among many things, from about as high as their heads."""
    return TrainingSettings(
        width,
        height,
        people=(0, 9),
        person_height=(80.0, 0.95 * height),
        clutter=(4, 16),
        camera_height=(1.0, 4.5),
        beside=0.5,
        night=0.15,
    )


def aerial_settings(width: int, height: int) -> TrainingSettings:
    """A few people among many things from 4 to 14 m above, up to nearly straight below."""
    return TrainingSettings(
        width,
        height,
        people=(0, 14),
        person_height=(13.0, 120.0),
        clutter=(6, 30),
        camera_height=(4.0, 14.0),
        night=0.05,
        photographs=0.75,
        facades=0.2,
    )


def random_training_scene(
    rng: np.random.Generator, settings: TrainingSettings | None = None, stock: Stock = NOTHING
) -> tuple[ImageArray, FloatArray, FloatArray]:
    """One random picture with people.

    Args:
        rng: draws everything.
        settings: what it shows.
        stock: rendered people and photographs; without them people and ground are drawn.

    Returns:
        The image ``(H, W, 3)`` uint8 RGB, the boxes ``(N, 4)`` in pixels of the whole silhouettes, hidden parts
        included, or as ``settings.boxes`` has them, clipped to the image, and the visibilities ``(N,)`` in (0, 1].

    Raises:
        RequestError: things are wanted, and there are no photographs of any.
    """
    settings = TrainingSettings() if settings is None else settings
    camera, spots = _camera_with_spots(rng, settings)
    # Generators of their own: the rest of a picture depends neither on what there is in stock nor on sun or motion.
    of_people, of_photographs, of_town, of_things, of_sun, of_motion, of_boxes = rng.spawn(7)
    light, sunny = random_light(rng), of_sun.random() < settings.sun
    if sunny:
        light = hard_sun(of_sun)
    ground, sunlit = draw_ground(random_ground(rng), camera, light)
    people = _people(rng, spots)
    if stock.sprites is not None:
        people = [
            _rendered(of_people, thing, spot, camera, stock.sprites, settings)
            for thing, spot in zip(people, spots, strict=True)
        ]
    view, facades = None, []
    if stock.photographs is not None:
        ground, view = _photographed(of_photographs, ground, camera, stock.photographs, settings)
    reach = float(np.linalg.norm(spots, axis=1).max(initial=12.0))
    if stock.photographs is not None and view is None and of_photographs.random() < settings.facades:
        facades = random_facades(of_photographs, stock.photographs, int(of_photographs.integers(1, 7)), spots, reach)
    count = int(rng.integers(settings.clutter[0], settings.clutter[1] + 1)) // (1 if view is None else 4)
    static = clutter_around(rng, camera, count, spots, LARGEST)
    if view is None:
        static += buildings_behind(rng, int(rng.integers(0, 3)), float(np.linalg.norm(spots, axis=1).max(initial=0)))
    static += facades
    if settings.town[1]:
        count = int(of_town.integers(settings.town[0], settings.town[1] + 1))
        static += clutter_around(of_town, camera, count, spots, LARGEST, random_town_thing)
        static += fronts_behind(of_town, int(of_town.integers(0, 4)) if view is None else 0, spots, reach)
    if settings.things[1]:
        if stock.photographs is None or not stock.photographs.paths["things"]:
            raise RequestError("training scenes: expected photographs of things, got none")
        count = int(of_things.integers(settings.things[0], settings.things[1] + 1))
        static += pictured_things(of_things, stock.photographs, camera, count, spots, LARGEST)
    picture = empty_picture(ground, settings.samples)
    softness = float(rng.uniform(0.5, 2.5)) * (SHARPER if sunny else 1.0)
    picture, _ = darken(picture, static + people, camera, light, sunlit, softness)
    # One pass: static things and people hide each other alike.
    picture, sightings = compose(picture, people + static, camera, light)
    sightings = sightings[: len(people)]
    colour = smeared(of_motion, picture, sightings) if of_motion.random() < settings.motion else picture.colour
    # Without nights no number is drawn: pictures of earlier seeds stay as they were.
    colour = by_night(colour, rng) if settings.night and rng.random() < settings.night else colour
    how = random_degradation(rng, settings.degradation)
    image = degrade(colour, replace(how, exposure=how.exposure * automatic_exposure(colour)), rng)
    sightings = labelled(of_boxes, sightings, people, camera, settings.boxes)
    boxes, visibility = seen_boxes(sightings, settings.width, settings.height)
    return image, boxes, visibility


def seen_boxes(sightings: list[Sighting | None], width: int, height: int) -> tuple[FloatArray, FloatArray]:
    """Boxes ``(N, 4)`` clipped to the image and visibilities ``(N,)`` of those of which anything is seen.

    A box may lie outside although an arm is seen, unless it is the silhouette's; such people are left out.
    """
    seen = [s for s in sightings if s is not None and s.visibility > 0]
    boxes = clip_boxes(np.array([s.box for s in seen], dtype=np.float64).reshape(-1, 4), width, height)
    inside = (boxes[:, 2:] > boxes[:, :2]).all(axis=1)
    return boxes[inside], np.array([s.visibility for s in seen], dtype=np.float64)[inside]


def _camera_with_spots(rng: np.random.Generator, settings: TrainingSettings) -> tuple[PinholeCamera, FloatArray]:
    """A camera and ``(N, 2)`` places on the ground where a person has a wanted size in its image."""
    count = int(rng.integers(settings.people[0], settings.people[1] + 1))
    for _ in range(CAMERAS):
        camera = random_camera(rng, settings.width, settings.height, settings.camera_height)
        feet = rng.uniform([-0.03, 0.05], [1.03, 1.2], (400, 2)) * [settings.width, settings.height]
        spots = camera.ground(feet)[:, :2]
        apparent = apparent_heights(camera, spots)
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
    wanted = np.exp(rng.uniform(np.log(apparent[good].min()), np.log(apparent[good].max()), count))
    order = np.argsort(np.abs(np.log(apparent[good])[None] - np.log(wanted)[:, None]), axis=1)
    chosen = spots[good[order[np.arange(count), rng.integers(0, 12, count)]]]
    beside = rng.random(count) < settings.beside
    beside[:1] = False
    angle = rng.uniform(0, 2 * np.pi, count)
    step = rng.uniform(0.35, 1.0, count)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return camera, np.where(beside[:, None], np.roll(chosen, 1, axis=0) + step, chosen)


def _rendered(
    rng: np.random.Generator,
    thing: Thing,
    spot: FloatArray,
    camera: PinholeCamera,
    sprites: SpriteLibrary,
    settings: TrainingSettings,
) -> Thing:
    """Mostly the drawn person with a rendered one shown in his place."""
    if rng.random() >= settings.rendered:
        return thing
    return replace(thing, cutout=Standing(dressed(rng, sprites.near(rng, tilt_of(camera, spot))), spot))


def _photographed(
    rng: np.random.Generator,
    ground: Float32,
    camera: PinholeCamera,
    photographs: Photographs,
    settings: TrainingSettings,
) -> tuple[Float32, Float32 | None]:
    """The picture without things, now and then with a photograph in it, and the view if it is one as a whole."""
    kind = rng.random()
    if kind < 0.3 * settings.photographs:
        view = photographs.view(rng, camera.width, camera.height)
        return (ground, None) if view is None else (view, view)
    if kind < 1.3 * settings.photographs:
        ground = photographs.covered(rng, ground, camera)
    return ground, None


def _people(rng: np.random.Generator, spots: FloatArray) -> list[Thing]:
    things = []
    for spot in spots:
        person = random_person(rng)
        pose, heading = random_pose(rng, person), float(rng.uniform(0, 2 * np.pi))
        things.append(Thing(person_solids(person, pose, spot, heading), person.look))
    return things


BoxConvention: TypeAlias = Literal["silhouettes", "steady", "random"]
# Widths by the height of labels that all have one shape; Dollár et al., Pedestrian Detection, PAMI 2012, take 0.41.
_ASPECT = (0.34, 0.44)
# Most room that is left about somebody, by the height.
_ROOM = 0.05


def labelled(
    rng: np.random.Generator,
    sightings: list[Sighting | None],
    people: list[Thing],
    camera: PinholeCamera,
    convention: BoxConvention,
) -> list[Sighting | None]:
    """The ``sightings`` of ``people``, boxed as ``convention`` has it.

    ``silhouettes`` are as they are, and swing with the legs. ``steady`` boxes of rendered people are as wide, and lie
    where, those of their whole walk are and do on average, as people label videos. With ``random``, one labeller draws
    all boxes of the picture: round silhouettes, steady, or all of one shape about the body, each as likely, with more
    or less room left about everybody. Of drawn people silhouettes are their steady boxes.
    """
    if convention == "silhouettes":
        return sightings
    if convention == "steady":
        return [_steady(s, thing, camera) for s, thing in zip(sightings, people, strict=True)]
    kind, aspect, room = rng.integers(3), rng.uniform(*_ASPECT), rng.uniform(0, _ROOM)
    if kind:
        sightings = labelled(rng, sightings, people, camera, "steady")
    return [s and replace(s, box=_drawn(s.box, aspect if kind == 2 else None, room)) for s in sightings]


def _drawn(box: FloatArray, aspect: float | None, room: float) -> FloatArray:
    """``box`` of one shape about its middle, if an ``aspect`` is given, with ``room`` about it."""
    x1, y1, x2, y2 = box
    tall = y2 - y1
    if aspect is not None:
        x1, x2 = (x1 + x2 - aspect * tall) / 2, (x1 + x2 + aspect * tall) / 2
    return np.asarray(np.array([x1, y1, x2, y2]) + room * tall * np.array([-1, -1, 1, 1]))


def _steady(sighting: Sighting | None, thing: Thing, camera: PinholeCamera) -> Sighting | None:
    if sighting is None or not isinstance(thing.cutout, Standing):
        return sighting
    left, right = thing.cutout.steady_sides(camera)
    return replace(sighting, box=np.array([left, sighting.box[1], right, sighting.box[3]]))
