"""`tsuiseki calibrate`: where cameras are and how they see; a function for each command."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.cameras.calibration import (
    Calibration,
    Coefficients,
    calibrate_camera,
    find_corners,
    fit_checkerboards,
    locate_camera,
    locate_over_floor,
    pose_at,
)
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.fields import Commas, FrameRate, Options
from tsuiseki.tracking.formats.world_tables import Correspondences, read_correspondences, read_floor_points
from tsuiseki.tracking.output import check_output_file
from tsuiseki.tracking.runs.options import OutputFile, PlottedFile
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.video.source import open_source

if TYPE_CHECKING:
    from tsuiseki.tracking.cameras.camera_files import AnyCamera
    from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalLens

# Pixels from which on a lens is none for a format.
FAR = 50.0
# Metres of the floor to each side of a camera.
REACH = 10.0
Pixels: TypeAlias = Commas[tuple[PositiveInt, PositiveInt] | None]


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class CameraFile(OutputFile):
    """The camera file.

    Attributes:
        out: the camera file to write.
    """

    out: Path = Path("cameras.yaml")


CAMERA_FILE = CameraFile()


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class ImageSize(Options):
    """Of the calibration.

    Attributes:
        image_size: WIDTH,HEIGHT of the calibration's images, where its file does not say.
    """

    image_size: Pixels = None


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class LensSizes(ImageSize):
    """Of the calibration, and of the images that it is used on.

    Attributes:
        resize: WIDTH,HEIGHT of the images, where it is not the calibration's, which is then cut and scaled.
    """

    resize: Pixels = None

    def read(self, file: Path) -> tuple[OmnidirectionalLens, FloatArray]:
        """The fisheye lens in ``file``, for images of the wanted size; and see `read_lens_fitted`."""
        from tsuiseki.tracking.cameras.lens_files import read_lens_fitted

        lens, residuals = read_lens_fitted(file, self.image_size)
        return (lens if self.resize is None else lens.resized(*self.resize, "cut")), residuals


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
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

    height: PositiveFloat | None = None
    tilt: float = 0.0
    turn: float = 0.0
    points: Path | None = None
    projective: bool = False

    def check(self) -> None:
        """Refuse a pose that is not told in one way; raises RequestError."""
        if (self.height is None) == (self.points is None):
            raise RequestError("expected one of `height` and `points`, got both or neither")
        if self.projective and self.resize is not None:
            raise RequestError("`resize`: only fisheye calibrations are scaled; leave it out with `projective`")

    def camera(self, file: Path) -> tuple[AnyCamera, list[str]]:
        """The camera whose lens is in ``file``, in its place, and lines that say how well points of the floor fit."""
        self.check()
        from tsuiseki.tracking.cameras.lens_files import read_intrinsics
        from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera

        camera: AnyCamera
        if self.projective:
            camera = read_intrinsics(file, self.image_size)
        else:
            camera = OmnidirectionalCamera(self.read(file)[0], np.eye(3), np.zeros(3))
        if self.points is None:
            return pose_at(camera, self.height or 0.0, np.radians(self.tilt), np.radians(self.turn)), []
        known_points = read_floor_points(self.points)
        try:
            camera, residuals, away = locate_over_floor(camera, known_points.pixels, known_points.points[:, :2])
        except RequestError as error:
            raise RequestError(f"{self.points}: {error}") from error
        rows = zip(known_points.lines, residuals, away, strict=True)
        lines = [f"  line {line}: {pixels:.3f} px, {metres:.3f} m" for line, pixels, metres in rows]
        return camera, [f"{np.sqrt(np.mean(residuals**2)):.3f} px rms over {len(lines)} points", *lines]


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class VideoRate(Options):
    """Of the videos.

    Attributes:
        frame_rate: frames per second, for videos that do not tell: folders of images.
    """

    frame_rate: FrameRate | None = None


SIZE, SIZES, POSE, RATE = ImageSize(), LensSizes(), FloorPose(), VideoRate()


def points(
    file: Path,
    *,
    size: ImageSize = SIZE,
    rate: VideoRate = RATE,
    output: CameraFile = CAMERA_FILE,
    intrinsics: Commas[list[Path] | None] = None,
) -> None:
    """Calibrate cameras from six or more known points each, and write cameras.yaml.

    Args:
        file: CSV with the columns x, y, z (metres, z up), u, v (pixels, the first pixel's centre at 0.5) and, for
            several cameras, camera.
        size.image_size: WIDTH,HEIGHT of the images; not needed where the intrinsics say.
        intrinsics: one calibration file of OpenCV or ROS per camera (or one for all), separated by commas; only the
            pose is fitted then, and the lens may distort.
    """
    from tsuiseki.tracking.cameras.camera_files import PlacedCamera, write_cameras

    groups = read_correspondences(file)
    fits = _fitted(file, groups, size.image_size, intrinsics)
    placed = [PlacedCamera(group.camera, fit.camera, rate.frame_rate) for group, fit in zip(groups, fits, strict=True)]
    output.write(output.out, lambda path: write_cameras(path, placed))
    lines = []
    for group, fit in zip(groups, fits, strict=True):
        deviations = 1.96 * np.sqrt(np.diag(fit.covariance))
        place = ", ".join(f"{v:.3f} ± {s:.3f}" for v, s in zip(fit.camera.position, deviations, strict=True))
        lines.append(f"{group.camera}: {len(group.points)} points, {fit.root_mean_square:.3f} px rms, at {place} m")
        worst = int(np.argmax(fit.residuals))
        for row, (line, residual) in enumerate(zip(group.lines, fit.residuals, strict=True)):
            lines.append(f"  line {line}: {residual:.3f} px" + ("  largest" if row == worst else ""))
    # After the file, which must not depend on who reads the listing to its end.
    print("\n".join([*lines, f"{len(placed)} cameras: {output.out}"]))


def _fitted(
    file: Path,
    groups: Sequence[Correspondences],
    image_size: tuple[int, int] | None,
    intrinsics: Sequence[Path] | None,
) -> list[Calibration]:
    """The camera of each group of points in ``file``; of known ``intrinsics``, of each or of all, the pose alone.

    Raises:
        RequestError: neither size nor intrinsics are given, there is another number of these, or points leave a camera
            open.
    """
    from tsuiseki.tracking.cameras.lens_files import read_intrinsics

    if intrinsics is None and image_size is None:
        raise RequestError("expected `image_size` WIDTH,HEIGHT or `intrinsics`, got neither")
    if intrinsics is not None and len(intrinsics) not in (1, len(groups)):
        raise RequestError(f"`intrinsics`: expected 1 file or {len(groups)}, one a camera, got {len(intrinsics)}")
    fits = []
    for number, group in enumerate(groups):
        try:
            if intrinsics is not None:
                lens = read_intrinsics(intrinsics[number % len(intrinsics)], image_size)
                fits.append(locate_camera(group.points, group.pixels, lens))
            elif image_size is not None:
                fits.append(calibrate_camera(group.points, group.pixels, *image_size))
        except RequestError as error:
            raise RequestError(f"{file}: {group.camera}: {error}") from error
    return fits


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class IntrinsicsFile(OutputFile):
    """The lens of a camera.

    Attributes:
        out: the file to write, as OpenCV writes intrinsics.
    """

    out: Path = Path("intrinsics.yaml")


INTRINSICS_FILE = IntrinsicsFile()


def checkerboard(
    source: str,
    *,
    corners: Commas[tuple[Annotated[int, Field(ge=3)], Annotated[int, Field(ge=3)]]],
    output: IntrinsicsFile = INTRINSICS_FILE,
    coefficients: Coefficients = 5,
    every: PositiveInt = 1,
) -> None:
    """Measure focal length and lens from pictures of a checkerboard, for `calibrate points --intrinsics`.

    Args:
        source: a folder of pictures or a video of one camera, the board in different places and tilts.
        corners: ACROSS,DOWN inner corners of the board: a board of 10x7 squares has 9,6.
        coefficients: of the lens: 5 for usual lenses, 8 or 12 for wide ones.
        every: use every so many frames of a video.
    """
    from tsuiseki.tracking.cameras.lens_files import write_intrinsics
    from tsuiseki.tracking.runs.progress import progress

    if corners[0] == corners[1]:
        raise RequestError(f"`corners`: expected two different numbers, got {corners[0]} twice")
    detections: list[FloatArray] = []
    used: list[int] = []
    size: tuple[int, int] | None = None
    pictures = 0
    for frame in progress(open_source(source).frames(), "detecting the board"):
        if frame.index % every:
            continue
        pictures += 1
        height, width = frame.image.shape[:2]
        if size not in (None, (width, height)):
            raise RequestError(f"{source}: expected pictures of one size, got {size} and {(width, height)}")
        size = (width, height)
        places = find_corners(frame.image, corners)
        if places is not None:
            detections.append(places)
            used.append(frame.index + 1)
    if size is None:
        raise RequestError(f"{source}: expected pictures, found none")
    camera, errors, deviation = fit_checkerboards(detections, corners, size, coefficients)
    error = float((errors**2).mean() ** 0.5)
    output.write(output.out, lambda path: write_intrinsics(path, camera, error))
    focal, spread = camera.focal, 1.96 * deviation
    worst = int(errors.argmax())
    print(
        f"the board in {len(used)} of {pictures} pictures, error {error:.2f} px, worst {errors[worst]:.2f} in "
        f"picture {used[worst]}\nfocal length {focal[0]:.1f} ± {spread[0]:.1f}, {focal[1]:.1f} ± {spread[1]:.1f} px "
        f"(95 %): {output.out}"
    )


def convert(
    file: Path,
    *,
    to: Literal["ocam", "py-ocam", "kalibr-omni", "kalibr-equidistant", "opencv"],
    output: OutputFile,
    sizes: LensSizes = SIZES,
) -> None:
    """Convert a fisheye lens's calibration to another program's format, and print the error in pixels.

    Args:
        file: calib_results.txt of OCamCalib, JSON of py-OCamCalib, camchain YAML of Kalibr (omni with radtan, or
            pinhole with equidistant), ROS's camera YAML (equidistant), or OpenCV's fisheye K and D or omnidir with xi;
            which one is recognised by its content.
        to: the format to write. ocam and py-ocam hold Scaramuzza's model, which every file is read as; of the others
            the nearest lens is fitted.
        sizes.image_size: WIDTH,HEIGHT of the calibration, where the file does not say, as py-OCamCalib's.
        sizes.resize: WIDTH,HEIGHT of other images of the camera, to which the calibration is scaled.
    """
    from tsuiseki.tracking.cameras.lens_files import write_lens
    from tsuiseki.tracking.cameras.lens_fitting import inverse_error

    lens, read = sizes.read(file)

    def write(path: Path) -> FloatArray:
        residuals = write_lens(path, lens, to)
        if (mean := float(np.sqrt(np.mean(residuals**2)))) > FAR:
            raise RunError(f"the nearest lens of {to} lies {mean:.0f} px rms away; choose another format with `to`")
        return residuals

    written = output.write(output.out, write)
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


def pose(
    file: Path,
    *,
    place: FloorPose = POSE,
    rate: VideoRate = RATE,
    output: CameraFile = CAMERA_FILE,
    floor: Commas[tuple[float, float, float, float] | None] = None,
    name: str = "camera1",
    stand: Commas[tuple[float, float] | None] = None,
    person_height: PositiveFloat = 1.7,
) -> None:
    """Find where a camera of known lens hangs over the floor, and write cameras.yaml.

    Either --height, or --points on the floor. Several cameras go into one file by joining their lists.

    Args:
        file: the lens, in any format that tsuiseki calibrate convert reads, or with --projective OpenCV's or ROS's
            intrinsics.
        floor: X1,Y1,X2,Y2 of the floor that people stand on, metres; by default 10 m about the camera.
        name: of the camera.
        stand: X,Y on the floor, metres, where somebody stands: also print the upright and the rotated box that the
            model of a person has there, to compare with a picture.
        person_height: height of the model of a person, metres.
    """
    from tsuiseki.tracking.cameras.camera_files import CameraOverFloor, write_cameras
    from tsuiseki.tracking.cameras.person_model import PersonModel, check_height
    from tsuiseki.tracking.cameras.person_model import stand as boxes_of

    camera, lines = place.camera(file)
    if not place.projective:
        # The person of `track fisheye` stands under its camera; a projective one may look from the side.
        check_height(camera, PersonModel(height=person_height))
    # Adding zero makes a plain zero of a negative one.
    x, y, z = (camera.position.round(6) + 0.0).tolist()
    area = np.array([x - REACH, y - REACH, x + REACH, y + REACH] if floor is None else floor, dtype=np.float64)
    if area[0] >= area[2] or area[1] >= area[3]:
        raise RequestError(f"`floor`: expected X1 < X2 and Y1 < Y2, got {','.join(f'{v:g}' for v in area)}")
    if stand is not None:
        upright, rotated = boxes_of(camera, np.array(stand), area, PersonModel(height=person_height))
        corners = ",".join(f"{value:.1f}" for value in upright)
        turned = ",".join(f"{value:.1f}" for value in (*rotated[:4], np.degrees(rotated[4])))
        lines.append(
            f"{person_height:g} m tall at {stand[0]:g},{stand[1]:g}: upright {corners} (x1,y1,x2,y2), rotated {turned} "
            "(cx,cy,w,h,degrees clockwise)"
        )
    placed = CameraOverFloor(name, camera, rate.frame_rate, floor=area)
    output.write(output.out, lambda path: write_cameras(path, [placed]))
    print("\n".join([*lines, f"{name}: at {x:.3f}, {y:.3f}, {z:.3f} m: {output.out}"]))


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class PeopleFiles(PlottedFile):
    """What comes out of people.

    Attributes:
        cameras: cameras.yaml to check against the people, a camera for each source in order; then nothing is written
            unless --out is given.
        out: the camera file to write; cameras.yaml, where there is nothing to check.
        plot: also draw the plan of the floor into this file (PNG, SVG or PDF).
    """

    cameras: Path | None = None
    out: Path | None = None  # type: ignore[assignment]

    def check(self) -> None:
        super().check()
        if self.target is not None:
            check_output_file(self.target, self.overwrite)

    @property
    def target(self) -> Path | None:
        """The camera file to write."""
        return self.out or (None if self.cameras else CAMERA_FILE.out)


PEOPLE_FILES = PeopleFiles()


def people(
    sources: list[str],
    *,
    size: ImageSize = SIZE,
    output: PeopleFiles = PEOPLE_FILES,
    person_height: PositiveFloat = 1.7,
    reach: PositiveFloat = 30.0,
    fps: Commas[list[FrameRate] | None] = None,
) -> None:
    """Cameras from the people who walk in them: focal length, height, tilt; of several, place on one floor and clock.

    Args:
        sources: for each camera a result folder of track people, a file of tracks, or a video, which is tracked first.
        size.image_size: WIDTH,HEIGHT of the pictures, where a source does not say.
        person_height: of people on average, metres.
        reach: largest difference of two cameras' clocks, seconds.
        fps: frames a second, where a source does not say; one number, or one a source, separated by commas.
    """
    from tsuiseki.tracking.calibrate.people import calibrate_people, check_cameras

    calibration = calibrate_people(sources, person_height, reach, fps, size.image_size)
    lines = calibration.described()
    if output.cameras is not None:
        lines += [str(disagreement) for disagreement in check_cameras(output.cameras, calibration)]
    if output.target is not None:
        output.write(output.target, calibration.write)
        lines.append(f"{len(calibration.views)} cameras: {output.target}")
    output.draw(lambda path: calibration.plan().savefig(path, dpi=150, facecolor="white"))
    print("\n".join(lines))
