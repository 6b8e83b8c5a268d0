"""Things that people act with: a book, a phone, a bottle, a cart, a suitcase, a crate, a bench."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tsuiseki.datamodules.scenes.people.outfit import BRIGHT, DARK, LIGHT, MIDDLE
from tsuiseki.datamodules.scenes.people.posture import PersonSkeleton
from tsuiseki.datamodules.scenes.render.solids import UP, Colour, Parts, Pattern, Solids, Surface, across, along
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


def in_hand(prop: Prop, skeleton: PersonSkeleton, hand: int) -> Solids:
    """A book, phone or bottle where the hands of ``skeleton`` hold it."""
    parts = Parts()
    if prop.kind == "book":
        palms = 0.5 * (skeleton.wrist + skeleton.fingers)
        middle = palms.mean(axis=0) + 0.05 * skeleton.trunk_axes[:, 0]
        yaw = float(np.arctan2(skeleton.trunk_axes[1, 0], skeleton.trunk_axes[0, 0]))
        left = skeleton.trunk_axes[:, 1] * 0.13 * prop.size
        size = np.array([0.16, 0.12, 0.02]) * prop.size
        parts.box(middle + left, size, yaw, Surface(prop.colour, relief=0.05))
        parts.box(middle - left, size, yaw, Surface(prop.second, relief=0.02))
        return parts.solids()
    palm = 0.5 * (skeleton.wrist[hand] + skeleton.fingers[hand])
    towards = skeleton.head - palm
    towards = towards / max(float(np.linalg.norm(towards)), 1e-9)
    if prop.kind == "phone":
        up = skeleton.head_axes[:, 2]
        parts.cone(palm - 0.05 * up, palm + 0.06 * up, (0.035, 0.035), Surface(prop.colour, relief=0.02))
        return parts.solids()
    # A bottle stands in a low hand and tips towards the mouth in a raised one.
    raised = float(np.clip((palm[2] - skeleton.chest[2]) / 0.15 + 0.5, 0, 1))
    axis = (1 - raised) * np.array([0.0, 0.0, 1.0]) + raised * (towards + np.array([0, 0, -0.15]))
    axis = axis / np.linalg.norm(axis)
    foot = palm - 0.12 * prop.size * axis
    neck = palm + 0.1 * prop.size * axis
    parts.cone(foot, neck, (0.05, 0.045), Surface(prop.colour, relief=0.05))
    parts.cone(neck, neck + 0.06 * axis, (0.025, 0.02), Surface(prop.second, relief=0.05))
    return parts.solids()


def standing_prop(prop: Prop, position: FloatArray, yaw: float, lift: float = 0.0) -> Solids:
    """A cart, suitcase, crate or bench with its middle at ``position`` ``(2,)``, turned by ``yaw``, ``lift`` m up."""
    makers = {"cart": _cart, "suitcase": _suitcase, "crate": _crate, "bench": _bench}
    parts, base = Parts(), np.array([position[0], position[1], lift])
    makers[prop.kind](parts, prop, base, yaw)
    return parts.solids()


def _cart(parts: Parts, prop: Prop, base: FloatArray, yaw: float) -> None:
    """A trolley: a tray with walls on wheels and a handle bar at its rear."""
    size, ahead, aside = prop.size, along(yaw), across(yaw)
    half_length, half_width = 0.42 * size, 0.3 * size
    wall, steel = Surface(prop.second, relief=0.05), Surface((0.15, 0.15, 0.16), relief=0.04)
    parts.box(base + 0.5 * UP, [half_length, half_width, 0.03], yaw, Surface(prop.colour, relief=0.05))
    for s in (1, -1):
        parts.box(base + 0.62 * UP + s * half_width * aside, [half_length, 0.02, 0.14], yaw, wall)
    parts.box(base + 0.62 * UP + half_length * ahead, [0.02, half_width, 0.14], yaw, wall)
    handle = base - (CART_AHEAD - 0.5) * ahead + HANDLE_HEIGHT * UP
    rear = base - half_length * ahead + 0.55 * UP
    parts.cone(handle - 0.28 * aside, handle + 0.28 * aside, (0.022, 0.022), steel)
    for s in (-1, 1):
        parts.cone(rear + s * 0.26 * aside, handle + s * 0.26 * aside, (0.018, 0.018), steel)
    for s in (-1, 1):
        for t in (-1, 1):
            hub = base + s * 0.8 * half_length * ahead + t * 0.85 * half_width * aside + 0.1 * UP
            parts.cone(hub, hub + 0.35 * UP, (0.08, 0.02), steel)


def _suitcase(parts: Parts, prop: Prop, base: FloatArray, yaw: float) -> None:
    """A suitcase on wheels with its handle drawn out forward."""
    size = prop.size
    shell = Surface(prop.colour, prop.second, Pattern.ACROSS, 0.12, 0.05)
    parts.box(base + 0.36 * size * UP, np.array([0.14, 0.23, 0.32]) * size, yaw, shell)
    grip = base + (SUITCASE_BEHIND - 0.35) * along(yaw) + 0.78 * UP
    parts.cone(base + 0.65 * size * UP, grip, (0.02, 0.02), Surface((0.2, 0.2, 0.2), relief=0.03))


def _crate(parts: Parts, prop: Prop, base: FloatArray, yaw: float) -> None:
    """A cardboard box with tape over its top."""
    half = np.array([0.2, 0.27, 0.17]) * prop.size
    top = np.array([0, 0, half[2]])
    parts.box(base + top, half, yaw, Surface(prop.colour, relief=0.06))
    parts.box(base + top + top, [half[0], 0.04, 0.006], yaw, Surface(prop.second, relief=0.03))


def _bench(parts: Parts, prop: Prop, base: FloatArray, yaw: float) -> None:
    """A seat that faces ``yaw``, its back and two feet."""
    wood, feet = Surface(prop.colour, relief=0.08), Surface(prop.second, relief=0.08)
    parts.box(base + (SEAT_HEIGHT - 0.06) * UP, [0.25, 0.85, 0.03], yaw, wood)
    parts.box(base + 0.65 * UP - 0.27 * along(yaw), [0.03, 0.85, 0.2], yaw, wood)
    for s in (-1, 1):
        parts.box(base + 0.18 * UP + s * 0.7 * across(yaw), [0.22, 0.05, 0.18], yaw, feet)
