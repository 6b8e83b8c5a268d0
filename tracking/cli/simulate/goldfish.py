"""`tsuiseki simulate goldfish`."""

from __future__ import annotations

from dataclasses import asdict
from typing import Literal

from tsuiseki.tracking.cli.options import SeededOutput
from tsuiseki.tracking.cli.simulate.options import Size, fill

SIZE = Size(150)


def goldfish(
    output: SeededOutput,
    size: Size = SIZE,
    body: Literal["goldfish", "ball"] = "goldfish",
    count: int | None = None,
    frame_rate: float | None = None,
) -> int:
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
    from tsuiseki.datamodules.scenes.bouncing_clip import BouncingBallSettings, write_balls
    from tsuiseki.datamodules.scenes.goldfish_clip import GoldfishSettings, write_goldfish

    drawn, how = asdict(size), (output.seed, False, size.watch)
    if body == "ball":
        balls = BouncingBallSettings(
            **drawn, frame_rate=30.0 if frame_rate is None else frame_rate, balls=1 if count is None else count
        )
        return fill(output, size.told, lambda folder: write_balls(folder, balls, *how))
    fish = GoldfishSettings(
        **drawn, frame_rate=15.0 if frame_rate is None else frame_rate, fish=3 if count is None else count
    )
    return fill(output, size.told, lambda folder: write_goldfish(folder, fish, *how))
