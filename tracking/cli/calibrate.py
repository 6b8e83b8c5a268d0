"""`tsuiseki calibrate`: cameras from measurements."""

from __future__ import annotations

from pathlib import Path

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
