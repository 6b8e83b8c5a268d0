"""`tsuiseki simulate fisheye`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Literal

from tsuiseki.tracking.cli.options import SeededOutput
from tsuiseki.tracking.cli.simulate.options import Clip, fill

CLIP = Clip(900, 1280, 960, 15.0)


def fisheye(
    output: SeededOutput,
    clip: Clip = CLIP,
    room: Literal["large", "small"] = "large",
    people: int = 6,
    repeated: float = 0.5,
    calibration: Path | None = None,
) -> int:
    """Make a clip of people in a room under two fisheye cameras on its ceiling, with their boxes and places.

    DIR gets camera1 and camera2, MOTChallenge sequences with img1, gt/gt.txt and gt/world.csv (frame, id, x, y in
    metres), the ids the same in both, and cameras.yaml for tsuiseki track fisheye.

    Args:
        out: folder for the clip.
        room: large is 8 by 16 m, small 4 by 9 m.
        people: who wander about.
        repeated: share of people who wear the clothes of another, or nearly.
        calibration: lens of the cameras, enlarged to fill the images; by default an equidistant one.
    """
    from tsuiseki.datamodules.scenes.room_clip import SIZES, RoomSettings, write_room
    from tsuiseki.tracking.cameras.lens_files import read_lens

    settings = RoomSettings(**asdict(clip), size=SIZES[room], people=people, repeated=repeated)
    lens = None if calibration is None else read_lens(calibration)
    return fill(output, clip.told, lambda folder: write_room(folder, settings, output.seed, lens, watch=clip.watch))
