"""How well exported appearance networks tell labelled people apart, against clothing-colour histograms.

    python -m benchmarks.association.appearance_transfer ../shared/data/mot/PETS09-S2L1-first MODEL.onnx ... \
        --frames 301 400

Every labelled box is a query against all others of the segment, without those of the same person less than
``--apart`` frames away; the last column is the chance that a pair of the same person up to ``--window`` frames apart
lies closer than a pair of two people. Nothing is fitted on the segment.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.datamodules.labelled_images import LabelledFrame, labelled_images
from tsuiseki.datamodules.video_pictures import read_image
from tsuiseki.tracking.evaluation.reidentification import area_under_roc, evaluate_retrieval
from tsuiseki.tracking.features.exported import Appearance
from tsuiseki.tracking.preprocessing import crop_boxes
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray

SPACES = {"Lab": cv2.COLOR_RGB2LAB, "HSV": cv2.COLOR_RGB2HSV}


def clothing_histograms(image: ImageArray, boxes: FloatArray, space: str, bins: int) -> FloatArray:
    """``(N, 2 * bins^3)`` unit-length roots of the colour histograms of jacket and trousers."""
    crops = crop_boxes(image, boxes, 96, 48)[:, :, 10:-10]
    return (
        np.stack(
            [
                np.concatenate([_root_histogram(c[14:50], space, bins), _root_histogram(c[50:90], space, bins)])
                for c in crops
            ]
        )
        / np.sqrt(2)
        if len(crops)
        else np.empty((0, 2 * bins**3))
    )


def _root_histogram(image: ImageArray, space: str, bins: int) -> FloatArray:
    converted = cv2.cvtColor(image, SPACES[space])
    top = 180 if space == "HSV" else 256
    counts = cv2.calcHist([converted], [0, 1, 2], None, [bins] * 3, [0, top, 0, 256, 0, 256]).ravel()
    return np.asarray(np.sqrt(counts / counts.sum()))


def describe(
    samples: list[LabelledFrame], method: str | Appearance, least_visible: float
) -> tuple[FloatArray, IntArray, IntArray]:
    """Features, identities and frames of every labelled box."""
    features, ids, frames = [], [], []
    for sample in samples:
        kept = ~sample.ignored & (sample.visibility >= least_visible)
        image = read_image(sample.picture)
        boxes = sample.boxes[kept]
        if isinstance(method, str):
            space, bins = method.split()
            features.append(clothing_histograms(image, boxes, space, int(bins)))
        else:
            features.append(method.describe(image, boxes))
        ids.append(sample.ids[kept])
        frames.append(np.full(kept.sum(), sample.frame))
    return np.concatenate(features), np.concatenate(ids), np.concatenate(frames)


def scores(features: FloatArray, ids: IntArray, frames: IntArray, apart: int, window: int) -> tuple[float, ...]:
    """Rank-1, mean average precision and area under the ROC."""
    distances = 1 - features @ features.T
    same = ids[:, None] == ids[None, :]
    gap = np.abs(frames[:, None] - frames[None, :])
    retrieval = evaluate_retrieval(distances, ids, ids, junk=same & (gap < apart))
    near = (gap > 0) & (gap <= window)
    return (
        retrieval.rank1,
        retrieval.mean_average_precision,
        area_under_roc(-distances[same & near], -distances[~same & near]),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sequence", type=Path)
    parser.add_argument("models", type=Path, nargs="*")
    parser.add_argument("--frames", type=int, nargs=2, default=(301, 400), help="first and last, from 1")
    parser.add_argument("--apart", type=int, default=25)
    parser.add_argument("--window", type=int, default=30)
    parser.add_argument("--least-visible", type=float, default=0.0)
    arguments = parser.parse_args()
    samples = labelled_images(arguments.sequence, tuple(arguments.frames))
    histograms = ("Lab 4", "Lab 6", "Lab 8", "HSV 4", "HSV 6", "HSV 8")
    methods: dict[str, str | Appearance] = {f"histogram {m}": m for m in histograms}
    methods |= {str(path): Appearance(path, threads=1) for path in arguments.models}
    print(f"{'':40} rank-1    mAP    AUC")
    for name, method in methods.items():
        values = scores(*describe(samples, method, arguments.least_visible), arguments.apart, arguments.window)
        print(f"{name[-40:]:40} {values[0]:6.3f} {values[1]:6.3f} {values[2]:6.3f}")


if __name__ == "__main__":
    main()
