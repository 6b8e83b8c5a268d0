"""`tsuiseki simulate sphere`: a ball carried through a room before calibrated cameras."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from tsuiseki.tracking.errors import RequestError


def sphere(
    out: Path,
    cameras: int = 2,
    frames: int = 100,
    frame_rate: float = 15.0,
    radius: float = 0.10,
    noise: float = 3.0,
    cover: tuple[int, int, int] | None = None,
    seed: int = 0,
    overwrite: bool = False,
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
        seed: of all random numbers; the same seed makes the same film.
        overwrite: replace what is in the folder.
    """
    from tsuiseki.datamodules.scenes.ball.carried import CarriedBallSettings, Cover
    from tsuiseki.datamodules.scenes.ball.files import write_ball
    from tsuiseki.tracking.cli.progress import progress
    from tsuiseki.tracking.output import RunRecord, check_output_folder, output_folder

    covers: tuple[Cover, ...] = ()
    if cover is not None:
        if not (1 <= cover[0] <= cameras and 1 <= cover[1] <= cover[2]):
            raise RequestError(f"--cover: expected CAMERA,FIRST,LAST counted from 1, got {','.join(map(str, cover))}")
        covers = (Cover(cover[0] - 1, cover[1] - 1, cover[2] - 1),)
    check_output_folder(out, overwrite)
    try:
        settings = CarriedBallSettings(cameras, frames, frame_rate, radius, noise=noise, covers=covers)
    except ValueError as error:
        raise RequestError(str(error)) from error
    with output_folder(out, overwrite) as work:
        write_ball(work, settings, seed, lambda items: progress(items, "filming", frames))
        RunRecord(("tsuiseki", "simulate", "sphere"), dataclasses.asdict(settings), seed).write(work)
    print(f"{frames} frames of {cameras} cameras: {out}")
