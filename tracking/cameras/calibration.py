"""Cameras from points whose place is known both in the world and in the image.

The normalised direct linear transform gives the projection matrix of Hartley and Zisserman, *Multiple View Geometry*,
2nd ed., algorithm 7.1 and section 4.4.4; Levenberg-Marquardt then makes the reprojection error least.

A camera of known lens hangs over the floor by its height and tilt, or by points of the floor (z = 0). With rays d in
the camera's axes, ``d x (x r1 + y r2 + t) = 0`` is linear in the first two columns of the rotation and the shift.
Being written in rays it holds for lenses of any width.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray, ImageArray

CameraT = TypeVar("CameraT", bound=PinholeCamera | OmnidirectionalCamera)
# Points that fix a projection matrix, eleven numbers by two equations each.
FEWEST_POINTS = 6
# Points of the floor that fix the pose of a camera over it.
FEWEST_OF_FLOOR = 4
# Share of the largest spread of points below which they lie on a line or a plane.
FLATNESS = 1e-3
# A second direction that fits this much less badly than the third best means that the points leave the camera open.
AMBIGUITY = 1e-5


@dataclass(frozen=True)
class Calibration:
    """A camera and how well it explains its points.

    Attributes:
        camera: the camera.
        residuals: ``(N,)`` distances between given and projected pixels.
        covariance: ``(3, 3)`` of the camera's position, square metres, from the residuals.
    """

    camera: PinholeCamera
    residuals: FloatArray
    covariance: FloatArray

    @property
    def root_mean_square(self) -> float:
        """Of the residuals, pixels."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def projection_matrix(points: FloatArray, pixels: FloatArray) -> FloatArray:
    """``(3, 4)`` matrix that takes ``(N, 3)`` world points to ``(N, 2)`` pixels, by the normalised DLT.

    Its third row gives depths: positive for points before the camera, in the points' unit.

    Raises:
        RequestError: fewer than six points, points on one line or plane, points and camera on one twisted cubic or
            another degenerate set, or points on both sides of the camera.
    """
    points, pixels = _checked(points, pixels)
    _refuse_flat(points)
    world, from_world = _normalise(points)
    image, from_image = _normalise(pixels)
    homogeneous = np.column_stack([world, np.ones(len(world))])
    zeros = np.zeros_like(homogeneous)
    rows = np.concatenate(
        [
            np.hstack([homogeneous, zeros, -image[:, :1] * homogeneous]),
            np.hstack([zeros, homogeneous, -image[:, 1:] * homogeneous]),
        ]
    )
    _, singular, right = np.linalg.svd(rows)
    if singular[-2] < AMBIGUITY * singular[0]:
        raise RequestError(
            "expected points that leave one camera only, got a degenerate set (points and camera on one curve or "
            "repeated points): add points elsewhere in the volume"
        )
    matrix = np.linalg.inv(from_image) @ right[-1].reshape(3, 4) @ from_world
    matrix = matrix / np.linalg.norm(matrix[2, :3])
    if np.linalg.det(matrix[:, :3]) < 0:
        matrix = -matrix
    depth = np.column_stack([points, np.ones(len(points))]) @ matrix[2]
    _refuse_behind(depth)
    return np.asarray(matrix)


def decompose(matrix: FloatArray, width: int, height: int) -> PinholeCamera:
    """The camera of a ``(3, 4)`` projection matrix; its skew, which `PinholeCamera` does not have, is dropped."""
    intrinsics, rotation = _rq(matrix[:, :3])
    intrinsics = intrinsics / intrinsics[2, 2]
    return PinholeCamera(
        width=width,
        height=height,
        focal=np.array([intrinsics[0, 0], intrinsics[1, 1]]),
        principal_point=intrinsics[:2, 2],
        rotation=rotation,
        position=np.asarray(-np.linalg.solve(matrix[:, :3], matrix[:, 3]), dtype=np.float64),
    )


