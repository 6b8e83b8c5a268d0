"""What random training pictures show: their settings, and the scenes that name some."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np
from pydantic import NonNegativeFloat, NonNegativeInt
from pydantic.dataclasses import dataclass as settings_dataclass

from tsuiseki.datamodules.scenes.clip import Rays, Side, Span
from tsuiseki.tracking.bounds import SETTINGS, Share

# Things of a town in one picture of one.
TOWN = (2, 18)
# Photographed things in one picture with such.
THINGS = (0, 12)

BoxConvention: TypeAlias = Literal["silhouettes", "steady"]


@settings_dataclass(frozen=True, config=SETTINGS, kw_only=True)
class Variety:
    """What sets a picture apart from one of people who walk along a plain street.

    Attributes:
        behind: share of the people who stand behind another one as the camera sees them, mostly hidden to a quarter or
            three quarters.
        screened: share of the people before whom something low or narrow stands.
        posed: share of the rendered people who sit, lie, fall, crouch, kneel or bend; None takes the library's.
        likenesses: (fewest, most) statues, dolls, posters and pictograms of people, which are nobody; statues and
            posters need a library of rendered people.
        leaves: chance of fallen leaves, heaps of them, hedges, and branches before the camera.
        rain: chance of rain.
        recorded: chance of a cheap recorder: few pixels, strong compression, interlaced rows, infrared, a clock.
    """

    behind: Share = 0.0
    screened: Share = 0.0
    posed: Share | None = None
    likenesses: Span[NonNegativeInt] = (0, 0)
    leaves: Share = 0.0
    rain: Share = 0.0
    recorded: Share = 0.0


@settings_dataclass(frozen=True, config=SETTINGS)
class TrainingSettings(Variety):
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
# What any day brings: `EVERYDAY` varies it.
_ANY_DAY = replace(
    STREET, night=0.15, posed=0.12, town=(0, 10), likenesses=(0, 1), leaves=0.12, rain=0.1, recorded=0.25
)
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
    # People who hide each other, from a face over a shoulder to a shoulder behind a back.
    "crowded": replace(
        _ANY_DAY, people=(12, 40), clutter=(2, 12), camera_height=(1.6, 7.0), beside=0.3, behind=0.6, screened=0.15,
    ),
    # A few people, most of whom sit, lie, fall, crouch, kneel or bend.
    "posed": replace(
        _ANY_DAY, people=(1, 9), person_height=(40.0, 420.0), camera_height=(1.2, 7.0), beside=0.2, screened=0.15,
        posed=0.75,
    ),
    # Nobody, among whatever has been taken for people.
    "lifeless": replace(
        _ANY_DAY, people=(0, 0), clutter=(4, 24), camera_height=(1.2, 8.0), town=(2, 16), likenesses=(0, 7), leaves=0.5,
    ),
}  # fmt: skip
# A street by day or by night, which `VARIED` varies.
_ANY_HOUR = replace(STREET, night=0.2)
VARIED: tuple[tuple[float, TrainingSettings], ...] = (
    (0.35, _ANY_HOUR),
    (0.3, replace(_ANY_HOUR, people=(25, 60), person_height=(20.0, 170.0), camera_height=(1.8, 8.0), beside=0.6)),
    (0.2, replace(_ANY_HOUR, people=(8, 40), person_height=(14.0, 80.0), camera_height=(4.0, 15.0), beside=0.4)),
    (0.15, replace(_ANY_HOUR, people=(0, 0), clutter=(8, 30))),
)
"""Shares and settings of a varied set: an ordinary street, a crowd, a view from afar, or no person at all."""
EVERYDAY: tuple[tuple[float, TrainingSettings], ...] = (
    (0.22, _ANY_DAY),
    (0.28, SCENES["crowded"]),
    (0.22, SCENES["posed"]),
    (0.12, replace(_ANY_DAY, people=(8, 40), person_height=(14.0, 80.0), camera_height=(4.0, 15.0), behind=0.3)),
    (0.16, SCENES["lifeless"]),
)
"""Shares and settings of an everyday set: a street, a crowd, people in any pose, a view from afar, or nobody."""
# Scenes whose pictures each show one of several.
_DRAWN = {"varied": VARIED, "everyday": EVERYDAY}


def settings_of_scene(scene: str, rng: np.random.Generator, size: tuple[int, int]) -> TrainingSettings:
    """What one picture of a ``scene`` shows: one of `SCENES`, or what ``rng`` draws.

    Of ``varied`` it draws one of `VARIED`, of ``everyday`` one of `EVERYDAY`.
    """
    if scene in _DRAWN:
        rows = _DRAWN[scene]
        return replace(rows[int(rng.choice(len(rows), p=[share for share, _ in rows]))][1], size=size)
    settings = replace(SCENES[scene], size=size)
    return replace(settings, person_height=(80.0, 0.95 * size[1])) if scene == "near" else settings
