"""How whoever labels a picture draws the boxes of people."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from tsuiseki.datamodules.scenes.figures.standing import Standing
from tsuiseki.datamodules.scenes.render.scene import Sighting, Thing
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import FloatArray

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
