"""`tsuiseki calibrate points`."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking.calibrate.options import CAMERA_FILE, FrameRate, ImageSize
from tsuiseki.tracking.options import OutputFile


def points(
    file: Path,
    /,
    size: ImageSize,
    rate: FrameRate,
    output: OutputFile = CAMERA_FILE,
    intrinsics: list[Path] | None = None,
) -> None:
    """Cameras from six or more known points each, written as cameras.yaml.

    Args:
        file: CSV with the columns x, y, z (metres, z up), u, v (pixels, the first pixel's centre at 0.5) and, for
            several cameras, camera.
        out: the camera file to write.
        image_size: WIDTH,HEIGHT of the images; not needed where the intrinsics say.
        intrinsics: one OpenCV calibration file per camera (or one for all), separated by commas; only the pose is
            fitted then, and the lens may distort.
    """
    from tsuiseki.tracking.calibrate.point_files import calibrate_from_points, described
    from tsuiseki.tracking.cameras.camera_files import PlacedCamera, write_cameras

    groups, found = calibrate_from_points(file, size.image_size, intrinsics)
    placed = [PlacedCamera(group.camera, one.camera, rate.frame_rate) for group, one in zip(groups, found, strict=True)]
    output.write(output.out, lambda path: write_cameras(path, placed))
    # After the file, which must not depend on who reads the listing to its end.
    print("\n".join([*described(groups, found), f"{len(placed)} cameras: {output.out}"]))
