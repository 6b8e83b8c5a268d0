"""`tsuiseki simulate blobs`."""

from __future__ import annotations

from dataclasses import asdict

from tsuiseki.tracking.cli.options import SeededOutput
from tsuiseki.tracking.cli.simulate.options import Clip, fill

CLIP = Clip(150)


def blobs(
    output: SeededOutput,
    clip: Clip = CLIP,
    objects: int = 5,
    colour: str = "red",
    purity: tuple[float, float] = (0.45, 0.95),
    clutter: int = 12,
) -> int:
    """Make a clip of coloured objects moving over natural clutter, as a MOTChallenge sequence.

    Args:
        out: folder for the sequence; gets img1/000001.jpg and so on, gt/gt.txt and seqinfo.ini.
        objects: how many appear in all.
        colour: of the objects: red, orange, yellow, green, cyan, blue or magenta.
        purity: least and greatest share of an object's pixels that has the colour.
        clutter: patches of the same colour, smaller than objects, in the background.
    """
    from tsuiseki.datamodules.scenes.blob_clip import BlobSceneSettings, write_blobs

    settings = BlobSceneSettings(**asdict(clip), objects=objects, colour=colour, purity=purity, clutter=clutter)
    return fill(output, clip.told, lambda folder: write_blobs(folder, settings, output.seed, watch=clip.watch))
