"""`tsuiseki calibrate`: cameras from measurements."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tsuiseki.tracking.errors import RequestError


def points(
    file: Path,
    out: Path = Path("cameras.yaml"),
    image_size: tuple[int, int] | None = None,
    intrinsics: list[Path] | None = None,
    frame_rate: float | None = None,
    overwrite: bool = False,
) -> None:
    """Cameras from six or more known points each, written as cameras.yaml.

    Args:
        file: CSV with the columns x, y, z (metres, z up), u, v (pixels, the first pixel's centre at 0.5) and, for
            several cameras, camera.
        out: the camera file to write.
        image_size: WIDTH,HEIGHT of the images; not needed where the intrinsics say.
        intrinsics: one OpenCV calibration file per camera (or one for all), separated by commas; only the pose is
            fitted then, and the lens may distort.
        frame_rate: frames per second of all cameras, for videos that do not tell: folders of images.
        overwrite: replace an existing camera file.
    """
    import numpy as np

    from tsuiseki.tracking.cameras.calibration import calibrate_camera, locate_camera
    from tsuiseki.tracking.cameras.files import PlacedCamera, read_intrinsics, write_cameras
    from tsuiseki.tracking.formats.correspondences import read_correspondences
    from tsuiseki.tracking.output import check_output_file, output_file

    check_output_file(out, overwrite)
    groups = read_correspondences(file)
    if intrinsics is None and image_size is None:
        raise RequestError("expected --image-size WIDTH,HEIGHT or --intrinsics, got neither")
    if image_size is not None and min(image_size) < 1:
        raise RequestError(f"--image-size: expected two numbers above 0, got {image_size[0]},{image_size[1]}")
    if frame_rate is not None and not frame_rate > 0:
        raise RequestError(f"--frame-rate: expected a number above 0, got {frame_rate:g}")
    if intrinsics is not None and len(intrinsics) not in (1, len(groups)):
        raise RequestError(f"--intrinsics: expected 1 file or {len(groups)}, one a camera, got {len(intrinsics)}")
    placed: list[PlacedCamera] = []
    lines: list[str] = []
    for number, group in enumerate(groups):
        try:
            if intrinsics is None:
                assert image_size is not None
                found = calibrate_camera(group.points, group.pixels, *image_size)
            else:
                lens = read_intrinsics(intrinsics[number % len(intrinsics)], image_size)
                found = locate_camera(group.points, group.pixels, lens)
        except RequestError as error:
            raise RequestError(f"{file}: {group.camera}: {error}") from error
        placed.append(PlacedCamera(group.camera, found.camera, frame_rate))
        worst = int(np.argmax(found.residuals))
        place = ", ".join(
            f"{v:.3f} ± {1.96 * s:.3f}"
            for v, s in zip(found.camera.position, np.sqrt(np.diag(found.covariance)), strict=True)
        )
        lines.append(f"{group.camera}: {len(group.points)} points, {found.root_mean_square:.3f} px rms, at {place} m")
        for line, residual in zip(group.lines, found.residuals, strict=True):
            lines.append(f"  line {line}: {residual:.3f} px" + ("  largest" if line == group.lines[worst] else ""))
    with output_file(out, overwrite) as work:
        write_cameras(work, placed)
    # After the file, which must not depend on who reads the listing to its end.
    print("\n".join([*lines, f"{len(placed)} cameras: {out}"]))


def convert(
    file: Path,
    to: Literal["ocam", "py-ocam", "kalibr-omni", "kalibr-equidistant", "opencv"],
    out: Path,
    image_size: tuple[int, int] | None = None,
    resize: tuple[int, int] | None = None,
    resize_by: Literal["cut", "widen"] = "cut",
    overwrite: bool = False,
) -> None:
    """The calibration of a fisheye lens in the format of another program, and how far that puts pixels off.

    Args:
        file: calib_results.txt of OCamCalib, JSON of py-OCamCalib, camchain YAML of Kalibr (omni with radtan, or
            pinhole with equidistant), or OpenCV's fisheye K and D; which one is seen from what is there.
        to: the format to write. ocam and py-ocam hold the same model and lose nothing; of the others the nearest lens
            is fitted.
        out: the file to write.
        image_size: WIDTH,HEIGHT of the calibration, where the file does not say: py-OCamCalib's.
        resize: WIDTH,HEIGHT of other images of the camera, to which the calibration is scaled.
        resize_by: whether those show a part of what was calibrated (cut) or more at the sides (widen).
        overwrite: replace an existing file.
    """
    import numpy as np

    from tsuiseki.tracking.cameras.lens_files import read_lens, write_lens
    from tsuiseki.tracking.cameras.lens_fitting import image_rays
    from tsuiseki.tracking.output import check_output_file, output_file

    check_output_file(out, overwrite)
    lens = read_lens(file, image_size)
    if resize is not None:
        if min(resize) < 1:
            raise RequestError(f"--resize: expected two numbers above 0, got {resize[0]},{resize[1]}")
        lens = lens.resized(*resize, resize_by)
    with output_file(out, overwrite) as work:
        residuals = write_lens(work, lens, to)
    lines = [f"{to}: {np.sqrt(np.mean(residuals**2)):.4f} px rms, {residuals.max():.4f} px at most over the image"]
    if len(lens.inverse):
        pixels, rays = image_rays(lens)
        away = np.hypot(*(lens.project_by_inverse(rays) - pixels).T)
        lines.append(f"inverse polynomial of {file.name}: {away.max():.4f} px at most from the exact root")
    print("\n".join([*lines, f"{lens.width}x{lens.height}: {out}"]))


def pose(
    file: Path,
    out: Path = Path("cameras.yaml"),
    height: float | None = None,
    tilt: float = 0.0,
    turn: float = 0.0,
    points: Path | None = None,
    floor: tuple[float, float, float, float] | None = None,
    image_size: tuple[int, int] | None = None,
    resize: tuple[int, int] | None = None,
    resize_by: Literal["cut", "widen"] = "cut",
    projective: bool = False,
    name: str = "camera1",
    frame_rate: float | None = None,
    overwrite: bool = False,
) -> None:
    """Where a camera of known lens hangs over the floor, written as cameras.yaml.

    Either --height, or --points on the floor. Several cameras go into one file by joining their lists.

    Args:
        file: the lens, in any format that tsuiseki calibrate convert reads, or with --projective OpenCV's intrinsics.
        out: the camera file to write.
        height: of the camera over the floor, metres; the floor's origin is then right below it.
        tilt: of the axis from straight down, towards +y of the floor, degrees.
        turn: of the camera about its axis, degrees; at 0 the image's right is +x.
        points: CSV with the columns u, v (pixels, the first pixel's centre at 0.5), x and y (metres on the floor), four
            rows or more, instead of --height.
        floor: X1,Y1,X2,Y2 of the floor that people stand on, metres; by default 10 m about the camera.
        image_size: WIDTH,HEIGHT of the calibration, where the file does not say.
        resize: WIDTH,HEIGHT of the images, where it is not the calibration's, which is then scaled.
        resize_by: whether those show a part of what was calibrated (cut) or more at the sides (widen).
        projective: the lens is projective.
        name: of the camera.
        frame_rate: frames per second, for videos that do not tell: folders of images.
        overwrite: replace an existing camera file.
    """
    import numpy as np

    from tsuiseki.tracking.cameras.files import read_intrinsics
    from tsuiseki.tracking.cameras.floor_files import CameraOverFloor, write_floor_cameras
    from tsuiseki.tracking.cameras.lens_files import read_lens
    from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera
    from tsuiseki.tracking.cameras.pose import locate_over_floor, pose_at
    from tsuiseki.tracking.cameras.projective import PinholeCamera
    from tsuiseki.tracking.formats.correspondences import read_floor_points
    from tsuiseki.tracking.output import check_output_file, output_file

    check_output_file(out, overwrite)
    if (height is None) == (points is None):
        raise RequestError("expected one of --height and --points, got both or neither")
    if projective and resize is not None:
        raise RequestError("--resize: only fisheye calibrations are scaled; leave it out with --projective")
    camera: PinholeCamera | OmnidirectionalCamera
    if projective:
        camera = read_intrinsics(file, image_size).camera()
    else:
        lens = read_lens(file, image_size)
        lens = lens if resize is None else lens.resized(*resize, resize_by)
        camera = OmnidirectionalCamera(lens, np.eye(3), np.zeros(3))
    lines = []
    if height is not None:
        camera = pose_at(camera, height, np.radians(tilt), np.radians(turn))
    else:
        assert points is not None
        given = read_floor_points(points)
        try:
            camera, fit = locate_over_floor(camera, given.pixels, given.points[:, :2])
        except RequestError as error:
            raise RequestError(f"{points}: {error}") from error
        lines = [
            f"  line {line}: {pixels:.3f} px, {metres:.3f} m"
            for line, pixels, metres in zip(given.lines, fit.residuals, fit.metres, strict=True)
        ]
        lines.insert(0, f"{np.sqrt(np.mean(fit.residuals**2)):.3f} px rms over {len(lines)} points")
    # Adding zero makes a plain zero of a negative one.
    x, y, z = np.round(camera.position, 6) + 0.0
    area = np.array([x - 10, y - 10, x + 10, y + 10] if floor is None else floor, dtype=np.float64)
    if area[0] >= area[2] or area[1] >= area[3]:
        raise RequestError(f"--floor: expected X1 < X2 and Y1 < Y2, got {','.join(f'{v:g}' for v in area)}")
    with output_file(out, overwrite) as work:
        write_floor_cameras(work, [CameraOverFloor(name, camera, area, frame_rate)])
    print("\n".join([*lines, f"{name}: at {x:.3f}, {y:.3f}, {z:.3f} m: {out}"]))
