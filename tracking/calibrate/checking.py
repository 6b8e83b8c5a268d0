"""Given cameras beside those that people give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.calibrate.people import WRONG, PeopleCalibration
from tsuiseki.tracking.cameras.camera_files import CameraOverFloor, read_cameras
from tsuiseki.tracking.cameras.people_views import OFFSET, feet, picture
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray


@dataclass(frozen=True)
class Disagreement:
    """What the people say about a camera that was given.

    Attributes:
        name: of the camera.
        error: median metres between where it puts people and where they are.
        height: metres that people are high by it, in the median.
        offset: seconds by which its clock is wrong.
        wrong: whether it contradicts them.
    """

    name: str
    error: float
    height: float
    offset: float
    wrong: bool

    def __str__(self) -> str:
        told = f"{self.error:.2f} m from the people, {self.height:.2f} m high by it, clock off by {self.offset:.3f} s"
        return f"{self.name}: {'disagrees with the people: ' if self.wrong else 'agrees: '}{told}"


def check_cameras(given: Sequence[CameraOverFloor] | Path, found: PeopleCalibration) -> list[Disagreement]:
    """Compare cameras with those that people give.

    Their floor is laid on the one of the people by the turn and shift that most cameras agree with.

    Args:
        given: cameras in the order of the sources, or their file.
        found: from the same sources.

    Raises:
        RequestError: there is another number of cameras, or a camera sees none of its people on the floor.
    """
    cameras = read_cameras(given) if isinstance(given, Path) else given
    if len(cameras) != len(found.views):
        raise RequestError(f"`cameras`: expected {len(found.views)} cameras, one a source, got {len(cameras)}")
    pairs = [_both(one, found, k) for k, one in enumerate(cameras)]
    heights = np.array([_height_by(one, found, k) for k, one in enumerate(cameras)])
    away = []
    for theirs, ours in pairs:
        middle, centre = theirs.mean(), ours.mean()
        turn = np.exp(1j * np.angle(np.vdot(ours - centre, theirs - middle)))
        away.append([float(np.median(np.abs(turn * (b - centre) + middle - a))) for a, b in pairs])
    # Of equals, such as each of two cameras, the one by which people are as high as people are.
    unlike = np.abs(np.log(heights / found.people.height))
    best = int(np.argmin(np.minimum(away, 5 * WRONG).sum(axis=1) + 0.01 * unlike))
    late = np.array([one.offset for one in cameras]) - found.numbers[:, OFFSET]
    late -= late[best]
    frame = np.array([0.5 / view.frame_rate for view in found.views])
    limit = found.people.spread / found.people.height
    wrong = (np.array(away[best]) > WRONG) | (np.abs(late) > frame + 3 * found.deviations[:, OFFSET]) | (unlike > limit)
    return [Disagreement(one.name, *row) for one, row in zip(cameras, zip(
        away[best], heights.tolist(), late.tolist(), wrong.tolist(), strict=True), strict=True)]  # fmt: skip


def _both(one: CameraOverFloor, found: PeopleCalibration, k: int) -> tuple[FloatArray, FloatArray]:
    """Places of the same people by the given camera and by the found one, complex metres."""
    ours, view = found.places(k), found.views[k]
    if (one.camera.width, one.camera.height) != view.size:
        size = f"{one.camera.width}x{one.camera.height}"
        raise RequestError(f"{one.name}: expected pictures of {size} by `cameras`, got {view.size[0]}x{view.size[1]}")
    camera = found.numbers[k]
    foot = picture(camera, feet(camera, view.boxes, found.people.height), 0.0)
    theirs = one.camera.ground(foot)
    near = np.abs(ours - camera[7] - 1j * camera[8])
    good = np.isfinite(theirs).all(axis=1) & (near <= np.median(near))
    if not good.any():
        raise RequestError(f"{one.name}: expected people on the floor before the camera, found none; check its pose")
    return theirs[good, 0] + 1j * theirs[good, 1], ours[good]


def _height_by(one: CameraOverFloor, found: PeopleCalibration, k: int) -> float:
    """Median height of people by a given camera, metres."""
    view, person, camera = found.views[k], found.people.height, found.numbers[k]
    foot = picture(camera, feet(camera, view.boxes, person), 0.0)
    places = one.camera.ground(foot)
    top = one.camera.project(places + np.array([0, 0, person]))[0][:, 1]
    return float(person * np.nanmedian(view.heights / (view.boxes[:, 3] - top)))
