"""What the commands of `tsuiseki calibrate` are told of a camera: its images, its lens, its place over a floor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.options import OutputFile, Shared

if TYPE_CHECKING:
    from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera, OmnidirectionalLens
    from tsuiseki.tracking.cameras.projective import PinholeCamera
    from tsuiseki.tracking.types import FloatArray

CAMERA_FILE = OutputFile(out=Path("cameras.yaml"))


@dataclass(frozen=True)
class ImageSize(Shared):
    """Of the calibration.

    Attributes:
        image_size: WIDTH,HEIGHT of the calibration's images, where its file does not say.
    """

    image_size: tuple[int, int] | None = None

    def check(self) -> None:
        """See `Shared.check`."""
        _check_size("image_size", self.image_size)


@dataclass(frozen=True)
class LensSizes(ImageSize):
    """Of the calibration, and of the images that it is used on.

    Attributes:
        resize: WIDTH,HEIGHT of the images, where it is not the calibration's, which is then scaled.
        resize_by: whether those show a part of what was calibrated (cut) or more at the sides (widen).
    """

    resize: tuple[int, int] | None = None
    resize_by: Literal["cut", "widen"] = "cut"

    def check(self) -> None:
        """See `Shared.check`."""
        super().check()
        _check_size("resize", self.resize)

    def read(self, file: Path) -> tuple[OmnidirectionalLens, FloatArray]:
        """The fisheye lens in ``file``, for images of the wanted size; and see `read_lens_fitted`."""
        from tsuiseki.tracking.cameras.lens_files import read_lens_fitted

        lens, residuals = read_lens_fitted(file, self.image_size)
        return (lens if self.resize is None else lens.resized(*self.resize, self.resize_by)), residuals


@dataclass(frozen=True)
class FloorPose(LensSizes):
    """Where a camera hangs over a floor.

    Attributes:
        height: of the camera over the floor, metres; the floor's origin is then right below it.
        tilt: of the axis from straight down, towards +y of the floor, degrees.
        turn: of the camera about its axis, degrees; at 0 the image's right is +x.
        points: CSV with the columns u, v (pixels, the first pixel's centre at 0.5), x and y (metres on the floor), four
            rows or more, instead of --height.
        projective: the lens is projective.
    """

    height: float | None = None
    tilt: float = 0.0
    turn: float = 0.0
    points: Path | None = None
    projective: bool = False

    def check(self) -> None:
        """See `Shared.check`."""
        super().check()
        if (self.height is None) == (self.points is None):
            raise RequestError("expected one of `height` and `points`, got both or neither")
        if self.projective and self.resize is not None:
            raise RequestError("`resize`: only fisheye calibrations are scaled; leave it out with `projective`")

    def camera(self, file: Path) -> tuple[PinholeCamera | OmnidirectionalCamera, list[str]]:
        """The camera whose lens is in ``file``, in its place, and what is to be told of the fit."""
        from tsuiseki.tracking.calibrate.point_files import locate_from_points
        from tsuiseki.tracking.cameras.intrinsic_files import read_intrinsics
        from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera
        from tsuiseki.tracking.cameras.pose import pose_at

        camera: PinholeCamera | OmnidirectionalCamera
        if self.projective:
            camera = read_intrinsics(file, self.image_size).camera()
        else:
            camera = OmnidirectionalCamera(self.read(file)[0], np.eye(3), np.zeros(3))
        if self.points is not None:
            return locate_from_points(camera, self.points)
        return pose_at(camera, self.height or 0.0, np.radians(self.tilt), np.radians(self.turn)), []


@dataclass(frozen=True)
class FrameRate(Shared):
    """Of the videos.

    Attributes:
        frame_rate: frames per second, for videos that do not tell: folders of images.
    """

    frame_rate: float | None = None

    def check(self) -> None:
        """See `Shared.check`."""
        if self.frame_rate is not None and not self.frame_rate > 0:
            raise RequestError(f"`frame_rate`: expected a number above 0, got {self.frame_rate:g}")


def _check_size(name: str, size: tuple[int, int] | None) -> None:
    if size is not None and min(size) < 1:
        raise RequestError(f"`{name}`: expected two numbers above 0, got {size[0]},{size[1]}")
