"""`tsuiseki simulate`: labelled video with exact truth."""

from __future__ import annotations

from pathlib import Path
from typing import Literal


def street(
    out: Path,
    frames: int = 200,
    width: int = 640,
    height: int = 480,
    frame_rate: float = 25.0,
    people: int = 10,
    occluders: int = 7,
    seed: int = 0,
    overwrite: bool = False,
) -> None:
    """Make a clip of people walking on a street, before a fixed camera, as a MOTChallenge sequence.

    Args:
        out: folder for the sequence; gets img1/000001.jpg and so on, gt/gt.txt and seqinfo.ini.
        frames: length of the clip.
        width: of the images, pixels.
        height: of the images, pixels.
        frame_rate: frames per second.
        people: about how many are around at a time.
        occluders: poles, bushes, parked cars and the like that may hide them.
        seed: of all random numbers; the same seed makes the same clip.
        overwrite: replace what is in the folder.
    """
    from tsuiseki.datamodules.scenes.street.street import StreetSettings, write_street
    from tsuiseki.tracking.cli.progress import progress

    settings = StreetSettings(
        width=width, height=height, frames=frames, frame_rate=frame_rate, people=people, occluders=occluders
    )
    write_street(out, settings, seed, overwrite, watch=lambda drawn: progress(drawn, "drawing", frames))
    print(f"{frames} frames of {width}x{height}: {out}")


def blobs(
    out: Path,
    frames: int = 150,
    width: int = 640,
    height: int = 480,
    frame_rate: float = 25.0,
    objects: int = 5,
    colour: str = "red",
    purity: tuple[float, float] = (0.45, 0.95),
    clutter: int = 12,
    seed: int = 0,
    overwrite: bool = False,
) -> None:
    """Make a clip of coloured objects moving over natural clutter, as a MOTChallenge sequence.

    Args:
        out: folder for the sequence; gets img1/000001.jpg and so on, gt/gt.txt and seqinfo.ini.
        frames: length of the clip.
        width: of the images, pixels.
        height: of the images, pixels.
        frame_rate: frames per second.
        objects: how many appear in all.
        colour: of the objects: red, orange, yellow, green, cyan, blue or magenta.
        purity: least and greatest share of an object's pixels that has the colour.
        clutter: patches of the same colour, smaller than objects, in the background.
        seed: of all random numbers; the same seed makes the same clip.
        overwrite: replace what is in the folder.
    """
    from tsuiseki.datamodules.scenes.points.blobs import BlobSceneSettings, write_blobs

    settings = BlobSceneSettings(frames, width, height, frame_rate, objects, colour, purity, clutter=clutter)
    folder = write_blobs(out, settings, seed, overwrite)
    print(f"{frames} frames of {width}x{height}: {folder}")


def drone(
    out: Path,
    frames: int = 300,
    width: int = 1280,
    height: int = 720,
    frame_rate: float = 30.0,
    people: int = 9,
    camera: Literal["still", "calm", "violent"] = "violent",
    altitude: tuple[float, float] = (10.0, 45.0),
    tilt: tuple[float, float] = (45.0, 90.0),
    look_alikes: float = 0.3,
    layout: Literal["mot", "okutama"] = "mot",
    seed: int = 0,
    overwrite: bool = False,
) -> None:
    """Make a clip of people who act under a drone, with a box, an id and one or two actions each in every frame.

    Args:
        out: folder for the clip; gets img1/000001.jpg and so on, gt/gt.txt, gt/actions.txt and seqinfo.ini.
        frames: length of the clip.
        width: of the images, pixels.
        height: of the images, pixels.
        frame_rate: frames per second.
        people: that act in view.
        camera: how much the drone moves.
        altitude: lowest and highest, metres.
        tilt: flattest and steepest view under the horizon, degrees.
        look_alikes: share of people dressed much like somebody else.
        layout: mot is a MOTChallenge sequence with gt/actions.txt as Okutama-Action's; okutama is that data set's own.
        seed: of all random numbers; the same seed makes the same clip.
        overwrite: replace what is in the folder.
    """
    from tsuiseki.datamodules.scenes.drone.clip import DroneSceneSettings
    from tsuiseki.datamodules.scenes.drone.files import write_drone
    from tsuiseki.tracking.cli.progress import progress

    settings = DroneSceneSettings(
        width=width,
        height=height,
        frames=frames,
        frame_rate=frame_rate,
        people=people,
        camera=camera,
        altitude=altitude,
        tilt=tilt,
        look_alikes=look_alikes,
    )
    write_drone(out, settings, seed, overwrite, watch=lambda drawn: progress(drawn, "drawing", frames), layout=layout)
    print(f"{frames} frames of {width}x{height}: {out}")


def fisheye(
    out: Path,
    room: Literal["large", "small"] = "large",
    people: int = 6,
    seconds: float = 60.0,
    frame_rate: float = 15.0,
    repeated: float = 0.5,
    calibration: Path | None = None,
    width: int = 1280,
    height: int = 960,
    seed: int = 0,
    overwrite: bool = False,
) -> None:
    """Make a clip of people in a room under two fisheye cameras on its ceiling, with their boxes and places.

    DIR gets camera1 and camera2, MOTChallenge sequences with img1, gt/gt.txt and gt/world.csv (frame, id, x, y in
    metres), the ids the same in both, and cameras.yaml for tsuiseki track fisheye.

    Args:
        out: folder for the clip.
        room: large is 8 by 16 m, small 4 by 9 m.
        people: who wander about.
        seconds: length of the clip.
        frame_rate: frames per second.
        repeated: share of people who wear the clothes of another, or nearly.
        calibration: lens of the cameras, enlarged to fill the images; by default an equidistant one.
        width: of the images, pixels.
        height: of the images, pixels.
        seed: of all random numbers; the same seed makes the same clip.
        overwrite: replace what is in the folder.
    """
    from tsuiseki.datamodules.scenes.rooms.ceiling import SIZES, RoomSettings
    from tsuiseki.datamodules.scenes.rooms.files import write_room
    from tsuiseki.tracking.cameras.lens_files import read_lens
    from tsuiseki.tracking.cli.progress import progress

    frames = max(round(seconds * frame_rate), 1)
    settings = RoomSettings(SIZES[room], frames, frame_rate, people, repeated, width, height)
    lens = None if calibration is None else read_lens(calibration)
    write_room(out, settings, seed, lens, overwrite, watch=lambda drawn: progress(drawn, "drawing", frames))
    print(f"2 cameras, {frames} frames of {width}x{height} each: {out}")
