"""`tsuiseki calibrate pose`."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking.cli.calibrate.options import CAMERA_FILE, FrameRate, LensSizes
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.options import OutputFile


def pose(
    file: Path,
    /,
    sizes: LensSizes,
    rate: FrameRate,
    output: OutputFile = CAMERA_FILE,
    height: float | None = None,
    tilt: float = 0.0,
    turn: float = 0.0,
    points: Path | None = None,
    floor: tuple[float, float, float, float] | None = None,
    projective: bool = False,
    name: str = "camera1",
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
        projective: the lens is projective.
        name: of the camera.
    """
    import numpy as np

    from tsuiseki.tracking.cameras.files import read_intrinsics
    from tsuiseki.tracking.cameras.floor_files import CameraOverFloor, write_floor_cameras
    from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera
    from tsuiseki.tracking.cameras.pose import pose_at
    from tsuiseki.tracking.cameras.projective import PinholeCamera
    from tsuiseki.tracking.pipelines.calibration import floor_about, locate_from_points

    if (height is None) == (points is None):
        raise RequestError("expected one of `height` and `points`, got both or neither")
    if projective and sizes.resize is not None:
        raise RequestError("`resize`: only fisheye calibrations are scaled; leave it out with `projective`")
    camera: PinholeCamera | OmnidirectionalCamera
    if projective:
        camera = read_intrinsics(file, sizes.image_size).camera()
    else:
        camera = OmnidirectionalCamera(sizes.read(file), np.eye(3), np.zeros(3))
    lines: list[str] = []
    if height is not None:
        camera = pose_at(camera, height, np.radians(tilt), np.radians(turn))
    elif points is not None:
        camera, lines = locate_from_points(camera, points)
    placed = CameraOverFloor(name, camera, floor_about(camera, floor), rate.frame_rate)
    output.write(output.out, lambda path: write_floor_cameras(path, [placed]))
    x, y, z = np.round(camera.position, 6) + 0.0
    print("\n".join([*lines, f"{name}: at {x:.3f}, {y:.3f}, {z:.3f} m: {output.out}"]))
