"""The progress of a training in plain lines."""

from __future__ import annotations

import time

import lightning
from lightning.pytorch.callbacks import Callback


class EpochLines(Callback):
    """One plain line an epoch, for logs and wherever there is no terminal."""

    def __init__(self) -> None:
        self._start = 0.0
        self._trained = 0.0

    def on_train_epoch_start(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        del trainer, pl_module
        self._start, self._trained = time.perf_counter(), 0.0

    def on_validation_start(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        del trainer, pl_module
        self._trained = time.perf_counter() - self._start

    def on_train_epoch_end(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        """Print the metrics of the epoch."""
        del pl_module
        trained = self._trained or time.perf_counter() - self._start
        pace = f"  {trainer.num_training_batches / max(trained, 1e-9):.2f} batches/s"
        _print_epoch(trainer, trainer.current_epoch + 1, pace)

    def on_sanity_check_end(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        """Print the metrics of the start, where it was scored."""
        del pl_module
        if trainer.callback_metrics:
            _print_epoch(trainer, 0)


def _print_epoch(trainer: lightning.Trainer, number: int, pace: str = "") -> None:
    if trainer.is_global_zero:
        values = "  ".join(f"{k} {float(v):.4g}" for k, v in sorted(trainer.callback_metrics.items()))
        print(f"epoch {number}/{trainer.max_epochs}  {values}{pace}", flush=True)
