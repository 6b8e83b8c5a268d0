"""`tsuiseki simulate street`."""

from __future__ import annotations

from dataclasses import asdict

from tsuiseki.tracking.cli.options import SeededOutput
from tsuiseki.tracking.cli.simulate.options import Clip, fill

CLIP = Clip(200)


def street(output: SeededOutput, clip: Clip = CLIP, people: int = 10, occluders: int = 7) -> int:
    """Make a clip of people walking on a street, before a fixed camera, as a MOTChallenge sequence.

    Args:
        out: folder for the sequence; gets img1/000001.jpg and so on, gt/gt.txt and seqinfo.ini.
        people: about how many are around at a time.
        occluders: poles, bushes, parked cars and the like that may hide them.
    """
    from tsuiseki.datamodules.scenes.street_clip import StreetSettings, write_street

    settings = StreetSettings(**asdict(clip), people=people, occluders=occluders)
    return fill(output, clip.told, lambda folder: write_street(folder, settings, output.seed, watch=clip.watch))
