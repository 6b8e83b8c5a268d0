"""Animals that enter, leave and touch, on drawn films: OMP_NUM_THREADS=1 python -m benchmarks.bodies.animals [FILMS].

In each film of 100 frames two animals of unlike sizes walk about for all of it, one walks in over the border and one
out. Printed are the frames by which an entry or an exit is reported late or early, counted from the moment when half of
the animal is in the image, the errors of the place once it is wholly in, and exchanged identities.

Then one of four animals is larger than the others, or a film begins in the middle of a contact: printed are the films
with as many tracks as animals.

Then two animals meet, of unlike or the same size: they cross, touch and part, or rest side by side for 40 frames and
part (`benchmarks/bodies/contacts.py`).
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from benchmarks.bodies.contacts import MEETINGS, Contact, compared, meeting
from benchmarks.machine import machine
from tsuiseki.tracking.animals.run import track_animals
from tsuiseki.tracking.types import FloatArray, ImageArray

WIDTH, HEIGHT, FRAMES = 320, 240, 100
LANE, USUAL, LARGE = 60.0, 34.0, (44.0, 50.0, 56.0)
SIZES = {"unlike": (40.0, 30.0), "the same": (34.0, 34.0)}
"""Lengths of two that meet, pixels."""
NOISE, FOUND = 3.0, 12.0
"""Of the camera, grey levels; a track is on an animal within so many pixels."""


def main() -> None:
    """Print a table over all films."""
    films = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    print(machine())
    entering_and_leaving(films)
    beginnings(films)
    meetings(films)


def meetings(films: int) -> None:
    """Print what becomes of two identities in a contact."""
    print("| two animals | sizes | both kept | exchanged | one lost | error of the place in contact, px: mean |")
    print("|---|---|---|---|---|---|")
    for kind in MEETINGS:
        for likeness, sizes in SIZES.items():
            contacts: list[Contact] = []
            for seed in range(films):
                rng = np.random.default_rng((seed, 7))
                paths, bodies = meeting(kind, sizes, FRAMES, rng)
                contacts.append(compared(followed(paths, bodies, rng), paths, bodies))
            count = [sum(one.outcome == name for one in contacts) for name in ("kept", "exchanged", "lost")]
            away = np.concatenate([one.away for one in contacts])
            print(f"| {kind} | {likeness} | {count[0]} | {count[1]} | {count[2]} | {away.mean():.1f} |", flush=True)


def beginnings(films: int) -> None:
    """Print whether a large animal is one from the first frame on, and two in contact are two."""
    right: dict[str, list[bool]] = {}
    for seed in range(films):
        rng = np.random.default_rng((seed, 11))
        for length in LARGE:
            paths, sizes = walks(rng)
            # Four that stay, in lanes of their own: the two of this film that do, and those of another.
            paths = np.concatenate([paths[:, :2], walks(rng)[0][:, :2] + [0.0, 2 * LANE, 0.0]], axis=1)
            sizes = np.array([length, USUAL, USUAL, USUAL])[:, None] * [1.0, 0.4]
            name = f"one is {(length / USUAL) ** 2:.1f} times as large as the other three"
            right.setdefault(name, []).append(len(followed(paths[:60], sizes, rng)) == 4)
        for kind in MEETINGS:
            for likeness, lengths in SIZES.items():
                paths, sizes = meeting(kind, lengths, FRAMES, rng)
                name = f"begins in contact: {kind}, {likeness}"
                right.setdefault(name, []).append(len(followed(paths[FRAMES // 2 :], sizes, rng)) == 2)
    print(f"| film | as many tracks as animals, of {films} |")
    print("|---|---|")
    for name, films_right in right.items():
        print(f"| {name} | {sum(films_right)} |", flush=True)


def followed(paths: FloatArray, sizes: FloatArray, rng: np.random.Generator) -> FloatArray:
    """``(K, T, 2)`` places of each track in the film of ``(T, N, 3)`` poses; NaN where there is none."""
    with tempfile.TemporaryDirectory() as folder:
        arena = background(rng)
        for frame, poses in enumerate(paths):
            cv2.imwrite(f"{folder}/{frame + 1:06d}.png", drawn(arena, poses, sizes, rng))
        tracks = track_animals(Path(folder))
    places = np.full((len(tracks), len(paths), 2), np.nan)
    for row, track in enumerate(tracks):
        places[row, track.frames] = track.states[:, :2]
    return places


def entering_and_leaving(films: int) -> None:
    """Print how late entries and exits are reported."""
    late: dict[str, list[float]] = {"enters": [], "leaves": []}
    away: dict[str, list[float]] = {"stays": [], "enters": [], "leaves": []}
    exchanged, missed, extra = 0, 0, 0
    for seed in range(films):
        rng = np.random.default_rng(seed)
        paths, sizes = walks(rng)
        places = followed(paths, sizes, rng)
        used = set()
        for animal, kind in enumerate(("stays", "stays", "enters", "leaves")):
            path, length = paths[:, animal, :2], sizes[animal, 0]
            inside = ((path > 0) & (path < [WIDTH, HEIGHT])).all(axis=1)
            whole = ((path > 0.6 * length) & (path < np.array([WIDTH, HEIGHT]) - 0.6 * length)).all(axis=1)
            gaps = np.linalg.norm(places - path, axis=2)
            gaps[~np.isfinite(gaps)] = np.inf
            best = gaps.argmin(axis=0)
            near = gaps.min(axis=0) < FOUND
            own = best[whole & near]
            missed += int((whole & ~near).sum())
            exchanged += int((np.diff(own) != 0).sum())
            away[kind] += gaps.min(axis=0)[whole & near].tolist()
            if not len(own):
                continue
            main_track = int(np.bincount(own).argmax())
            used.add(main_track)
            shown = np.flatnonzero(np.isfinite(places[main_track, :, 0]))
            if kind == "enters":
                late[kind].append(float(shown[0] - np.flatnonzero(inside)[0]))
            if kind == "leaves":
                late[kind].append(float(shown[-1] - np.flatnonzero(inside)[-1]))
        extra += len(places) - len(used)
    print(f"{films} films of {FRAMES} frames, two that stay, one that enters, one that leaves")
    print("| | entry or exit reported, frames late: median (least to greatest) | error of the place, px: mean · 95 % |")
    print("|---|---|---|")
    for kind, errors in away.items():
        when = late.get(kind)
        shown_late = f"{np.median(when):+.0f} ({min(when):+.0f} to {max(when):+.0f})" if when else ""
        print(f"| {kind} | {shown_late} | {np.mean(errors):.2f} · {np.quantile(errors, 0.95):.2f} |")
    print(f"exchanged identities {exchanged}, frames missed {missed}, tracks of nothing {extra}")


def walks(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """``(T, 4, 3)`` x, y, heading of the animals, in lanes of their own, and ``(4, 2)`` their lengths and widths."""
    sizes = np.array([40.0, 28.0, 34.0, 34.0])[:, None] * rng.uniform(0.9, 1.1, (4, 1)) * [1.0, 0.4]
    time = np.arange(FRAMES) / (FRAMES - 1)
    ends = np.array([[60.0, 250.0], [260.0, 50.0], [-40.0, 240.0], [90.0, WIDTH + 40.0]])
    ends += rng.uniform(-10, 10, ends.shape) * [[1], [1], [0], [0]]
    paths = np.empty((FRAMES, 4, 3))
    for animal, (first, last) in enumerate(ends):
        paths[:, animal, 0] = first + (last - first) * time
        lane, swing = LANE / 2 + LANE * animal, rng.uniform(0, 2 * np.pi)
        paths[:, animal, 1] = lane + 8.0 * np.sin(swing + 2 * np.pi * time)
    step = np.gradient(paths[..., :2], axis=0)
    paths[..., 2] = np.arctan2(step[..., 1], step[..., 0])
    return paths, sizes


def background(rng: np.random.Generator) -> ImageArray:
    """An arena with stains."""
    stains = cv2.resize(rng.standard_normal((12, 16)).astype(np.float32), (WIDTH, HEIGHT))
    return np.repeat(np.clip(50 + 5 * stains, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def drawn(arena: ImageArray, poses: FloatArray, sizes: FloatArray, rng: np.random.Generator) -> ImageArray:
    """The arena with ellipses whose front halves are brighter."""
    image, scale = arena.copy(), 2**4
    for (x, y, heading), (length, width) in zip(poses, sizes, strict=True):
        along = np.array([np.cos(heading), np.sin(heading)])
        for part, share, value in ((0.0, 1.0, 140), (0.15, 0.7, 200)):
            centre = np.round((np.array([x, y]) + part * length * along) * scale).astype(int).tolist()
            axes = (round(share * length / 2 * scale), round(width / 2 * scale))
            cv2.ellipse(image, centre, axes, float(np.degrees(heading)), 0, 360, (value,) * 3, -1, cv2.LINE_AA, 4)
    return np.clip(image + rng.normal(0, NOISE, image.shape), 0, 255).astype(np.uint8)


if __name__ == "__main__":
    main()
