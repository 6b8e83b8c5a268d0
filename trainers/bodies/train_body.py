"""`tsuiseki train body`: a body from silhouettes, into a file."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking.bodies.contour import Extraction
from tsuiseki.tracking.bodies.learnt import write_body
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.colour_region import parse_colour
from tsuiseki.tracking.options import PlottedFile
from tsuiseki.trainers.bodies.body import learn_body
from tsuiseki.trainers.bodies.body_plot import plot_body
from tsuiseki.trainers.bodies.outlines import outlines_of


def train_body(
    clips: list[Path],
    /,
    output: PlottedFile,
    colour: str | None = None,
    smooth: int = 5,
    modes: int = 1,
    points: int = 48,
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
        plot: also draw the mean outline and the modes into this file (PNG, SVG or PDF).
    """
    if modes < 1 or points < 8:
        raise RequestError(f"expected at least 1 of `modes` and 8 `points`, got {modes} and {points}")
    if smooth < 1 or smooth % 2 == 0:
        raise RequestError(f"`smooth`: expected an odd number from 1, got {smooth}")
    extraction = Extraction(parse_colour(colour), smooth) if colour is not None else None
    outlines = [outline for clip in clips for outline in outlines_of(clip, extraction)]
    fit = learn_body(outlines, modes, points, output.out.stem)
    output.write(output.out, lambda path: write_body(path, fit.body))
    output.draw(lambda path: plot_body(path, fit))
    shares = ", ".join(f"{100 * share:.0f}" for share in fit.explained)
    print(
        f"learnt from {len(outlines)} silhouettes, which vary by {fit.spread:.1f} pixels; the modes ({shares} %) "
        f"leave {fit.residual:.1f}: {output.out}"
    )
