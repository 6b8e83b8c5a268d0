"""Several cameras from measured points, and what to tell of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tsuiseki.tracking.cameras.calibration import Calibration, calibrate_camera, locate_camera
from tsuiseki.tracking.cameras.camera_pose import Camera, locate_over_floor
from tsuiseki.tracking.cameras.intrinsic_files import read_intrinsics
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera
from tsuiseki.tracking.cameras.person_model import PersonModel, stand
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.world_tables import Correspondences, read_correspondences, read_floor_points
from tsuiseki.tracking.types import FloatArray

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
