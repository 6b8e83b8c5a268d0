"""The people's part of the shipped detector learns on, and comes back beside its branch.

    python -m benchmarks.detectors.people_part train --work out/train/people_part
    tsuiseki export detector --checkpoint out/train/people_part/last.ckpt --blend out/train/people_part/start.onnx
        --float16 --height 384 --width 512 --calibrate out/cache/everyday-sparse --training-data "rendered people"
        --licence Apache-2.0 --out people.onnx
    python -m benchmarks.detectors.people_part join people.onnx BRANCHED.onnx --out FILE

Exported is the mean of its weights before and after. The first stage of the trunk stays as it is, because the branch
sees it, too. Boxes that the branch is for, wider than `WIDEST` of their height and not cut off, are neither right nor
wrong. The rendered people are those of configs/detector_everyday.yaml, which says how to make them.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import lightning.pytorch as lightning
from lightning.pytorch.callbacks import Callback, EMAWeightAveraging, ModelCheckpoint

from benchmarks.detectors.long_training import HEIGHT, WIDTH
from tsuiseki.datamodules.augmentation import Augmentation
from tsuiseki.datamodules.detector import IGNORED, PERSON, DetectionBatch, DetectionData
from tsuiseki.datamodules.training_images import Scene, TrainingSource
from tsuiseki.tracking.weights import PEOPLE_DETECTOR, shipped
from tsuiseki.trainers.detector import Detector, DetectorOptimisation
from tsuiseki.trainers.exporting.exported_weights import calibrate, calibration_of, layout_of
from tsuiseki.trainers.exporting.written_networks import model_file, write_detector

# Of its height, from which a box is for the branch.
WIDEST = 0.75
# Pixels from the border within which a box is cut off.
BORDER = 1
# Of the input while it learns, pixels.
LEARNT_HEIGHT, LEARNT_WIDTH = 256, 320


def _pictures(scene: Scene, count: int, seed: int, share: float, sun: float) -> TrainingSource:
    return TrainingSource(
        folder=f"out/cache/people-part-{scene}-{seed}", generate=count, scene=scene, size=(640, 480), seed=seed,
        share=share, sun=sun, town=scene != "everyday", things=scene not in ("aerial", "near"), boxes="steady",
        sprites="out/cache/sprites-posed", photographs="out/cache/photographs",
    )  # fmt: skip


SOURCES = [
    _pictures("everyday", 550, 630001, 0.34, sun=0.3),
    _pictures("everyday", 380, 620601, 0.1, sun=0.3),
    _pictures("varied", 300, 630003, 0.2, sun=0.5),
    _pictures("varied", 240, 620603, 0.12, sun=0.5),
    _pictures("crowded", 450, 630007, 0.16, sun=0.3),
    _pictures("aerial", 120, 630005, 0.04, sun=0.4),
    _pictures("near", 120, 630004, 0.04, sun=0.4),
]
VALIDATION = TrainingSource(
    folder="out/cache/everyday-sparse", generate=60, scene="sparse", size=(640, 480), seed=41,
    sprites="out/cache/sprites-everyday",
)  # fmt: skip


class PeoplePart(Callback):
    """Keeps the first stage as it is, and what the branch is for out of the loss."""

    def on_train_epoch_start(self, trainer: lightning.Trainer, module: lightning.LightningModule) -> None:
        """Statistics of the first stage stay."""
        del trainer
        first_stage(module).eval()

    def on_train_batch_start(
        self, trainer: lightning.Trainer, module: lightning.LightningModule, batch: DetectionBatch, batch_index: int
    ) -> None:
        """Wide boxes are ignored."""
        del trainer, module, batch_index
        ignore_wide(batch)


def ignore_wide(batch: DetectionBatch) -> None:
    """Labels of wide boxes that the border does not cut off become `IGNORED`, in place."""
    height, width = batch.images.shape[1:3]
    x1, y1, x2, y2 = batch.boxes.unbind(dim=-1)
    whole = (x1 > BORDER) & (y1 > BORDER) & (x2 < width - BORDER) & (y2 < height - BORDER)
    wide = x2 - x1 > WIDEST * (y2 - y1)
    batch.labels[(batch.labels == PERSON) & whole & wide] = IGNORED


def first_stage(module: Any) -> Any:
    """Of the trunk; the branch sees its map."""
    return module.network.features.trunk.stages[0]


def main() -> None:
    """Do what the words ask for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("train", "join"))
    parser.add_argument("files", type=Path, nargs="*", help="to join: of the people's part, and of the branch")
    parser.add_argument("--work", type=Path, default=Path("out/train/people_part"))
    parser.add_argument("--epochs", type=int, default=22, help="of 100 batches")
    parser.add_argument("--out", type=Path, default=Path("out/joined.onnx"))
    words = parser.parse_args()
    if words.what == "train":
        train(words.work, words.epochs)
    else:
        people, branched = words.files
        join(people, branched, words.out)


def train(work: Path, epochs: int) -> None:
    """Teach a copy of the people's part; checkpoints lie in ``work``."""
    lightning.seed_everything(0)
    start = shipped(PEOPLE_DETECTOR)
    module = Detector(
        start=start, height=LEARNT_HEIGHT, width=LEARNT_WIDTH, learning_rate=6e-4,
        optimisation=DetectorOptimisation(warmup_steps=60, final_share=0.02),
    )  # fmt: skip
    scale, shift = calibration_of(layout_of(start).card)
    # A calibration left in the weights is what the loss would first take out again.
    calibrate(module.network.state_dict(), 1 / scale, -shift / scale, 1)
    module.export(work / "start.onnx", overwrite=True)
    first_stage(module).requires_grad_(False)
    data = DetectionData(
        train=SOURCES, val=[VALIDATION], augmentation=Augmentation(scale=(0.6, 2.2), smallest=9.0), batch_size=16,
        batches=100, workers=0, seed=6500,
    )  # fmt: skip
    trainer = lightning.Trainer(
        max_epochs=epochs, accelerator="cpu", num_sanity_val_steps=0, limit_val_batches=0, gradient_clip_val=5.0,
        logger=False, default_root_dir=work,
        callbacks=[
            EMAWeightAveraging(decay=0.99, update_starting_at_step=30),
            ModelCheckpoint(work, save_last=True, save_top_k=-1),
            PeoplePart(),
        ],
    )  # fmt: skip
    trainer.fit(module, data)


def join(people: Path, branched: Path, out: Path) -> None:
    """Write the detector of ``people`` with the branch of ``branched``, both exported; both had one first stage."""
    layout, card = layout_of(branched, branched=True), layout_of(people).card
    module = Detector(start=branched, **(layout.arguments | {"height": HEIGHT, "width": WIDTH}))
    module.network.load_state_dict(Detector(start=people).network.state_dict(), strict=False)
    said = {**layout.card.settings, "people_calibration": list(calibration_of(card))}
    whole = replace(module.card, training_data=card.training_data, licence=card.licence, settings=said)
    write_detector(module.network, whole, model_file(out, card.training_data, True, True))


if __name__ == "__main__":
    main()