def calibrate_camera(points: FloatArray, pixels: FloatArray, width: int, height: int) -> Calibration:
    """The camera of an ideal lens without skew that projects ``points`` ``(N, 3)`` nearest to ``pixels`` ``(N, 2)``.

    Ten numbers are fitted: two focal lengths, the principal point, orientation and position.

    Raises:
        RequestError: as `projection_matrix`.
    """
    points, pixels = _checked(points, pixels)
    start = decompose(projection_matrix(points, pixels), width, height)

    def camera_of(x: FloatArray) -> PinholeCamera:
        return replace(_moved(start, x[:6]), focal=start.focal * np.exp(x[6:8]), principal_point=x[8:10])

    return _refine(camera_of, np.concatenate([np.zeros(6), np.zeros(2), start.principal_point]), points, pixels)


def locate_camera(points: FloatArray, pixels: FloatArray, lens: PinholeCamera) -> Calibration:
    """Orientation and position of a camera of known ``lens``; points on one plane are enough here.

    Raises:
        RequestError: fewer than six points, all on one line, pixels that the lens cannot have made, or points behind
            the camera.
    """
    points, pixels = _checked(points, pixels)
    _refuse_flat(points, smallest=1, shape="line")
    normalised = lens.normalised(pixels)
    _refuse_outside(normalised, pixels, "intrinsics belong")
    solved, turn, shift = cv2.solvePnP(points, normalised, np.eye(3), np.zeros(5), flags=cv2.SOLVEPNP_SQPNP)
    if not solved:
        raise RequestError("expected points that fix the camera's pose, got a degenerate set: add points elsewhere")
    rotation = Rotation.from_rotvec(turn[:, 0]).as_matrix()
    start = replace(lens, rotation=rotation, position=-rotation.T @ shift[:, 0])
    return _refine(lambda x: _moved(start, x), np.zeros(6), points, pixels)


def pose_at(camera: CameraT, height: float, tilt: float = 0.0, turn: float = 0.0) -> CameraT:
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


def locate_over_floor(camera: CameraT, pixels: FloatArray, floor: FloatArray) -> tuple[CameraT, FloatArray, FloatArray]:
    """``camera`` with the pose that puts ``floor`` ``(N, 2)`` metres nearest to ``pixels`` ``(N, 2)``.

    Returns:
        The camera, ``(N,)`` pixels between given and projected pixels, and ``(N,)`` metres on the floor between given
        points and those that the pixels show.

    Raises:
        RequestError: fewer than four points, all on one line, pixels beyond the rim, or points that put the camera
            below the floor.
    """
    pixels, floor = np.asarray(pixels, dtype=np.float64), np.asarray(floor, dtype=np.float64)
    if len(pixels) < FEWEST_OF_FLOOR:
        raise RequestError(f"expected at least {FEWEST_OF_FLOOR} points of the floor, got {len(pixels)}: measure more")
    spread = np.linalg.svd(floor - floor.mean(axis=0), compute_uv=False)
    if spread[1] < FLATNESS * spread[0] or spread[0] < 1e-9:
        raise RequestError("expected points spread over the floor, got points on one line: add points off that line")
    level = replace(camera, rotation=np.eye(3), position=np.zeros(3))
    rays = np.asarray(level.rays(pixels))
    _refuse_outside(rays, pixels, "calibration belongs")
    start = _linear_pose(level, rays, floor)
    points = np.column_stack([floor, np.zeros(len(floor))])
    fit = _least_error(lambda x: _moved(start, x), np.zeros(6), points, pixels)
    located = _moved(start, fit.x)
    if located.position[2] <= 0:
        raise RequestError(
            f"expected a camera above the floor, the points put it at {located.position[2]:.2f} m: check the order of "
            "the columns, and that x, y and up make a right-handed system"
        )
    away = np.linalg.norm(located.ground(pixels)[:, :2] - floor, axis=1)
    return located, np.hypot(*fit.fun.reshape(-1, 2).T), away


