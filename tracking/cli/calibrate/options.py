"""Options that the commands of `tsuiseki calibrate` share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.options import OutputFile, Shared

if TYPE_CHECKING:
    from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalLens

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

    def read(self, file: Path) -> OmnidirectionalLens:
        """The fisheye lens in ``file``, for images of the wanted size."""
        from tsuiseki.tracking.cameras.lens_files import read_lens

        lens = read_lens(file, self.image_size)
        return lens if self.resize is None else lens.resized(*self.resize, self.resize_by)


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
