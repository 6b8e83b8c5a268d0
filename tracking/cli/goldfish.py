"""`tsuiseki simulate goldfish` and `tsuiseki train body`: clips of bodies with exact states, and bodies from clips."""

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
    from tsuiseki.datamodules.scenes.ball.bouncing import BouncingBallSettings, write_balls
    from tsuiseki.datamodules.scenes.fish.goldfish import GoldfishSettings, write_goldfish
    from tsuiseki.tracking.cli.progress import progress

    if body == "ball":
        balls = BouncingBallSettings(
            frames, width, height, 30.0 if frame_rate is None else frame_rate, count if count is not None else 1
        )
        write_balls(out, balls, seed, overwrite, watch=lambda drawn: progress(drawn, "drawing", frames))
    else:
        fish = GoldfishSettings(
            frames, width, height, 15.0 if frame_rate is None else frame_rate, count if count is not None else 3
        )
        write_goldfish(out, fish, seed, overwrite, watch=lambda drawn: progress(drawn, "drawing", frames))
    print(f"{frames} frames of {width}x{height}: {out}")


def train_body(
    clips: list[Path],
    out: Path,
    colour: str | None = None,
    smooth: int = 5,
    modes: int = 1,
    points: int = 48,
    plot: Path | None = None,
    overwrite: bool = False,
) -> None:
    """Learn a body from silhouettes: its mean outline and how it bends, drawn by nobody.

    tsuiseki track deformable --body FILE.json takes the result.

    Args:
        clips: folders with silhouettes/000001.png and so on, as tsuiseki simulate goldfish makes them; with --colour
            any videos or folders of images, in which each body is mostly seen alone and whole.
        out: file to write, JSON.
        colour: of the bodies: red, orange, yellow, green, cyan, blue, magenta, black, white, or H1-H2,S1-S2,V1-V2 with
            hues in degrees.
        smooth: side in pixels of the median filter of the colour's regions, odd; 1 leaves it out.
        modes: bends that the body has, the most important ones.
        points: of the contour.
        plot: also draw the mean outline and the modes into this image.
        overwrite: replace existing files.
    """
    from tsuiseki.tracking.bodies.learnt import write_body
    from tsuiseki.tracking.errors import RequestError
    from tsuiseki.tracking.likelihoods.colour_region import parse_colour
    from tsuiseki.tracking.likelihoods.contour import Extraction
    from tsuiseki.tracking.output import check_output_file, output_file
    from tsuiseki.trainers.body import learn_body
    from tsuiseki.trainers.body_plot import plot_body
    from tsuiseki.trainers.outlines import outlines_of

    for path in (out, plot):
        if path is not None:
            check_output_file(path, overwrite)
    if modes < 1 or points < 8:
        raise RequestError(f"expected at least 1 of --modes and 8 --points, got {modes} and {points}")
    if smooth < 1 or smooth % 2 == 0:
        raise RequestError(f"--smooth: expected an odd number from 1, got {smooth}")
    extraction = Extraction(parse_colour(colour), smooth) if colour is not None else None
    outlines = [outline for clip in clips for outline in outlines_of(clip, extraction)]
    fit = learn_body(outlines, modes, points, out.stem)
    with output_file(out, overwrite) as work:
        write_body(work, fit.body)
    if plot is not None:
        with output_file(plot, overwrite) as work:
            plot_body(work, fit)
    shares = ", ".join(f"{100 * share:.0f}" for share in fit.explained)
    print(
        f"learnt from {len(outlines)} silhouettes, which vary by {fit.spread:.1f} pixels; the modes ({shares} %) "
        f"leave {fit.residual:.1f}: {out}"
    )
