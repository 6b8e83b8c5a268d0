"""A folder of independent generated pictures of people, in the MOTChallenge layout. No torch."""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.training import TrainingSettings, random_training_scene
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import GroundTruth, write_ground_truth, write_sequence_info
from tsuiseki.tracking.output import output_folder
from tsuiseki.tracking.types import FloatArray

_QUALITY = 92
_SEQUENCE = "random-scenes"


def write_scene_images(folder: Path, count: int, settings: TrainingSettings, seed: int) -> None:
    """Render ``count`` pictures into the sequence ``folder``, on all cores; picture n depends on ``seed`` and n only.

    The frames have nothing to do with each other; every box has its own id.

    Raises:
        RequestError: fewer than one picture, or the folder holds files.
    """
    if count < 1:
        raise RequestError(f"expected at least one picture to generate for {folder}, got {count}")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with output_folder(folder, overwrite=False) as work:
        (work / "img1").mkdir()
        render = partial(_render, work / "img1", settings, seed)
        # Started afresh: a copy of a process that runs torch's threads can lock up.
        with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
            labels = list(pool.map(render, range(count), chunksize=8))
        write_ground_truth(work / "gt" / "gt.txt", _as_ground_truth(labels))
        write_sequence_info(work, _SEQUENCE, 1.0, count, settings.width, settings.height)


def _render(folder: Path, settings: TrainingSettings, seed: int, number: int) -> tuple[FloatArray, FloatArray]:
    cv2.setNumThreads(1)
    image, boxes, visibility = random_training_scene(np.random.default_rng([seed, number]), settings)
    path = folder / f"{number + 1:06d}.jpg"
    cv2.imwrite(str(path), image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    large = ((boxes[:, 2:] - boxes[:, :2]) > 1).all(axis=1)
    return boxes[large], visibility[large]


def _as_ground_truth(labels: list[tuple[FloatArray, FloatArray]]) -> GroundTruth:
    boxes = np.concatenate([b for b, _ in labels])
    everyone = np.ones(len(boxes), dtype=np.bool_)
    return GroundTruth(
        frames=np.repeat(np.arange(len(labels)), [len(b) for b, _ in labels]),
        ids=np.arange(1, len(boxes) + 1),
        boxes=boxes,
        evaluated=everyone,
        ignored=~everyone,
        visibility=np.concatenate([v for _, v in labels]),
    )
