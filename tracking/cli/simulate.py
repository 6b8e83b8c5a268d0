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
