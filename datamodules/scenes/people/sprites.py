"""Single people without a scene: sprites to compose onto photographs, and crops of identities."""

from __future__ import annotations

import math

import numpy as np

from tsuiseki.datamodules.scenes.people.body import Pose
from tsuiseki.datamodules.scenes.people.gait import standing, walking
from tsuiseki.datamodules.scenes.people.person import Person, person_solids, random_person
from tsuiseki.datamodules.scenes.render.raster import Layer, trace
from tsuiseki.datamodules.scenes.render.shading import Light, random_light, shade
from tsuiseki.datamodules.scenes.render.solids import Float32, Solids
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import ImageArray


def random_pose(rng: np.random.Generator, person: Person) -> Pose:
    """Mostly somewhere in a walk, now and then standing."""
    if rng.random() < 0.2:
        return standing(rng, person.manner)
    return walking(person.build, person.manner, float(rng.random()), float(rng.uniform(0.5, 1.8)))


def view_from(tilt: float, height_px: float, person_height: float, distance: float) -> PinholeCamera:
    """A camera that looks ``tilt`` radians down on a person at the origin, about ``height_px`` tall in its image."""
    size = math.ceil(2.2 * height_px)
    apparent = person_height * math.cos(tilt) + 0.45 * math.sin(tilt)
    middle = np.array([0.0, 0.0, 0.5 * person_height])
    position = middle + distance * np.array([-math.cos(tilt), 0.0, math.sin(tilt)])
    return PinholeCamera.look_at(position, middle, height_px * distance / apparent, size, size)


def draw_alone(
    layer: Layer, solids: Solids, camera: PinholeCamera, samples: int, light: Light, person: Person
) -> Float32:
    """``(h, w, 4)`` linear colour times coverage and coverage of a layer, by pixels, tight about it."""
    mask = layer.mask
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    x1, y1 = (columns[0] + layer.left) // samples, (rows[0] + layer.top) // samples
    x2, y2 = (columns[-1] + layer.left) // samples + 1, (rows[-1] + layer.top) // samples + 1
    fine = np.zeros(((y2 - y1) * samples, (x2 - x1) * samples, 4), dtype=np.float32)
    at = np.nonzero(mask)
    colours = shade(layer, mask, solids, camera, samples, light, person.look)
    y, x = at[0] + layer.top - y1 * samples, at[1] + layer.left - x1 * samples
    fine[y, x, :3] = colours
    fine[y, x, 3] = 1
    return np.asarray(fine.reshape(y2 - y1, samples, x2 - x1, samples, 4).mean(axis=(1, 3)))


def render_person_sprite(
    rng: np.random.Generator,
    height_px: float,
    tilt: float | None = None,
    person: Person | None = None,
    pose: Pose | None = None,
    heading: float | None = None,
    light: Light | None = None,
) -> ImageArray:
    """One person cut out: ``(h, w, 4)`` uint8 RGBA, h about ``height_px``, straight alpha with soft edges.

    Args:
        rng: draws all that is not given.
        height_px: of the person in the sprite, roughly (a stride and the view change it).
        tilt: how far the camera looks down, radians in [0, 1.4]; by default drawn from [0, 1.05].
        person: who.
        pose: how.
        heading: which way, radians; 0 is away from the camera.
        light: under which light.

    Raises:
        ValueError: the height or the tilt is out of range.
    """
    if not 4 <= height_px <= 2000:
        raise ValueError(f"expected a height of 4 to 2000 pixels, got {height_px}")
    tilt = float(rng.uniform(0.0, 1.05)) if tilt is None else tilt
    if not 0 <= tilt <= 1.4:
        raise ValueError(f"expected a tilt of 0 to 1.4 radians, got {tilt}")
    person = random_person(rng) if person is None else person
    pose = random_pose(rng, person) if pose is None else pose
    heading = float(rng.uniform(0, 2 * math.pi)) if heading is None else heading
    light = random_light(rng) if light is None else light
    camera = view_from(tilt, height_px, person.build.height, float(rng.uniform(5, 30)))
    samples = int(np.clip(round(170 / height_px), 2, 5))
    solids = person_solids(person, pose, np.zeros(2), heading)
    layer = trace(solids, camera, samples)
    assert layer is not None  # the camera looks at the person
    drawn = draw_alone(layer, solids, camera, samples, light, person)
    alpha = drawn[..., 3:]
    colour = np.sqrt(np.clip(drawn[..., :3] / np.maximum(alpha, 1e-6), 0, 1))
    return np.asarray(np.concatenate([colour, alpha], axis=-1) * 255 + 0.5).astype(np.uint8)
