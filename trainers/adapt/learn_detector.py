"""Fine-tuning a detector on the labels of a round, and giving its scores their meaning."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import lightning
import numpy as np
import torch
from lightning.pytorch.callbacks import Callback, EMAWeightAveraging, ModelCheckpoint

from tsuiseki.datamodules.augmentation import Augmentation
from tsuiseki.datamodules.detector import Composition, DetectionData
from tsuiseki.datamodules.training_images import TrainingSource
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.tiles import view_of
from tsuiseki.tracking.features.view_choice import ViewedDetector
from tsuiseki.tracking.geometry import clip_boxes
from tsuiseki.tracking.preprocessing import fit_image
from tsuiseki.tracking.types import Detections, ImageArray
from tsuiseki.trainers.adapt.settings import AdaptSettings
from tsuiseki.trainers.adapt.watch import HELD_OUT, KEPT_BACK, Watched
from tsuiseki.trainers.detector import Detector, DetectorOptimisation, detections
from tsuiseki.trainers.detector_labels import LOWEST_SCORE, fit_calibration, matched_scores
from tsuiseki.trainers.exporting.export import export_onnx, load_module, quiet
from tsuiseki.trainers.exporting.exported_weights import ExportedLayout
from tsuiseki.trainers.exporting.written_networks import RawHeads
from tsuiseki.trainers.network_module import interruptible

# Windows of a step, as large as the detector's input.
BATCH_SIZE = 6
# People that are rendered to be composed onto the empty view beside the camera's own.
GENERATED_PEOPLE = 200
# At the end of the warm-up of the first round; halved in each later one.
LEARNING_RATE = 1e-3
# A training is saved this many times, so that one that was stopped goes on.
_SITTINGS = 5
# Name of the finished training's file.
CHECKPOINT = "detector.ckpt"
# Decay of the moving average of the weights, a step.
_EMA = 0.98
# A box of which better ones cover this share together is left out: no person stands half in each of two others.
_STRADDLING = 0.85
# Labels leave out whoever they are unsure of, so what is left is easier than all that will be detected:
# a steeper fit would be surer than it may be.
_STEEPEST = 1.0
_OUTPUTS = ("logits", "offsets", "anchors")
_TRAINED_ON = "unlabelled video of one camera (tsuiseki adapt)"


def fine_tune(
    start: Path,
    layout: ExportedLayout,
    videos: Sequence[Watched],
    columns: int,
    round_: int,
    folder: Path,
    settings: AdaptSettings,
) -> Path:
    """Train a detector on the labels beside the pictures; goes on where an earlier call was stopped.

    Args:
        start: exported detector or checkpoint whose weights are taken over.
        layout: of it.
        videos: with their labels.
        columns: tiles across for the detector; it learns from windows as large.
        round_: from 1.
        folder: for the checkpoints.
        settings: how.

    Returns:
        The checkpoint.

    Raises:
        Interrupted: the user ended the training.
    """
    done, last = folder / CHECKPOINT, folder / "last.ckpt"
    if done.is_file():
        return done
    lightning.seed_everything(settings.seed + round_, verbose=False)
    module = Detector(
        **layout.arguments,
        start=start,
        loss="quality",
        learning_rate=LEARNING_RATE / 2 ** (round_ - 1),
        optimisation=DetectorOptimisation(
            warmup_steps=min(20, settings.steps // 4),
            final_share=0.05,
        ),
    )
    data = _data(videos, layout, columns, round_, settings)
    with quiet("lightning.pytorch", "lightning.fabric"), interruptible():
        trainer = _trainer(folder, settings)
        trainer.fit(module, datamodule=data, ckpt_path=str(last) if last.is_file() else None, weights_only=True)
    trainer.save_checkpoint(done, weights_only=False)
    last.unlink(missing_ok=True)
    return done


def _data(
    videos: Sequence[Watched], layout: ExportedLayout, columns: int, round_: int, settings: AdaptSettings
) -> DetectionData:
    sources = [
        TrainingSource(v.folder, frames=(1, v.learnt(KEPT_BACK)), fixed_camera=v.fixed, share=v.length) for v in videos
    ]
    (width, height), (high, wide) = videos[0].size, layout.size
    x1, _, x2, _ = view_of((height, width), columns, wide / high).tiles[-1]
    # How much larger a tile shows things than the whole frame does.
    closer = float(width / (x2 - x1)) if columns > 1 else 1.0
    return DetectionData(
        sources,
        sources,
        height=layout.size[0],
        width=layout.size[1],
        batch_size=BATCH_SIZE,
        batches=max(settings.steps // _SITTINGS, 1),
        workers=0,
        augmentation=Augmentation(
            scale=(0.8 * closer, 1.35 * closer), aspect=0.06, rotation=2.0, shear=0.03, flip=0.3, colour=0.6, holes=3
        ),
        composition=Composition(
            generated_people=GENERATED_PEOPLE, add=0.6, reclothe=0.3, empty=0.25, foreign=0.05, most_people=8
        ),
        seed=settings.seed + 1000 * round_,
    )


def _trainer(folder: Path, settings: AdaptSettings) -> lightning.Trainer:
    steps = settings.steps
    torch.set_num_threads(settings.threads or torch.get_num_threads())
    callbacks: list[Callback] = [
        EMAWeightAveraging(decay=_EMA, update_starting_at_step=min(20, steps // 2)),
        ModelCheckpoint(folder, filename="last", enable_version_counter=False, save_on_train_epoch_end=True),
    ]
    return lightning.Trainer(
        max_epochs=max(1, round(steps / max(steps // _SITTINGS, 1))),
        accelerator="cpu",
        gradient_clip_val=5.0,
        num_sanity_val_steps=0,
        limit_val_batches=0,
        logger=False,
        callbacks=callbacks,
        default_root_dir=folder,
        enable_progress_bar=False,
        enable_model_summary=False,
    )


def export_calibrated(
    checkpoint: Path,
    size: tuple[int, int],
    videos: Sequence[Watched],
    view: tuple[int, int | None],
    out: Path,
) -> tuple[float, float]:
    """Write the detector as ONNX, its scores probabilities on labels that have taught it nothing.

    They lie before the held-out end, which is to judge a detector that knows nothing of it.

    Args:
        checkpoint: of `fine_tune`.
        size: height and width of the input.
        videos: with their labels.
        view: tiles across and down.
        out: the file.

    Returns:
        Scale and shift of the logit; 1 and 0 where all detections there are right, or none is.
    """
    module = load_module(Detector, checkpoint, size)
    network = module.network.to(memory_format=torch.contiguous_format)
    fitted = _calibration(TorchDetector(module), videos, view)
    calibration = fitted or (1.0, 0.0)
    card = dataclasses.replace(
        module.card,
        training_data=_TRAINED_ON,
        settings={
            **module.card.settings,
            "score_calibration": list(calibration),
            # Trackers take the scores for probabilities where this says so.
            "calibrated": fitted is not None,
            "straddling": _STRADDLING,
        },
    )
    example = torch.zeros(2, 3, card.input_height, card.input_width)
    export_onnx(RawHeads(network, calibration), card, out, example, _OUTPUTS, float16=True, overwrite=True)
    return calibration


class TorchDetector:
    """A trained detector that finds people before it is exported.

    Args:
        module: evaluated, not trained, here.
    """

    def __init__(self, module: Detector) -> None:
        self.module = module.eval()

    @property
    def input_size(self) -> tuple[int, int]:
        """Height and width, pixels."""
        return self.module.card.input_height, self.module.card.input_width

    @torch.no_grad()
    def detect(self, images: Sequence[ImageArray]) -> list[Detections]:
        """From `LOWEST_SCORE` on."""
        card = self.module.card
        fitted, scales = zip(*(fit_image(image, card) for image in images), strict=True)
        places, scores = self.module.network.decode(self.module(torch.from_numpy(np.stack(fitted))))
        batch = detections(places, scores, card)
        result = []
        for detected, scale, image in zip(batch, scales, images, strict=True):
            boxes = clip_boxes(detected.boxes / np.tile(scale, 2), image.shape[1], image.shape[0])
            usable = (detected.scores >= LOWEST_SCORE) & ((boxes[:, 2:] - boxes[:, :2]) >= 1).all(axis=1)
            result.append(Detections(boxes[usable], detected.scores[usable]))
        return result


def _calibration(
    detector: TorchDetector, videos: Sequence[Watched], view: tuple[int, int | None]
) -> tuple[float, float] | None:
    viewed = ViewedDetector(detector, view)
    spans = [(v.learnt(KEPT_BACK) + 1, v.learnt(HELD_OUT)) for v in videos]
    parts = [matched_scores(viewed, Path(v.folder), s) for v, s in zip(videos, spans, strict=True)]
    scores, right = (np.concatenate(part) for part in zip(*parts, strict=True))
    try:
        return fit_calibration(scores, right, _STEEPEST)
    except RequestError:
        return None
