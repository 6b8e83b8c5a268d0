"""The checkpoint of the best epoch, among which is the network that a training starts from."""

from __future__ import annotations

import lightning
from lightning.pytorch.callbacks import ModelCheckpoint


class BestEpoch(ModelCheckpoint):
    """Keeps the best epoch by a validation metric.

    With ``num_sanity_val_steps=-1`` a Trainer scores its start on all of the validation. Then the start is epoch 0, and
    stays the best where no epoch is better: a training makes nothing worse by its own measure.
    """

    def on_sanity_check_end(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        """Keep the start, where it was scored."""
        del pl_module
        score = trainer.callback_metrics.get(self.monitor or "")
        if score is None or not score.isfinite():
            return
        path = self.format_checkpoint_name(dict(trainer.callback_metrics))
        trainer.save_checkpoint(path, self.save_weights_only)
        self.best_k_models = {path: score}
        self.best_model_path = self.kth_best_model_path = path
        self.best_model_score = self.kth_value = score
