"""`tsuiseki calibrate checkerboard`."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking.cameras.checkerboard import Coefficients
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.options import OutputFile

INTRINSICS_FILE = OutputFile(out=Path("intrinsics.yaml"))


def checkerboard(
    source: str,
    /,
    corners: tuple[int, int],
    output: OutputFile = INTRINSICS_FILE,
    coefficients: Coefficients = 5,
    every: int = 1,
) -> None:
    """A camera's focal length and lens from pictures of a checkerboard, for `calibrate points --intrinsics`.

    Args:
        source: a folder of pictures or a video of one camera, the board in different places and tilts.
        corners: ACROSS,DOWN inner corners of the board: a board of 10x7 squares has 9,6.
        out: the file to write, as OpenCV writes intrinsics.
        coefficients: of the lens: 5 for usual lenses, 8 or 12 for wide ones.
        every: use every so many frames of a video.
    """
    from tsuiseki.tracking.calibrate.checkerboard_files import calibrate_from_checkerboards
    from tsuiseki.tracking.cameras.intrinsic_files import write_intrinsics
    from tsuiseki.tracking.cli.progress import progress

    if min(corners) < 3 or corners[0] == corners[1] or every < 1:
        shown = f"{corners[0]},{corners[1]} and {every}"
        raise RequestError(f"`corners`: expected two different numbers from 3, and `every` from 1, got {shown}")
    fit, used, seen = calibrate_from_checkerboards(
        source, corners, coefficients, every, lambda frames: progress(frames, "looking for the board")
    )
    error = float((fit.errors**2).mean() ** 0.5)
    output.write(output.out, lambda path: write_intrinsics(path, fit.intrinsics, error))
    focal, spread = fit.intrinsics.focal, 1.96 * fit.focal_deviation
    worst = int(fit.errors.argmax())
    print(
        f"the board in {len(used)} of {seen} pictures, error {error:.2f} px, worst {fit.errors[worst]:.2f} in picture "
        f"{used[worst]}\nfocal length {focal[0]:.1f} ± {spread[0]:.1f}, {focal[1]:.1f} ± {spread[1]:.1f} px (95 %): "
        f"{output.out}"
    )
