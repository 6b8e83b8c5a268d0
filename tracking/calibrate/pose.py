"""`tsuiseki calibrate pose`."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking.calibrate.options import CAMERA_FILE, FloorPose, FrameRate
from tsuiseki.tracking.options import OutputFile


def pose(
    file: Path,
    /,
    place: FloorPose,
    rate: FrameRate,
    output: OutputFile = CAMERA_FILE,
    floor: tuple[float, float, float, float] | None = None,
    name: str = "camera1",
    stand: tuple[float, float] | None = None,
    person_height: float = 1.7,
) -> None:
    """Where a camera of known lens hangs over the floor, written as cameras.yaml.

    Either --height, or --points on the floor. Several cameras go into one file by joining their lists.

    Args:
        file: the lens, in any format that tsuiseki calibrate convert reads, or with --projective OpenCV's intrinsics.
        out: the camera file to write.
        floor: X1,Y1,X2,Y2 of the floor that people stand on, metres; by default 10 m about the camera.
        name: of the camera.
        stand: X,Y on the floor, metres, where somebody stands: also print the upright and the rotated box that the
            model of a person has there, to compare with a picture.
        person_height: of the model of a person, metres.
    """
    from tsuiseki.tracking.calibrate.point_files import floor_about, standing
    from tsuiseki.tracking.cameras.camera_files import CameraOverFloor, write_cameras
    from tsuiseki.tracking.cameras.person_model import PersonModel, check_height

    camera, lines = place.camera(file)
    if not place.projective:
        # The person of `track fisheye` stands under its camera; a projective one may look from the side.
        check_height(camera, PersonModel(height=person_height))
    area = floor_about(camera, floor)
    if stand is not None:
        lines.append(standing(camera, area, stand, person_height))
    placed = CameraOverFloor(name, camera, rate.frame_rate, floor=area)
    output.write(output.out, lambda path: write_cameras(path, [placed]))
    x, y, z = (camera.position.round(6) + 0.0).tolist()
    print("\n".join([*lines, f"{name}: at {x:.3f}, {y:.3f}, {z:.3f} m: {output.out}"]))
