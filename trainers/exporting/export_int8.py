"""An exported detector with 8-bit weights and activations, and what that costs in average precision."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from tsuiseki.datamodules.labelled_images import labelled_images
from tsuiseki.tracking.evaluation.detection import LabelledBoxes, evaluate_detections
from tsuiseki.tracking.features.networks.exported import Detector
from tsuiseki.tracking.output import output_file
from tsuiseki.tracking.preprocessing import fit_image, normalise
from tsuiseki.tracking.types import ImageArray
from tsuiseki.tracking.video.image_folder import read_image
from tsuiseki.trainers.exporting.quantisation import quantise_file, write_card

# Pictures that tell the ranges of activations, and pictures in a batch of them.
CALIBRATION_PICTURES, _BATCH = 32, 4
_LOWEST_SCORE = 0.02


def quantise_detector(whole: Path, path: Path, folder: Path, overwrite: bool = False) -> tuple[float, float]:
    """Write an exported detector with 8-bit weights and activations.

    Args:
        whole: the detector with float weights.
        path: of the file to write.
        folder: labelled pictures in the MOTChallenge layout: some calibrate the ranges, all measure.
        overwrite: replace an existing file.

    Returns:
        AP50 on the pictures before and after; both go into the card.

    Raises:
        RequestError: ``whole`` is no detector, the folder has no labelled picture, or the path cannot be written to.
    """
    card = Detector(whole, threads=1).model.card
    samples = labelled_images(folder)
    pictures = [read_image(sample.path) for sample in samples]
    truth = [LabelledBoxes(sample.boxes, sample.ignored) for sample in samples]
    chosen = np.random.default_rng(0).permutation(len(pictures))[:CALIBRATION_PICTURES]
    fitted = np.stack([fit_image(pictures[n], card)[0] for n in chosen])
    inputs = [normalise(fitted[n : n + _BATCH], card) for n in range(0, len(fitted), _BATCH)]
    before = _average_precision(whole, pictures, truth)
    with output_file(path, overwrite) as work:
        quantise_file(whole, work, inputs)
        write_card(work, card)
        after = _average_precision(work, pictures, truth)
        measured = {"int8": True, "ap50_float": round(before, 4), "ap50_int8": round(after, 4)}
        write_card(work, dataclasses.replace(card, settings={**card.settings, **measured}))
    return before, after


def _average_precision(path: Path, pictures: list[ImageArray], truth: list[LabelledBoxes]) -> float:
    detector = Detector(path, _LOWEST_SCORE, threads=1)
    found = [detector.detect([picture])[0] for picture in pictures]
    return evaluate_detections(truth, found).average_precision
