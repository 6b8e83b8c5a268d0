"""What `--detect-every` costs and saves, and whether a trial on the first seconds tells it.

    python -m benchmarks.detectors.strides SEQUENCE [SEQUENCE=VIDEO ...] [--strides 1,2,3,4] [--seconds 6]

A sequence has labels, and pictures unless its video is given. A line says HOTA and IDF1 against the labels, CPU
seconds, and two trials on the first seconds: the HOTA of the result against that of every frame, and the mean overlap
of boxes of every frame with those on a straight line between every N-th one.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Sequence

import numpy as np

from benchmarks.machine import machine
from tsuiseki.tracking.evaluation.calls import evaluate_people
from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.people.api import track_people
from tsuiseki.tracking.types import Track

# Frames of the longest video.
LONGEST = 100_000


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sequences", nargs="+", metavar="SEQUENCE")
    parser.add_argument("--strides", default="1,2,3,4")
    parser.add_argument("--seconds", type=float, default=6.0)
    words = parser.parse_args()
    warnings.simplefilter("ignore")
    print(machine("numpy", "onnxruntime"))
    for sequence in words.sequences:
        labels, _, video = sequence.partition("=")
        every: list[Track] = []
        for stride in map(int, words.strides.split(",")):
            start = time.process_time()
            result = track_people(video or labels, threads=1, inference_frames=range(0, LONGEST, stride))
            seconds = time.process_time() - start
            tracks = [*result]
            every = every or tracks
            last = round(words.seconds * result.frame_rate)
            scores = evaluate_people(labels, tracks)
            agreement = evaluate_people(every, tracks, frames=f"1-{last}").hota
            overlap = mean_overlap(every, stride, last)
            print(
                f"{labels}: every {stride}: HOTA {scores.hota:.3f} IDF1 {scores.idf1:.3f}, {seconds:.1f} s CPU; the "
                f"first {words.seconds:g} s: HOTA {agreement:.3f}, overlap {overlap:.3f}",
                flush=True,
            )


def mean_overlap(tracks: Sequence[Track], stride: int, last: int) -> float:
    """Of the boxes before frame ``last`` with those on a line between every ``stride``-th frame; 1 where none is."""
    overlaps = [np.ones(1)]
    for track in tracks:
        kept = track.frames % stride == 0
        frames = track.frames[(track.frames < last) & ~kept]
        if kept.sum() < 2 or not len(frames):
            continue
        inside = (frames > track.frames[kept][0]) & (frames < track.frames[kept][-1])
        columns = [np.interp(frames[inside], track.frames[kept], side) for side in track.boxes[kept].T]
        overlaps.append(iou_pairs(np.stack(columns, axis=1), track.boxes[np.isin(track.frames, frames[inside])]))
    return float(np.concatenate(overlaps).mean())


if __name__ == "__main__":
    main()
