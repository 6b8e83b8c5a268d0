"""`tsuiseki simulate`: generated clips with exact truth, and rendered people."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

from pydantic import Field, PositiveInt
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS, Share
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.fields import Commas, Options
from tsuiseki.tracking.runs.options import SeededOutput
from tsuiseki.tracking.runs.progress import progress

T = TypeVar("T")
Side: TypeAlias = Annotated[int, Field(ge=1, le=16_384)]
Frames: TypeAlias = Annotated[int, Field(ge=1, le=1_000_000)]
Rate: TypeAlias = Annotated[float, Field(gt=0, le=240)]
# More would be planned for hours.
Crowd: TypeAlias = Annotated[int, Field(ge=0, le=100)]
Things: TypeAlias = Annotated[int, Field(ge=0, le=200)]


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class Length(Options):
    """How long is drawn.

    Attributes:
        frames: length of the clip.
    """

    frames: Frames = 100


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class Size(Length):
    """How much is drawn.

    Attributes:
        width: of the images, pixels.
        height: of the images, pixels.
    """

    frames: Frames = 150
    width: Side = 640
    height: Side = 480


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class FilmSize(Size):
    """How much is drawn, and how fast.

    Attributes:
        frame_rate: frames per second.
    """

    frame_rate: Rate = 25.0


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class StreetSize(FilmSize):
    """A clip of the street."""

    frames: Frames = 200


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class DroneSize(FilmSize):
    """A clip of a drone."""

    frames: Frames = 300
    width: Side = 1280
    height: Side = 720
    frame_rate: Rate = 30.0


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class FloorSize(FilmSize):
    """Clips of the cameras over a floor."""

    frames: Frames = 300
    width: Side = 1280
    height: Side = 960
    frame_rate: Rate = 10.0


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class FisheyeSize(FloorSize):
    """Clips of ceiling cameras."""

    frames: Frames = 900
    frame_rate: Rate = 15.0


STREET, BLOBS, DRONE, FLOOR = StreetSize(), FilmSize(), DroneSize(), FloorSize()
FISHEYE, GOLDFISH, SPHERE = FisheyeSize(), Size(), Length()


def street(
    *,
    output: SeededOutput,
    clip: StreetSize = STREET,
    people: Crowd = 10,
    motion: Literal["walk", "dance", "sport"] = "walk",
) -> int:
    """Make a clip of people on a street, before a fixed camera, as a MOTChallenge sequence.

    Args:
        output.out: folder for the sequence; gets img1/000001.jpg and so on, gt/gt.txt and seqinfo.ini.
        people: about how many are around at a time.
        motion: people walk, dance in step, or as in sport run fast and turn at once.
    """
    from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings

    settings = StreetSettings(**asdict(clip), people=people, motion=motion)
    return _make(output, clip, partial(StreetClip, settings, output.seed))


def blobs(
    *,
    output: SeededOutput,
    clip: FilmSize = BLOBS,
    objects: Things = 5,
    colour: Literal["red", "orange", "yellow", "green", "cyan", "blue", "magenta"] = "red",
    clutter: Annotated[int, Field(ge=0, le=1000)] = 12,
) -> int:
    """Make a clip of coloured objects moving over natural clutter, as a MOTChallenge sequence.

    Args:
        output.out: folder for the sequence; gets img1/000001.jpg and so on, gt/gt.txt and seqinfo.ini.
        objects: how many appear in all.
        colour: of the objects.
        clutter: patches of the same colour, smaller than objects, in the background.
    """
    from tsuiseki.datamodules.scenes.blob_clip import BlobClip, BlobSceneSettings

    settings = BlobSceneSettings(**asdict(clip), objects=objects, colour=colour, clutter=clutter)
    return _make(output, clip, partial(BlobClip, settings, output.seed))


def drone(
    *,
    output: SeededOutput,
    clip: DroneSize = DRONE,
    people: Crowd = 9,
    camera: Literal["still", "calm", "violent"] = "violent",
    tilt: Commas[tuple[float, float]] = (45.0, 90.0),
    look_alikes: Share = 0.3,
) -> int:
    """Make a clip of people who act under a drone, with a box, an id and one or two actions each in every frame.

    Args:
        output.out: folder for the clip; gets img1/000001.jpg and so on, gt/gt.txt, gt/actions.txt and seqinfo.ini.
        people: that act in view.
        camera: how much the drone moves.
        tilt: flattest and steepest view under the horizon, degrees.
        look_alikes: share of people dressed much like somebody else.
    """
    from tsuiseki.datamodules.scenes.drone_clip import DroneClip, DroneSceneSettings

    settings = DroneSceneSettings(**asdict(clip), people=people, camera=camera, tilt=tilt, look_alikes=look_alikes)
    return _make(output, clip, partial(DroneClip, settings, output.seed))


def fisheye(
    *,
    output: SeededOutput,
    clip: FisheyeSize = FISHEYE,
    room: Literal["large", "small"] = "large",
    people: Crowd = 6,
    calibration: Path | None = None,
) -> int:
    """Make a clip of people in a room under two fisheye cameras on its ceiling, with their boxes and places.

    DIR gets camera1 and camera2, MOTChallenge sequences with img1, gt/gt.txt and gt/world.csv (frame, id, x, y in
    metres), the ids the same in both, and cameras.yaml for tsuiseki track fisheye.

    Args:
        output.out: folder for the clip.
        room: large is 8 by 16 m, small 4 by 9 m.
        people: who wander about.
        calibration: lens of the cameras, enlarged to fill the images; by default an equidistant one.
    """
    from tsuiseki.datamodules.scenes.room_clip import SIZES, RoomClip, RoomSettings
    from tsuiseki.tracking.cameras.lens_files import read_lens

    settings = RoomSettings(**asdict(clip), size=SIZES[room], people=people)
    lens = None if calibration is None else read_lens(calibration)
    return _make(output, clip, partial(RoomClip, settings, output.seed, lens))


def floor(
    *,
    output: SeededOutput,
    clip: FloorSize = FLOOR,
    cameras: Annotated[int, Field(ge=3, le=7)] = 4,
    people: Crowd = 8,
    look_alikes: Share = 0.5,
) -> int:
    """Make a clip of people on one floor before several cameras, on walls and fisheye ones on the ceiling.

    DIR gets camera1 and so on, MOTChallenge sequences with img1, gt/gt.txt and gt/world.csv (frame, id, x, y in
    metres), the ids the same in all, cameras.yaml for tsuiseki track floor, and truth.csv (time, id, x, y in seconds
    and metres) of everybody for tsuiseki evaluate floor.

    Args:
        output.out: folder for the clip.
        cameras: 3 to 7; the second and the fourth are the fisheye ones.
        people: who wander about, at times behind pillars.
        look_alikes: share of people who wear the clothes of another, or nearly.
    """
    from tsuiseki.datamodules.scenes.room_clip import FloorClipSettings, RoomClip

    settings = FloorClipSettings(**asdict(clip), people=people, repeated=look_alikes, cameras=cameras)
    return _make(output, clip, partial(RoomClip, settings, output.seed), f" of {cameras} cameras")


def goldfish(
    *,
    output: SeededOutput,
    size: Size = GOLDFISH,
    body: Literal["goldfish", "ball"] = "goldfish",
    count: Annotated[int, Field(ge=1, le=5)] | None = None,
    frame_rate: Rate | None = None,
) -> int:
    """Make a clip of goldfish seen from above, or of balls that squash where they bounce, with exact states.

    DIR gets img1/000001.jpg and so on, states.csv (frame,id,a,b,theta,phi: centre in pixels, heading and bend in
    radians; for balls frame,id,a,b,theta,squash), silhouettes/000001.png and so on (the body lies at a pixel where bit
    id - 1 is set) and seqinfo.ini.

    Args:
        output.out: folder for the clip.
        body: what moves, goldfish or ball.
        count: how many, 1 to 5; by default three fish or one ball.
        frame_rate: frames per second; by default 15 for fish and 30 for balls.
    """
    from tsuiseki.datamodules.scenes.body_clip import BouncingBallSettings, BouncingClip
    from tsuiseki.datamodules.scenes.goldfish_clip import GoldfishClip, GoldfishSettings

    rate: dict[str, Any] = {} if frame_rate is None else {"frame_rate": frame_rate}
    if body == "ball":
        balls = BouncingBallSettings(**asdict(size), **rate, balls=1 if count is None else count)
        return _make(output, size, partial(BouncingClip, balls, output.seed))
    fish = GoldfishSettings(**asdict(size), **rate, fish=3 if count is None else count)
    return _make(output, size, partial(GoldfishClip, fish, output.seed))


def sphere(
    *,
    output: SeededOutput,
    length: Length = SPHERE,
    cameras: Annotated[int, Field(ge=2, le=6)] = 2,
    frame_rate: Rate = 15.0,
    radius: Annotated[float, Field(gt=0, le=0.5)] = 0.10,
    cover: Commas[tuple[int, int, int] | None] = None,
) -> int:
    """Film a ball that a walking person carries through a textured room, from two to six sides.

    Args:
        output.out: folder; gets camera1/000001.jpg and so on, background1.png, cameras.yaml and truth.csv.
        cameras: 2 to 6, each 800x600 pixels with a field of 60 degrees.
        length.frames: of each camera.
        frame_rate: frames per second.
        radius: of the ball, metres.
        cover: CAMERA,FIRST,LAST: a board hides the view of that camera in these frames, counted from 1.
    """
    from tsuiseki.datamodules.scenes.sphere_clip import CarriedBallSettings, SphereClip

    if cover is not None and not (1 <= cover[0] <= cameras and 1 <= cover[1] <= cover[2]):
        raise RequestError(f"`cover`: expected CAMERA,FIRST,LAST counted from 1, got {','.join(map(str, cover))}")
    covers = () if cover is None else ((cover[0] - 1, cover[1] - 1, cover[2] - 1),)
    settings = CarriedBallSettings(cameras, length.frames, frame_rate, radius, covers=covers)
    return _make(output, length, partial(SphereClip, settings, output.seed), f" of {cameras} cameras")


def sprites(
    *,
    output: SeededOutput,
    assets: Path,
    people: PositiveInt = 260,
    views: PositiveInt = 5,
    height: PositiveInt = 256,
    tilts: Commas[tuple[float, float]] = (-0.08, 0.95),
    poses: Share = 0.0,
) -> int:
    """Render people from body meshes and clothes, cut out, to be shown in the pictures that detectors learn from.

    DIR gets two pictures of each view, colours and normals, and sprites.csv. Training takes it as data.train's sprites.

    Args:
        output.out: folder for the sprites.
        assets: folder with the unpacked body packages; docs/methods/rendered-people.md says how to get them.
        people: how many.
        views: poses and sides of each.
        height: of a person, pixels.
        tilts: least and greatest angle that cameras look down, radians; 0.2,1.3 for people under drones.
        poses: share of the views, in [0, 1], of people who sit, crouch, kneel, bend, lie, fall, jump, run, carry,
            cycle, push a pram, sit in a wheelchair or hold an umbrella.
    """
    from tsuiseki.datamodules.scenes.figures.library import SpriteSettings, write_sprites

    settings = SpriteSettings(people, views, height, tilts=tilts, poses=poses)
    summary = f"{people} people of {height} pixels in {views} views each"

    def write(folder: Path) -> object:
        return write_sprites(folder, assets, settings, output.seed, watch=_watched("rendering", people))

    return _fill(output, summary, write)


def _make(output: SeededOutput, length: Length, plan: partial[Any], suffix: str = "") -> int:
    """Plan a clip of the settings that ``plan`` holds and let it fill the output folder; ``suffix`` ends the line."""
    from tsuiseki.datamodules.scenes.clip import write_clip

    def write(folder: Path) -> object:
        return write_clip(folder, plan(), watch=_watched("drawing", length.frames))

    size = f" of {length.width}x{length.height}" if isinstance(length, Size) else ""
    return _fill(output, f"{length.frames} frames{size}{suffix}", write)


def _watched(doing: str, count: int) -> Callable[[Iterable[T]], Iterator[T]]:
    """Passes what is drawn through, and shows how much went by."""
    return lambda drawn: progress(drawn, doing, count)


def _fill(output: SeededOutput, what: str, write: Callable[[Path], object]) -> int:
    """Let ``write`` fill the output folder; ``what`` is printed when it is whole."""
    with output.run() as run:
        with run.times.measure("draw"):
            run.fill(write)
        run.done(f"{what}: {output.out}")
    return run.status
