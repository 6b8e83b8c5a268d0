"""`tsuiseki simulate goldfish`: bodies that bend, with exact states."""

from __future__ import annotations

from pathlib import Path
from typing import Literal


def simulate(
    out: Path,
    body: Literal["goldfish", "ball"] = "goldfish",
    count: int | None = None,
    frames: int = 150,
    width: int = 640,
    height: int = 480,
    frame_rate: float | None = None,
    seed: int = 0,
    overwrite: bool = False,
) -> None:
    """Make a clip of goldfish seen from above, or of balls that squash where they bounce, with exact states.

    DIR gets img1/000001.jpg and so on, states.csv (frame,id,a,b,theta,phi: centre in pixels, heading and bend in
    radians; for balls frame,id,a,b,theta,squash), silhouettes/000001.png and so on (the body lies at a pixel where bit
    id - 1 is set) and seqinfo.ini.

    Args:
        out: folder for the clip.
        body: what moves, goldfish or ball.
        count: how many, 1 to 5; by default three fish or one ball.
        frames: length of the clip.
        width: of the images, pixels.
        height: of the images, pixels.
        frame_rate: frames per second; by default 15 for fish and 30 for balls.
        seed: of all random numbers; the same seed makes the same clip.
        overwrite: replace what is in the folder.
    """
    from tsuiseki.datamodules.scenes.ball import BallSettings, write_balls
    from tsuiseki.datamodules.scenes.goldfish import GoldfishSettings, write_goldfish
    from tsuiseki.tracking.cli.progress import progress

    if body == "ball":
        balls = BallSettings(
            frames, width, height, 30.0 if frame_rate is None else frame_rate, count if count is not None else 1
        )
        write_balls(out, balls, seed, overwrite, watch=lambda drawn: progress(drawn, "drawing", frames))
    else:
        fish = GoldfishSettings(
            frames, width, height, 15.0 if frame_rate is None else frame_rate, count if count is not None else 3
        )
        write_goldfish(out, fish, seed, overwrite, watch=lambda drawn: progress(drawn, "drawing", frames))
    print(f"{frames} frames of {width}x{height}: {out}")
