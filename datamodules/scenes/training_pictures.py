"""Independent random pictures of people with exact boxes, made on the fly to train detectors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tsuiseki.datamodules.scenes import likenesses
from tsuiseki.datamodules.scenes.clip import people_in_view
from tsuiseki.datamodules.scenes.figures.library import SpriteLibrary
from tsuiseki.datamodules.scenes.figures.standing_sprites import Standing, dressed, pictured_things, tilt_of
from tsuiseki.datamodules.scenes.people.person import person_thing, random_person, random_pose
from tsuiseki.datamodules.scenes.people.poses import FREE
from tsuiseki.datamodules.scenes.render.composing import Thing, compose, darken, empty_picture
from tsuiseki.datamodules.scenes.render.degrade import automatic_exposure, by_night, degrade, random_degradation
from tsuiseki.datamodules.scenes.render.ground import Ground, draw_ground
from tsuiseki.datamodules.scenes.render.photographs import Photographs, random_facades
from tsuiseki.datamodules.scenes.render.shading import hard_sun, random_light
from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.datamodules.scenes.render.weather import rained_on, recorded
from tsuiseki.datamodules.scenes.things import foliage, street_things
from tsuiseki.datamodules.scenes.things.town import random_thing
from tsuiseki.datamodules.scenes.training_places import count_between, in_queues, places
from tsuiseki.datamodules.scenes.training_settings import TrainingSettings
from tsuiseki.tracking.cameras.camera_files import AnyCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray, ImageArray

# Share of a silhouette that is in view of whoever is labelled, at least: anything at all.
LEAST_VISIBLE = 1e-9
# Share of the image that one piece of clutter may cover.
LARGEST = 0.12
# A hard sun's shadows have edges sharper by so much.
SHARPER = 0.35
# Share of the leafy pictures in which a branch hangs before the camera.
BRANCHES = 0.4
# Share of the people who sit that have a chair.
CHAIRS = 0.8


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
    camera, spots = places(rng, settings)
    # Generators of their own: the rest of a picture depends neither on what is not drawn nor on the sun.
    of_people, of_photographs, of_town, of_things, of_sun, of_queues, of_props, of_leaves, of_weather = rng.spawn(9)
    spots = in_queues(of_queues, spots, camera, settings.behind)
    light, sunny = random_light(rng), of_sun.random() < settings.sun
    light = hard_sun(of_sun) if sunny else light
    ground, sunlit = draw_ground(Ground(rng), camera, light)
    people = _people((rng, of_people), settings, camera, spots, sprites)
    ground, view = _photographed(of_photographs, ground, camera, photographs, settings.photographs[0])
    static = _scenery((rng, of_photographs, of_town, of_things), settings, photographs, camera, spots, view is not None)
    static += _props(of_props, settings, camera, people, sprites)
    leafy = of_leaves.random() < settings.leaves
    if leafy:
        ground = foliage.fallen_leaves(of_leaves, ground, camera)
        static += foliage.heaps(of_leaves, camera, int(of_leaves.integers(0, 6)), spots)
    picture = empty_picture(ground, settings.samples)
    softness = float(rng.uniform(0.5, 2.5)) * (SHARPER if sunny else 1.0)
    picture, _ = darken(picture, static + people, camera, light, sunlit, softness)
    if leafy and of_leaves.random() < BRANCHES:
        static.append(foliage.random_branch(of_leaves, camera))
    # One pass: static things and people hide each other alike.
    picture, sightings = compose(picture, people + static, camera, light)
    sightings = sightings[: len(people)]
    # Without nights no number is drawn: pictures of earlier seeds stay as they were.
    night = settings.night and rng.random() < settings.night
    colour = by_night(picture.colour, rng) if night else picture.colour
    how = random_degradation(rng)
    image = degrade(colour, replace(how, exposure=how.exposure * automatic_exposure(colour)), rng)
    if of_weather.random() < settings.rain:
        image = rained_on(image, of_weather)
    if of_weather.random() < settings.recorded:
        image = recorded(image, of_weather)
    if settings.boxes == "steady":
        for k, thing in enumerate(people):
            # Those of rendered people have the sides of the whole walk.
            if (sighting := sightings[k]) is not None and isinstance(thing, Standing):
                left, right = thing.steady_sides(camera)
                sightings[k] = replace(sighting, box=np.array([left, sighting.box[1], right, sighting.box[3]]))
    truth, _ = people_in_view(sightings, settings.size, LEAST_VISIBLE, 0.0)
    return image, truth.boxes, truth.visibility


def _people(
    rngs: tuple[np.random.Generator, np.random.Generator],
    settings: TrainingSettings,
    camera: AnyCamera,
    spots: FloatArray,
    sprites: SpriteLibrary | None,
) -> list[Thing]:
    """Somebody at each of the ``spots`` ``(N, 2)``; ``rngs`` draw drawn people, and rendered ones in their places."""
    rng, of_people = rngs
    people = list[Thing]()
    for spot in spots:
        person = random_person(rng)
        people.append(person_thing(person, random_pose(rng, person), spot, float(rng.uniform(0, 2 * np.pi))))
        # Mostly a rendered person is shown in the place of the drawn one.
        if sprites is not None and of_people.random() < settings.rendered:
            pose = None
            if settings.posed is not None:
                pose = str(of_people.choice(FREE)) if of_people.random() < settings.posed else ""
            sprite = dressed(of_people, sprites.near(of_people, tilt_of(camera, spot), pose))
            if sprite.pose is not None:
                # The drawn one, whose shadow is seen, does the same.
                facing = np.arctan2(*(spot - camera.position[:2])[::-1]) + sprite.heading
                people[-1] = person_thing(person, sprite.pose, spot, float(facing))
            people[-1] = Standing(sprite, spot, people[-1].solids, person.outfit)
    return people


def _props(
    rng: np.random.Generator,
    settings: TrainingSettings,
    camera: AnyCamera,
    people: list[Thing],
    sprites: SpriteLibrary | None,
) -> list[Thing]:
    """Chairs under most of the rendered ``people`` who sit, screens before some, likenesses of people about them."""
    shown = [person for person in people if isinstance(person, Standing)]
    props = list[Thing]()
    if settings.posed is not None:
        seated = [person for person in shown if person.sprite.drawn.startswith("sitting")]
        props += [
            likenesses.chair_under(rng, p.spot, camera, p.sprite.heading) for p in seated if rng.random() < CHAIRS
        ]
    if settings.screened:
        behind = [person for person in shown if rng.random() < settings.screened]
        props += [likenesses.screen_before(rng, person.spot, camera) for person in behind]
    if settings.likenesses[1]:
        count = count_between(rng, settings.likenesses)
        spots = np.array([person.spot for person in shown]).reshape(-1, 2)
        props += likenesses.likenesses(rng, camera, count, spots, sprites)
    return props


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
    count = count_between(rng, settings.clutter) // (4 if in_view else 1)
    static = street_things.clutter_around(rng, camera, count, spots, LARGEST)
    if not (in_view or settings.overhead):
        static += street_things.buildings_behind(rng, int(rng.integers(0, 3)), farthest)
    static += facades
    if settings.town[1]:
        count = count_between(of_town, settings.town)
        static += street_things.clutter_around(of_town, camera, count, spots, LARGEST, random_thing)
        static += street_things.fronts_behind(of_town, 0 if in_view else int(of_town.integers(0, 4)), spots, reach)
    if settings.things[1]:
        if photographs is None or not photographs.paths["things"]:
            raise RequestError("training scenes: expected photographs of things, got none")
        count = count_between(of_things, settings.things)
        static += pictured_things(of_things, photographs, camera, count, spots, LARGEST)
    return static


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
