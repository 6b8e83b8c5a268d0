"""`tsuiseki simulate sphere`."""

from __future__ import annotations

from tsuiseki.tracking.cli.options import SeededOutput
from tsuiseki.tracking.cli.simulate.options import Length, fill
from tsuiseki.tracking.errors import RequestError

LENGTH = Length(100)


def sphere(
    output: SeededOutput,
    length: Length = LENGTH,
    cameras: int = 2,
    frame_rate: float = 15.0,
    radius: float = 0.10,
    noise: float = 3.0,
    cover: tuple[int, int, int] | None = None,
) -> int:
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
    from tsuiseki.datamodules.scenes.sphere_clip import CarriedBallSettings, Cover, write_ball

    covers: tuple[Cover, ...] = ()
    if cover is not None:
        if not (1 <= cover[0] <= cameras and 1 <= cover[1] <= cover[2]):
            raise RequestError(f"`cover`: expected CAMERA,FIRST,LAST counted from 1, got {','.join(map(str, cover))}")
        covers = (Cover(cover[0] - 1, cover[1] - 1, cover[2] - 1),)
    settings = CarriedBallSettings(cameras, length.frames, frame_rate, radius, noise=noise, covers=covers)
    what = f"{length.frames} frames of {cameras} cameras"
    return fill(output, what, lambda folder: write_ball(folder, settings, output.seed, length.watch))