def _linear_pose(camera: CameraT, rays: FloatArray, floor: FloatArray) -> CameraT:
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


def _least_error(
    camera_of: Callable[[FloatArray], CameraT], start: FloatArray, points: FloatArray, pixels: FloatArray
) -> Any:
    """SciPy's result for the numbers whose camera projects ``points`` nearest to ``pixels``."""

    def errors(x: FloatArray) -> FloatArray:
        # A step that puts a point behind the camera must not win; its error is merely large.
        return np.asarray(np.nan_to_num(camera_of(x).project(points)[0] - pixels, nan=1e4).ravel())

    return least_squares(errors, start, method="lm", x_scale="jac")


def _refine(
    camera_of: Callable[[FloatArray], PinholeCamera], start: FloatArray, points: FloatArray, pixels: FloatArray
) -> Calibration:
    _refuse_behind(camera_of(start).project(points)[1])
    fit = _least_error(camera_of, start, points, pixels)
    camera = camera_of(fit.x)
    _refuse_behind(camera.project(points)[1])
    residuals = np.sqrt(np.square(fit.fun.reshape(-1, 2)).sum(axis=1))
    spare = max(fit.fun.size - fit.x.size, 1)
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac)[3:6, 3:6] * (fit.fun @ fit.fun) / spare
    return Calibration(camera, residuals, covariance)


def _moved(camera: CameraT, x: FloatArray) -> CameraT:
    """``camera`` turned by the rotation vector ``x[:3]`` and shifted by ``x[3:6]``."""
    turn = Rotation.from_rotvec(x[:3]).as_matrix()
    return replace(camera, rotation=turn @ camera.rotation, position=camera.position + x[3:6])


