"""`tsuiseki simulate drone`."""

from __future__ import annotations

from dataclasses import asdict
from typing import Literal

from tsuiseki.tracking.cli.options import SeededOutput
from tsuiseki.tracking.cli.simulate.options import Clip, fill

CLIP = Clip(300, 1280, 720, 30.0)


def drone(
    output: SeededOutput,
    clip: Clip = CLIP,
    people: int = 9,
    camera: Literal["still", "calm", "violent"] = "violent",
    altitude: tuple[float, float] = (10.0, 45.0),
    tilt: tuple[float, float] = (45.0, 90.0),
    look_alikes: float = 0.3,
    sun: float = 0.0,
    layout: Literal["mot", "okutama"] = "mot",
) -> int:
    """Make a clip of people who act under a drone, with a box, an id and one or two actions each in every frame.

    Args:
        out: folder for the clip; gets img1/000001.jpg and so on, gt/gt.txt, gt/actions.txt and seqinfo.ini.
        people: that act in view.
        camera: how much the drone moves.
        altitude: lowest and highest, metres.
        tilt: flattest and steepest view under the horizon, degrees.
        look_alikes: share of people dressed much like somebody else.
        sun: probability of a hard sun, in which one side of everybody is dark; else anything from overcast to mild.
        layout: mot is a MOTChallenge sequence with gt/actions.txt as Okutama-Action's; okutama is that data set's own.
    """
    from tsuiseki.datamodules.scenes.drone_clip import DroneSceneSettings, write_drone

    settings = DroneSceneSettings(
        **asdict(clip),
        people=people,
        camera=camera,
        altitude=altitude,
        tilt=tilt,
        look_alikes=look_alikes,
        sun=sun,
    )
    return fill(
        output, clip.told, lambda folder: write_drone(folder, settings, output.seed, watch=clip.watch, layout=layout)
    )
