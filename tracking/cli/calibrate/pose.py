"""`tsuiseki calibrate pose`."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking.options import OutputFile
from tsuiseki.tracking.pipelines.calibration.options import CAMERA_FILE, FloorPose, FrameRate


def pose(
    file: Path,
    /,
    place: FloorPose,
    rate: FrameRate,
    output: OutputFile = CAMERA_FILE,
    floor: tuple[float, float, float, float] | None = None,
    name: str = "camera1",
) -> None:
    """Where a camera of known lens hangs over the floor, written as cameras.yaml.

    Either --height, or --points on the floor. Several cameras go into one file by joining their lists.

    Args:
        file: the lens, in any format that tsuiseki calibrate convert reads, or with --projective OpenCV's intrinsics.
        out: the camera file to write.
        floor: X1,Y1,X2,Y2 of the floor that people stand on, metres; by default 10 m about the camera.
        name: of the camera.
    """
    from tsuiseki.tracking.cameras.floor_files import CameraOverFloor, write_floor_cameras
    from tsuiseki.tracking.pipelines.calibration.points import floor_about

    camera, lines = place.camera(file)
    placed = CameraOverFloor(name, camera, floor_about(camera, floor), rate.frame_rate)
    output.write(output.out, lambda path: write_floor_cameras(path, [placed]))
    x, y, z = (camera.position.round(6) + 0.0).tolist()
    print("\n".join([*lines, f"{name}: at {x:.3f}, {y:.3f}, {z:.3f} m: {output.out}"]))
