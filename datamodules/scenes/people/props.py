"""Things that people act with: a book, a phone, a bottle, a cart, a suitcase, a crate, a bench."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tsuiseki.datamodules.scenes.people.body import Skeleton
from tsuiseki.datamodules.scenes.people.look import BRIGHT, DARK, LIGHT, MIDDLE, Colour
from tsuiseki.datamodules.scenes.render.solids import STRIPES_ACROSS, Solids, Surfaces, boxes, cone_spheres, join
from tsuiseki.tracking.types import FloatArray

Kind = Literal["book", "phone", "bottle", "cart", "suitcase", "crate", "bench"]
SEAT_HEIGHT = 0.45
# Metres from a person's middle to the middle of what is pushed, pulled or carried before it.
CART_AHEAD, SUITCASE_BEHIND, CRATE_AHEAD = 0.95, 0.75, 0.42
HANDLE_HEIGHT, CRATE_HEIGHT = 1.0, 1.0


@dataclass(frozen=True)
class Prop:
    """One thing.

    Attributes:
        kind: what it is.
        colour: sRGB.
        second: another colour of it.
        size: relative to the usual.
    """

    kind: Kind
    colour: Colour
    second: Colour
    size: float = 1.0


def random_prop(rng: np.random.Generator, kind: Kind) -> Prop:
    """One of its kind."""
    palettes: dict[Kind, tuple[Colour, ...]] = {
        "book": LIGHT,
        "phone": DARK,
        "bottle": LIGHT + BRIGHT,
        "cart": LIGHT[:2] + BRIGHT[:4],
        "suitcase": DARK + BRIGHT,
        "crate": (*MIDDLE, (0.62, 0.47, 0.30), (0.70, 0.56, 0.38)),
        "bench": MIDDLE + DARK,
    }
    palette = palettes[kind]
    colour, second = (palette[int(rng.integers(len(palette)))] for _ in range(2))
    return Prop(kind, colour, second, float(rng.uniform(0.85, 1.2)))


def in_hand(prop: Prop, skeleton: Skeleton, hand: int) -> Solids:
    """A book, phone or bottle where the hands of ``skeleton`` hold it."""
    surfaces = Surfaces()
    if prop.kind == "book":
        palms = 0.5 * (skeleton.wrist + skeleton.fingers)
        middle = palms.mean(axis=0) + 0.05 * skeleton.trunk_axes[:, 0]
        yaw = float(np.arctan2(skeleton.trunk_axes[1, 0], skeleton.trunk_axes[0, 0]))
        surfaces.add(prop.colour, relief=0.05)
        surfaces.add(prop.second, relief=0.02)
        left = skeleton.trunk_axes[:, 1] * 0.13 * prop.size
        size = np.array([[0.16, 0.12, 0.02]] * 2) * prop.size
        return boxes(np.stack([middle + left, middle - left]), size, np.full(2, yaw), surfaces)
    palm = 0.5 * (skeleton.wrist[hand] + skeleton.fingers[hand])
    towards = skeleton.head - palm
    towards = towards / max(float(np.linalg.norm(towards)), 1e-9)
    if prop.kind == "phone":
        surfaces.add(prop.colour, relief=0.02)
        up = skeleton.head_axes[:, 2]
        return _round([(palm - 0.05 * up, palm + 0.06 * up, 0.035, 0.035)], surfaces)
    # A bottle stands in a low hand and tips towards the mouth in a raised one.
    raised = float(np.clip((palm[2] - skeleton.chest[2]) / 0.15 + 0.5, 0, 1))
    axis = (1 - raised) * np.array([0.0, 0.0, 1.0]) + raised * (towards + np.array([0, 0, -0.15]))
    axis = axis / np.linalg.norm(axis)
    surfaces.add(prop.colour, relief=0.05)
    surfaces.add(prop.second, relief=0.05)
    foot = palm - 0.12 * prop.size * axis
    neck = palm + 0.1 * prop.size * axis
    return _round([(foot, neck, 0.05, 0.045), (neck, neck + 0.06 * axis, 0.025, 0.02)], surfaces)


def standing_prop(prop: Prop, position: FloatArray, yaw: float, lift: float = 0.0) -> Solids:
    """A cart, suitcase, crate or bench with its middle at ``position`` ``(2,)``, turned by ``yaw``, ``lift`` m up."""
    makers = {"cart": _cart, "suitcase": _suitcase, "crate": _crate, "bench": _bench}
    base = np.array([position[0], position[1], lift])
    along = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    return makers[prop.kind](prop, base, along, yaw)


def _across(along: FloatArray) -> FloatArray:
    return np.array([-along[1], along[0], 0.0])


def _cart(prop: Prop, base: FloatArray, along: FloatArray, yaw: float) -> Solids:
    """A trolley: a tray with walls on wheels and a handle bar at its rear."""
    size, across, up = prop.size, _across(along), np.array([0.0, 0.0, 1.0])
    surfaces = Surfaces()
    half_length, half_width = 0.42 * size, 0.3 * size
    rows = [
        (base + 0.5 * up, [half_length, half_width, 0.03], prop.colour),
        (base + 0.62 * up + half_width * across, [half_length, 0.02, 0.14], prop.second),
        (base + 0.62 * up - half_width * across, [half_length, 0.02, 0.14], prop.second),
        (base + 0.62 * up + half_length * along, [0.02, half_width, 0.14], prop.second),
    ]
    for _, _, colour in rows:
        surfaces.add(colour, relief=0.05)
    tray = boxes(np.array([r[0] for r in rows]), np.array([r[1] for r in rows]), np.full(4, yaw), surfaces)
    bars = Surfaces()
    handle = base - (CART_AHEAD - 0.5) * along + HANDLE_HEIGHT * up
    rear = base - half_length * along + 0.55 * up
    limbs = [(handle - 0.28 * across, handle + 0.28 * across, 0.022, 0.022)]
    limbs += [(rear + s * 0.26 * across, handle + s * 0.26 * across, 0.018, 0.018) for s in (-1, 1)]
    for s in (-1, 1):
        for t in (-1, 1):
            hub = base + s * 0.8 * half_length * along + t * 0.85 * half_width * across + 0.1 * up
            limbs.append((hub, hub + 0.35 * up, 0.08, 0.02))
    for _ in limbs:
        bars.add((0.15, 0.15, 0.16), relief=0.04)
    return join([tray, _round(limbs, bars)])


def _suitcase(prop: Prop, base: FloatArray, along: FloatArray, yaw: float) -> Solids:
    """A suitcase on wheels with its handle drawn out forward."""
    size, up = prop.size, np.array([0.0, 0.0, 1.0])
    surfaces = Surfaces()
    surfaces.add(prop.colour, prop.second, STRIPES_ACROSS, 0.12, 0.05)
    body = boxes((base + 0.36 * size * up)[None], np.array([[0.14, 0.23, 0.32]]) * size, np.array([yaw]), surfaces)
    bar = Surfaces()
    bar.add((0.2, 0.2, 0.2), relief=0.03)
    grip = base + (SUITCASE_BEHIND - 0.35) * along + 0.78 * up
    return join([body, _round([(base + 0.65 * size * up, grip, 0.02, 0.02)], bar)])


def _crate(prop: Prop, base: FloatArray, along: FloatArray, yaw: float) -> Solids:
    """A cardboard box with tape over its top."""
    del along
    half = np.array([0.2, 0.27, 0.17]) * prop.size
    surfaces = Surfaces()
    surfaces.add(prop.colour, relief=0.06)
    surfaces.add(prop.second, relief=0.03)
    centres = np.stack([base, base + np.array([0, 0, half[2]])])
    centres[:, 2] += half[2]
    return boxes(centres, np.stack([half, [half[0], 0.04, 0.006]]), np.full(2, yaw), surfaces)


def _bench(prop: Prop, base: FloatArray, along: FloatArray, yaw: float) -> Solids:
    """A seat that faces ``yaw``, its back and two feet."""
    across, up = _across(along), np.array([0.0, 0.0, 1.0])
    rows = [
        (base + (SEAT_HEIGHT - 0.06) * up, [0.25, 0.85, 0.03], prop.colour),
        (base + 0.65 * up - 0.27 * along, [0.03, 0.85, 0.2], prop.colour),
    ]
    rows += [(base + 0.18 * up + s * 0.7 * across, [0.22, 0.05, 0.18], prop.second) for s in (-1, 1)]
    surfaces = Surfaces()
    for _, _, colour in rows:
        surfaces.add(colour, relief=0.08)
    return boxes(np.array([r[0] for r in rows]), np.array([r[1] for r in rows]), np.full(4, yaw), surfaces)


def _round(rows: list[tuple[FloatArray, FloatArray, float, float]], surfaces: Surfaces) -> Solids:
    return cone_spheres(
        np.array([r[0] for r in rows]),
        np.array([r[1] for r in rows]),
        np.array([[r[2], r[3]] for r in rows]),
        np.tile([[1.0, 0.0, 0.0]], (len(rows), 1)),
        np.ones(len(rows)),
        surfaces,
    )
