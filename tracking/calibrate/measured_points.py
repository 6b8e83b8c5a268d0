"""Several cameras from measured points, and what to tell of them.

Where a camera of known lens hangs over the floor: from its height and tilt, or from points of the floor.

For points of the floor (z = 0) with rays d in the camera's axes, ``d x (x r1 + y r2 + t) = 0`` is linear in the first
two columns of the rotation and the shift. Being written in rays it holds for lenses of any width; the reprojection
error in pixels is then made least by Levenberg-Marquardt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from tsuiseki.tracking.cameras.calibration import Calibration, calibrate_camera, locate_camera
from tsuiseki.tracking.cameras.intrinsic_files import read_intrinsics
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera
from tsuiseki.tracking.cameras.person_model import PersonModel, stand
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.world_tables import Correspondences, read_correspondences, read_floor_points
from tsuiseki.tracking.types import FloatArray

FEWEST_POINTS = 4
FLATNESS = 1e-3

Camera = TypeVar("Camera", bound=PinholeCamera | OmnidirectionalCamera)


@dataclass(frozen=True)
class PoseFit:
    """How well a pose explains its points.

    Attributes:
        residuals: ``(N,)`` distances between given and projected pixels.
        metres: ``(N,)`` distances on the floor between given points and those that the pixels show.
    """

    residuals: FloatArray
    metres: FloatArray


def pose_at(camera: Camera, height: float, tilt: float = 0.0, turn: float = 0.0) -> Camera:
    """``camera`` over the origin of the floor, looking down.

    Args:
        camera: of which the lens is kept.
        height: of the optical centre, metres, above 0.
        tilt: of the axis from straight down, towards +y of the floor, radians.
        turn: of the camera about its axis, radians; at 0 the image's right is +x and its top, without tilt, +y.

    Raises:
        RequestError: a height of 0 or less, or a tilt of a right angle or more.
    """
    if not (np.isfinite(height) and height > 0):
        raise RequestError(f"expected a camera height above 0 m, got {height:g}")
    if not abs(tilt) < np.pi / 2:
        raise RequestError(f"expected a tilt of less than 90 degrees from straight down, got {np.degrees(tilt):g}")
    down = np.diag([1.0, -1.0, -1.0])
    tilted = Rotation.from_rotvec([tilt, 0, 0]).as_matrix().T
    about = Rotation.from_rotvec([0, 0, turn]).as_matrix()
    return replace(camera, rotation=about @ down @ tilted, position=np.array([0.0, 0.0, height]))


def locate_over_floor(camera: Camera, pixels: FloatArray, floor: FloatArray) -> tuple[Camera, PoseFit]:
    """``camera`` with the pose that puts ``floor`` ``(N, 2)`` metres nearest to ``pixels`` ``(N, 2)``.

    Raises:
        RequestError: fewer than four points, all on one line, pixels beyond the rim, or points that put the camera
            below the floor.
    """
    pixels, floor = np.asarray(pixels, dtype=np.float64), np.asarray(floor, dtype=np.float64)
    if len(pixels) < FEWEST_POINTS:
        raise RequestError(f"expected at least {FEWEST_POINTS} points of the floor, got {len(pixels)}: measure more")
    spread = np.linalg.svd(floor - floor.mean(axis=0), compute_uv=False)
    if spread[1] < FLATNESS * spread[0] or spread[0] < 1e-9:
        raise RequestError("expected points spread over the floor, got points on one line: add points off that line")
    level = replace(camera, rotation=np.eye(3), position=np.zeros(3))
    rays = np.asarray(level.rays(pixels))
    beyond = np.flatnonzero(~np.isfinite(rays).all(axis=1))
    if len(beyond):
        raise RequestError(
            f"expected pixels within the lens's field, got {pixels[beyond[0]].tolist()} in point {beyond[0] + 1}: "
            "check that the calibration belongs to this camera and image size"
        )
    points = np.column_stack([floor, np.zeros(len(floor))])
    start = _linear_pose(level, rays, floor)

    def moved(x: FloatArray) -> Camera:
        turn = Rotation.from_rotvec(x[:3]).as_matrix()
        return replace(start, rotation=turn @ start.rotation, position=start.position + x[3:])

    def errors(x: FloatArray) -> FloatArray:
        return np.asarray(np.nan_to_num(moved(x).project(points)[0] - pixels, nan=1e4).ravel())

    fit = least_squares(errors, np.zeros(6), method="lm", x_scale="jac")
    found = moved(fit.x)
    if found.position[2] <= 0:
        raise RequestError(
            f"expected a camera above the floor, the points put it at {found.position[2]:.2f} m: check the order of "
            "the columns, and that x, y and up make a right-handed system"
        )
    away = np.linalg.norm(found.ground(pixels)[:, :2] - floor, axis=1)
    return found, PoseFit(np.hypot(*fit.fun.reshape(-1, 2).T), away)


def _linear_pose(camera: Camera, rays: FloatArray, floor: FloatArray) -> Camera:
    x, y = floor.T
    zero = np.zeros(len(rays))
    cross = np.array(
        [[zero, -rays[:, 2], rays[:, 1]], [rays[:, 2], zero, -rays[:, 0]], [-rays[:, 1], rays[:, 0], zero]]
    )
    cross = np.moveaxis(cross, 2, 0)
    rows = np.concatenate([cross * x[:, None, None], cross * y[:, None, None], cross], axis=2).reshape(-1, 9)
    columns = np.linalg.svd(rows)[2][-1].reshape(3, 3).T
    columns = columns / np.sqrt(np.linalg.norm(columns[:, 0]) * np.linalg.norm(columns[:, 1]))
    # Of the two signs the one that has the points before the camera, along their rays.
    along = np.einsum("ni,ni->n", rays, np.column_stack([floor, np.ones(len(floor))]) @ columns.T)
    columns = columns * (1.0 if np.median(along) > 0 else -1.0)
    u, _, v = np.linalg.svd(np.column_stack([columns[:, 0], columns[:, 1], np.cross(columns[:, 0], columns[:, 1])]))
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
    return replace(camera, rotation=rotation, position=-rotation.T @ columns[:, 2])


REACH = 10.0


def calibrate_from_points(
    file: Path, image_size: tuple[int, int] | None = None, intrinsics: Sequence[Path] | None = None
) -> tuple[list[Correspondences], list[Calibration]]:
    """The points in a file, a group for each camera, and the camera of each group.

    Args:
        file: see `read_correspondences`.
        image_size: width and height of the images, pixels, where the intrinsics do not say.
        intrinsics: files of OpenCV, of each camera or one for all; then only the pose is fitted.

    Raises:
        RequestError: a file is broken, neither is given, there is another number of intrinsics, or points leave a
            camera open.
    """
    groups = read_correspondences(file)
    if intrinsics is None and image_size is None:
        raise RequestError("expected `image_size` WIDTH,HEIGHT or `intrinsics`, got neither")
    if intrinsics is not None and len(intrinsics) not in (1, len(groups)):
        raise RequestError(f"`intrinsics`: expected 1 file or {len(groups)}, one a camera, got {len(intrinsics)}")
    found = []
    for number, group in enumerate(groups):
        try:
            if intrinsics is not None:
                lens = read_intrinsics(intrinsics[number % len(intrinsics)], image_size)
                found.append(locate_camera(group.points, group.pixels, lens))
            elif image_size is not None:
                found.append(calibrate_camera(group.points, group.pixels, *image_size))
        except RequestError as error:
            raise RequestError(f"{file}: {group.camera}: {error}") from error
    return groups, found


def described(groups: Sequence[Correspondences], found: Sequence[Calibration]) -> list[str]:
    """Lines that say where each camera is and how well it explains each of its points."""
    lines = []
    for group, one in zip(groups, found, strict=True):
        deviations = 1.96 * np.sqrt(np.diag(one.covariance))
        place = ", ".join(f"{v:.3f} ± {s:.3f}" for v, s in zip(one.camera.position, deviations, strict=True))
        lines.append(f"{group.camera}: {len(group.points)} points, {one.root_mean_square:.3f} px rms, at {place} m")
        worst = int(np.argmax(one.residuals))
        for row, (line, residual) in enumerate(zip(group.lines, one.residuals, strict=True)):
            lines.append(f"  line {line}: {residual:.3f} px" + ("  largest" if row == worst else ""))
    return lines


def locate_from_points(camera: Camera, file: Path) -> tuple[Camera, list[str]]:
    """``camera`` with the pose that points of the floor in a file give it, and lines that say how well they fit.

    Raises:
        RequestError: see `read_floor_points` and `locate_over_floor`.
    """
    given = read_floor_points(file)
    try:
        placed, fit = locate_over_floor(camera, given.pixels, given.points[:, :2])
    except RequestError as error:
        raise RequestError(f"{file}: {error}") from error
    rows = zip(given.lines, fit.residuals, fit.metres, strict=True)
    lines = [f"  line {line}: {pixels:.3f} px, {metres:.3f} m" for line, pixels, metres in rows]
    root_mean_square = np.sqrt(np.mean(fit.residuals**2))
    return placed, [f"{root_mean_square:.3f} px rms over {len(lines)} points", *lines]


def standing(
    camera: PinholeCamera | OmnidirectionalCamera, floor: FloatArray, place: tuple[float, float], height: float
) -> str:
    """A line with the boxes of somebody of a ``height`` in metres who stands at ``place``, x and y in metres.

    Raises:
        RequestError: see `stand`.
    """
    upright, rotated = stand(camera, np.array(place), floor, PersonModel(height=height))
    corners = ",".join(f"{value:.1f}" for value in upright)
    turned = ",".join(f"{value:.1f}" for value in (*rotated[:4], np.degrees(rotated[4])))
    return (
        f"{height:g} m tall at {place[0]:g},{place[1]:g}: upright {corners} (x1,y1,x2,y2), rotated {turned} "
        "(cx,cy,w,h,degrees clockwise)"
    )


def floor_about(
    camera: PinholeCamera | OmnidirectionalCamera, floor: tuple[float, float, float, float] | None = None
) -> FloatArray:
    """``(4,)`` x1, y1, x2, y2 of a floor, metres: the given one, or `REACH` metres to each side of the camera.

    Raises:
        RequestError: it has no area.
    """
    # Adding zero makes a plain zero of a negative one.
    x, y, _ = np.round(camera.position, 6) + 0.0
    area = np.array([x - REACH, y - REACH, x + REACH, y + REACH] if floor is None else floor, dtype=np.float64)
    if area[0] >= area[2] or area[1] >= area[3]:
        raise RequestError(f"`floor`: expected X1 < X2 and Y1 < Y2, got {','.join(f'{v:g}' for v in area)}")
    return area