def _checked(points: FloatArray, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
    # OpenCV takes no columns of a larger array.
    points, pixels = (np.ascontiguousarray(values, dtype=np.float64) for values in (points, pixels))
    if points.ndim != 2 or points.shape[1] != 3 or pixels.shape != (len(points), 2):
        raise RequestError(f"expected points (N, 3) and pixels (N, 2), got {points.shape} and {pixels.shape}")
    if len(points) < FEWEST_POINTS:
        raise RequestError(f"expected at least {FEWEST_POINTS} points a camera, got {len(points)}: measure more points")
    if not (np.isfinite(points).all() and np.isfinite(pixels).all()):
        raise RequestError("expected finite coordinates, got NaN or infinity: remove those rows")
    return points, pixels


def _refuse_flat(points: FloatArray, smallest: int = 2, shape: str = "plane") -> None:
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[1] < FLATNESS * spread[0]:
        raise RequestError("expected points in space, got points on one line (collinear): add points off that line")
    if spread[smallest] < FLATNESS * spread[0]:
        raise RequestError(
            f"expected points in space, got points on one {shape} (coplanar): add points off that plane, or give the "
            "camera's intrinsics"
        )


def _refuse_outside(rays: FloatArray, pixels: FloatArray, what: str) -> None:
    """Refuse ``pixels`` whose ``rays`` are not finite; ``what`` should belong to the camera."""
    beyond = np.flatnonzero(~np.isfinite(rays).all(axis=1))
    if len(beyond):
        raise RequestError(
            f"expected pixels within the lens's field, got {pixels[beyond[0]].tolist()} in point {beyond[0] + 1}: "
            f"check that the {what} to this camera and image size"
        )


def _refuse_behind(depth: FloatArray) -> None:
    behind = np.flatnonzero(depth <= 0)
    if len(behind):
        raise RequestError(
            f"expected all points before the camera, got {len(behind)} of {len(depth)} behind it "
            f"(first: point {behind[0] + 1}): check the signs and the order of the coordinates"
        )


def _normalise(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values with zero mean and root-mean-square distance sqrt(dimension), and the matrix that made them so."""
    size = values.shape[1]
    mean = values.mean(axis=0)
    scale = np.sqrt(size) / max(float(np.sqrt(np.mean(np.square(values - mean).sum(axis=1)))), 1e-12)
    matrix = np.eye(size + 1)
    matrix[:size, :size] *= scale
    matrix[:size, size] = -scale * mean
    return (values - mean) * scale, matrix


def _rq(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Upper triangle with positive diagonal times rotation; the determinant of ``matrix`` is positive."""
    q, r = np.linalg.qr(np.flipud(matrix).T)
    upper, rotation = np.flipud(np.fliplr(r.T)), np.flipud(q.T)
    signs = np.diag(np.sign(np.diag(upper)))
    return upper @ signs, signs @ rotation


Coefficients = Literal[5, 8, 12]
FEWEST = 4
"""Fewest pictures that determine focal length and lens."""
# Largest angle between two boards below which they all face one way, radians.
SMALLEST_TILT = np.deg2rad(5.0)
UNFIXED = "expected pictures of the board from different sides, got some that do not fix the camera"
# OpenCV counts pixels from the first one's centre.
HALF_PIXEL = 0.5
# What OpenCV fits for a number of coefficients.
FLAGS: dict[Coefficients, int] = {
    5: 0,
    8: cv2.CALIB_RATIONAL_MODEL,
    12: cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL,
}


def find_corners(image: ImageArray, corners: tuple[int, int]) -> FloatArray | None:
    """``(N, 2)`` pixels of the inner corners, row by row, as OpenCV counts them; None where the board is not whole.

    Args:
        image: ``(H, W, 3)`` uint8.
        corners: inner corners along a row and along a column.
    """
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    complete, places = cv2.findChessboardCornersSB(grey, corners, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    return np.asarray(places, dtype=np.float64).reshape(-1, 2) if complete else None


def fit_checkerboards(
    detections: Sequence[FloatArray],
    corners: tuple[int, int],
    size: tuple[int, int],
    coefficients: Coefficients = 5,
) -> tuple[PinholeCamera, FloatArray, FloatArray]:
    """Intrinsics and distortion from the corners of several pictures.

    Args:
        detections: ``(N, 2)`` of each picture, from `find_corners`.
        corners: inner corners along a row and along a column.
        size: width and height of the pictures.
        coefficients: of the lens model.

    Returns:
        The camera at the origin, ``(P,)`` root mean square distances of the corners of each picture, and ``(2,)``
        standard deviations of the focal lengths, pixels.

    Raises:
        RequestError: there are too few pictures, or they do not fix the camera.
    """
    if len(detections) < FEWEST:
        raise RequestError(
            f"expected the whole board in at least {FEWEST} pictures, found it in {len(detections)}; check the "
            "numbers of inner corners, and tilt the board"
        )
    board = np.zeros((corners[0] * corners[1], 3), dtype=np.float32)
    board[:, :2] = np.mgrid[: corners[0], : corners[1]].T.reshape(-1, 2)
    try:
        _, matrix, lens, turns, _, deviations, _, errors = cv2.calibrateCameraExtended(
            [board] * len(detections), [places.astype(np.float32) for places in detections], size, None, None,  # type: ignore[call-overload]
            flags=FLAGS[coefficients],
        )  # fmt: skip
    except cv2.error as error:
        raise RequestError(UNFIXED) from error
    lens = np.pad(lens.ravel(), (0, max(12 - lens.size, 0)))[:coefficients]
    focal, deviation = matrix[[0, 1], [0, 1]], deviations.ravel()[:2]
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns])
    # Boards that all face one way leave focal length and distance open together.
    tilted = float((normals @ normals.T).min()) < np.cos(SMALLEST_TILT)
    if not (tilted and np.isfinite(lens).all() and (deviation < 0.5 * focal).all()):
        raise RequestError(UNFIXED)
    camera = PinholeCamera(*size, focal, matrix[:2, 2] + HALF_PIXEL, distortion=lens)
    return camera, errors.ravel().astype(np.float64), deviation.astype(np.float64)
