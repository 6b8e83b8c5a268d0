"""`tsuiseki calibrate convert`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tsuiseki.tracking.calibrate.options import LensSizes
from tsuiseki.tracking.options import OutputFile


def convert(
    file: Path,
    /,
    to: Literal["ocam", "py-ocam", "kalibr-omni", "kalibr-equidistant", "opencv"],
    output: OutputFile,
    sizes: LensSizes,
) -> None:
    """The calibration of a fisheye lens in the format of another program, and how far that puts pixels off.

    Args:
        file: calib_results.txt of OCamCalib, JSON of py-OCamCalib, camchain YAML of Kalibr (omni with radtan, or
            pinhole with equidistant), or OpenCV's fisheye K and D; which one is seen from what is there.
        to: the format to write. ocam and py-ocam hold Scaramuzza's model, which every file is read as; of the others
            the nearest lens is fitted.
        image_size: WIDTH,HEIGHT of the calibration, where the file does not say, as py-OCamCalib's.
        resize: WIDTH,HEIGHT of other images of the camera, to which the calibration is scaled.
    """
    import numpy as np

    from tsuiseki.tracking.cameras.lens_files import write_lens
    from tsuiseki.tracking.cameras.lens_fitting import inverse_error

    lens, read = sizes.read(file)
    written = output.write(output.out, lambda path: write_lens(path, lens, to))
    steps = (
        [(to, written)]
        if not read.any()
        else [(f"{file.name} as Scaramuzza's model", read), (f"that as {to}", written)]
    )
    for name, residuals in steps:
        mean = float(np.sqrt(np.mean(residuals**2)))
        print(f"{name}: {_pixels(mean)} px rms, {_pixels(residuals.max())} px at most over the image")
    if len(lens.inverse):
        print(f"its inverse polynomial: {_pixels(inverse_error(lens))} px at most from the exact root")
    print(f"{lens.width}x{lens.height}: {output.out}")


def _pixels(length: float) -> str:
    """Four decimals, or the order of magnitude where these would all be 0."""
    return f"{length:.4f}" if length >= 1e-4 or length == 0 else f"{length:.0e}"
