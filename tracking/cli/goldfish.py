"""`tsuiseki simulate goldfish`: bodies that bend, with exact states."""

from __future__ import annotations

from pathlib import Path


def simulate(
    out: Path,
    frames: int = 150,
    width: int = 640,
    height: int = 480,
    frame_rate: float = 15.0,
    fish: int = 3,
    seed: int = 0,
    overwrite: bool = False,
) -> None:
    """Make a clip of goldfish in a tank, seen from above, with exact states and silhouettes.

    DIR gets img1/000001.jpg and so on, states.csv (frame,id,a,b,theta,phi: centre in pixels, heading and bend in
    radians), silhouettes/000001.png and so on (bit id - 1 of a pixel: the body lies there) and seqinfo.ini.

    Args:
        out: folder for the clip.
        frames: length of the clip.
        width: of the images, pixels.
        height: of the images, pixels.
        frame_rate: frames per second.
        fish: how many, 1 to 5.
        seed: of all random numbers; the same seed makes the same clip.
        overwrite: replace what is in the folder.
    """
    from tsuiseki.datamodules.scenes.goldfish import GoldfishSettings, write_goldfish
    from tsuiseki.tracking.cli.progress import progress

    settings = GoldfishSettings(frames=frames, width=width, height=height, frame_rate=frame_rate, fish=fish)
    write_goldfish(out, settings, seed, overwrite, watch=lambda drawn: progress(drawn, "drawing", frames))
    print(f"{frames} frames of {width}x{height}: {out}")
