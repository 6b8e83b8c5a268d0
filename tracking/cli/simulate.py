"""`tsuiseki simulate`: labelled video with exact truth."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar

from tsuiseki.tracking.cli.options import SeededOutput, Shared
from tsuiseki.tracking.cli.progress import progress
from tsuiseki.tracking.errors import RequestError

T = TypeVar("T")
LARGEST, LONGEST = 16_384, 1_000_000


@dataclass(frozen=True)
class Clip(Shared):
    """How much is drawn.

    Attributes:
        frames: length of the clip.
        width: of the images, pixels.
        height: of the images, pixels.
    """

    frames: int
    width: int = 640
    height: int = 480

    def check(self) -> None:
        """See `Shared.check`."""
        for name, most in (("frames", LONGEST), ("width", LARGEST), ("height", LARGEST)):
            if not 1 <= getattr(self, name) <= most:
                raise RequestError(f"`{name}`: expected 1 to {most}, got {getattr(self, name)}")

    def watch(self, drawn: Iterable[T]) -> Iterator[T]:
        """Pass frames through and show how many went by."""
        return progress(drawn, "drawing", self.frames)

    def report(self, output: SeededOutput) -> None:
        """Say what was written."""
        print(f"{self.frames} frames of {self.width}x{self.height}: {output.out}")


def street(
    output: SeededOutput, clip: Clip = Clip(200), frame_rate: float = 25.0, people: int = 10, occluders: int = 7
) -> None:
    """Make a clip of people walking on a street, before a fixed camera, as a MOTChallenge sequence.

    Args:
        out: folder for the sequence; gets img1/000001.jpg and so on, gt/gt.txt and seqinfo.ini.
        frame_rate: frames per second.
        people: about how many are around at a time.
        occluders: poles, bushes, parked cars and the like that may hide them.
    """
    from tsuiseki.datamodules.scenes.street.street import StreetSettings, write_street

    size = dataclasses.asdict(clip)
    settings = StreetSettings(**size, frame_rate=frame_rate, people=people, occluders=occluders)
    write_street(output.out, settings, output.seed, output.overwrite, watch=clip.watch)
    clip.report(output)


def blobs(
    output: SeededOutput,
    clip: Clip = Clip(150),
    frame_rate: float = 25.0,
    objects: int = 5,
    colour: str = "red",
    purity: tuple[float, float] = (0.45, 0.95),
    clutter: int = 12,
) -> None:
    """Make a clip of coloured objects moving over natural clutter, as a MOTChallenge sequence.

    Args:
        out: folder for the sequence; gets img1/000001.jpg and so on, gt/gt.txt and seqinfo.ini.
        frame_rate: frames per second.
        objects: how many appear in all.
        colour: of the objects: red, orange, yellow, green, cyan, blue or magenta.
        purity: least and greatest share of an object's pixels that has the colour.
        clutter: patches of the same colour, smaller than objects, in the background.
    """
    from tsuiseki.datamodules.scenes.points.blobs import BlobSceneSettings, write_blobs

    size = clip.frames, clip.width, clip.height
    settings = BlobSceneSettings(*size, frame_rate, objects, colour, purity, clutter=clutter)
    write_blobs(output.out, settings, output.seed, output.overwrite)
    clip.report(output)


def drone(
    output: SeededOutput,
    clip: Clip = Clip(300, 1280, 720),
    frame_rate: float = 30.0,
    people: int = 9,
    camera: Literal["still", "calm", "violent"] = "violent",
    altitude: tuple[float, float] = (10.0, 45.0),
    tilt: tuple[float, float] = (45.0, 90.0),
    look_alikes: float = 0.3,
    layout: Literal["mot", "okutama"] = "mot",
) -> None:
    """Make a clip of people who act under a drone, with a box, an id and one or two actions each in every frame.

    Args:
        out: folder for the clip; gets img1/000001.jpg and so on, gt/gt.txt, gt/actions.txt and seqinfo.ini.
        frame_rate: frames per second.
        people: that act in view.
        camera: how much the drone moves.
        altitude: lowest and highest, metres.
        tilt: flattest and steepest view under the horizon, degrees.
        look_alikes: share of people dressed much like somebody else.
        layout: mot is a MOTChallenge sequence with gt/actions.txt as Okutama-Action's; okutama is that data set's own.
    """
    from tsuiseki.datamodules.scenes.drone.clip import DroneSceneSettings
    from tsuiseki.datamodules.scenes.drone.files import write_drone

    settings = DroneSceneSettings(
        **dataclasses.asdict(clip),
        frame_rate=frame_rate,
        people=people,
        camera=camera,
        altitude=altitude,
        tilt=tilt,
        look_alikes=look_alikes,
    )
    write_drone(output.out, settings, output.seed, output.overwrite, watch=clip.watch, layout=layout)
    clip.report(output)


def fisheye(
    output: SeededOutput,
    clip: Clip = Clip(900, 1280, 960),
    room: Literal["large", "small"] = "large",
    frame_rate: float = 15.0,
    people: int = 6,
    repeated: float = 0.5,
    calibration: Path | None = None,
) -> None:
    """Make a clip of people in a room under two fisheye cameras on its ceiling, with their boxes and places.

    DIR gets camera1 and camera2, MOTChallenge sequences with img1, gt/gt.txt and gt/world.csv (frame, id, x, y in
    metres), the ids the same in both, and cameras.yaml for tsuiseki track fisheye.

    Args:
        out: folder for the clip.
        room: large is 8 by 16 m, small 4 by 9 m.
        frame_rate: frames per second.
        people: who wander about.
        repeated: share of people who wear the clothes of another, or nearly.
        calibration: lens of the cameras, enlarged to fill the images; by default an equidistant one.
    """
    from tsuiseki.datamodules.scenes.rooms.ceiling import SIZES, RoomSettings
    from tsuiseki.datamodules.scenes.rooms.files import write_room
    from tsuiseki.tracking.cameras.lens_files import read_lens

    settings = RoomSettings(
        **dataclasses.asdict(clip), size=SIZES[room], frame_rate=frame_rate, people=people, repeated=repeated
    )
    lens = None if calibration is None else read_lens(calibration)
    write_room(output.out, settings, output.seed, lens, output.overwrite, watch=clip.watch)
    clip.report(output)


def goldfish(
    output: SeededOutput,
    clip: Clip = Clip(150),
    body: Literal["goldfish", "ball"] = "goldfish",
    count: int | None = None,
    frame_rate: float | None = None,
) -> None:
    """Make a clip of goldfish seen from above, or of balls that squash where they bounce, with exact states.

    DIR gets img1/000001.jpg and so on, states.csv (frame,id,a,b,theta,phi: centre in pixels, heading and bend in
    radians; for balls frame,id,a,b,theta,squash), silhouettes/000001.png and so on (the body lies at a pixel where bit
    id - 1 is set) and seqinfo.ini.

    Args:
        out: folder for the clip.
        body: what moves, goldfish or ball.
        count: how many, 1 to 5; by default three fish or one ball.
        frame_rate: frames per second; by default 15 for fish and 30 for balls.
    """
    from tsuiseki.datamodules.scenes.ball.bouncing import BouncingBallSettings, write_balls
    from tsuiseki.datamodules.scenes.fish.goldfish import GoldfishSettings, write_goldfish

    size, to = (clip.frames, clip.width, clip.height), (output.seed, output.overwrite, clip.watch)
    if body == "ball":
        balls = BouncingBallSettings(*size, 30.0 if frame_rate is None else frame_rate, 1 if count is None else count)
        write_balls(output.out, balls, *to)
    else:
        fish = GoldfishSettings(*size, 15.0 if frame_rate is None else frame_rate, 3 if count is None else count)
        write_goldfish(output.out, fish, *to)
    clip.report(output)


def sphere(
    output: SeededOutput,
    cameras: int = 2,
    frames: int = 100,
    frame_rate: float = 15.0,
    radius: float = 0.10,
    noise: float = 3.0,
    cover: tuple[int, int, int] | None = None,
) -> None:
    """Film a ball that a walking person carries through a textured room, from two to six sides.

    Args:
        out: folder; gets camera1/000001.jpg and so on, background1.png, cameras.yaml and truth.csv.
        cameras: 2 to 6, each 800x600 pixels with a field of 60 degrees.
        frames: of each camera.
        frame_rate: frames per second.
        radius: of the ball, metres.
        noise: of the sensor, standard deviation in grey levels of 255.
        cover: CAMERA,FIRST,LAST: a board hides the view of that camera in these frames, counted from 1.
    """
    from tsuiseki.datamodules.scenes.ball.carried import CarriedBallSettings, Cover
    from tsuiseki.datamodules.scenes.ball.files import write_ball
    from tsuiseki.tracking.output import RunRecord, output_folder

    covers: tuple[Cover, ...] = ()
    if cover is not None:
        if not (1 <= cover[0] <= cameras and 1 <= cover[1] <= cover[2]):
            raise RequestError(f"`cover`: expected CAMERA,FIRST,LAST counted from 1, got {','.join(map(str, cover))}")
        covers = (Cover(cover[0] - 1, cover[1] - 1, cover[2] - 1),)
    try:
        settings = CarriedBallSettings(cameras, frames, frame_rate, radius, noise=noise, covers=covers)
    except ValueError as error:
        raise RequestError(str(error)) from error
    with output_folder(output.out, output.overwrite) as work:
        write_ball(work, settings, output.seed, lambda items: progress(items, "filming", frames))
        RunRecord(("tsuiseki", "simulate", "sphere"), dataclasses.asdict(settings), output.seed).write(work)
    print(f"{frames} frames of {cameras} cameras: {output.out}")
