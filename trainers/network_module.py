"""What all trainings share: how weights are moved, what checkpoints hold, and how pictures are normalised.

The learning rate rises linearly and falls along a cosine; matrices and kernels decay.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, Self, TypeVar

import torch
from jsonargparse import ArgumentError, Namespace
from lightning import LightningModule, Trainer
from lightning.pytorch.utilities.types import OptimizerLRSchedulerConfig
from torch import Tensor, nn
from torch.optim import SGD, AdamW, Optimizer
from torch.optim.lr_scheduler import LambdaLR

from tsuiseki.tracking.errors import Interrupted, RequestError, signal_of
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.trainers.refusals import checkpoint_content

T = TypeVar("T")


@dataclass(frozen=True)
class Optimisation:
    """How a training moves weights, beside its learning rate.

    Attributes:
        weight_decay: of matrices and kernels; normalisations and biases have none.
        warmup_steps: of linear rise of the learning rate.
        final_share: share of the learning rate that the cosine decay ends with.
        optimiser: ``adamw`` or ``sgd``.
    """

    weight_decay: float = 0.02
    warmup_steps: int = 100
    final_share: float = 0.01
    optimiser: Literal["adamw", "sgd"] = "adamw"

    def groups(self, module: nn.Module, learning_rate: float) -> list[dict[str, Any]]:
        """The trained parameters in two groups: matrices and kernels, which decay, and the others, which do not.

        Args:
            module: whose parameters.
            learning_rate: at the end of the warm-up.
        """
        trained = [p for p in module.parameters() if p.requires_grad]
        groups: list[dict[str, Any]] = [
            {"params": [p for p in trained if p.ndim > 1], "weight_decay": self.weight_decay, "lr": learning_rate},
            {"params": [p for p in trained if p.ndim <= 1], "weight_decay": 0.0, "lr": learning_rate},
        ]
        return groups

    def scheduled(self, groups: list[dict[str, Any]], trainer: Trainer) -> OptimizerLRSchedulerConfig:
        """The optimiser of the parameter ``groups`` under `WarmupCosine` over all steps of ``trainer``.

        Raises:
            RequestError: no weight learns, or the training has no end, over which the rate could fall.
        """
        if not any(group["params"] for group in groups):
            raise RequestError("expected weights that learn, got a network that is all frozen; `unfreeze()` some of it")
        if not math.isfinite(trainer.estimated_stepping_batches):
            raise RequestError(
                "expected a training with an end, over which the learning rate falls; set max_epochs or max_steps of "
                "the Trainer"
            )
        optimiser: Optimizer = SGD(groups, momentum=0.9, nesterov=True) if self.optimiser == "sgd" else AdamW(groups)
        total = max(int(trainer.estimated_stepping_batches), self.warmup_steps + 1)
        falling = WarmupCosine(optimiser, self.warmup_steps, total, self.final_share)
        return {"optimizer": optimiser, "lr_scheduler": {"scheduler": falling, "interval": "step"}}


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Lightning ends the process after an interrupt, as if it had failed; here the interrupt itself comes out.

    Raises:
        Interrupted: the user ended the training.
    """
    try:
        yield
    except SystemExit as error:
        if isinstance(error.__context__, KeyboardInterrupt):
            raise Interrupted(signal_of(error.__context__)) from error
        raise


def read_checkpoint(path: Path, part: Literal["hyper_parameters", "state_dict"]) -> dict[str, Any]:
    """A part of a checkpoint, of which nothing but tensors and plain values is unpickled.

    Raises:
        RequestError: it is missing, or no checkpoint of a network.
    """
    held = load_checkpoint(path).get(part)
    if not isinstance(held, dict):
        raise RequestError(f"{path}: expected a checkpoint of `tsuiseki train`, found no {part} in it")
    return dict(held)


def load_checkpoint(path: Path, device: str = "cpu") -> dict[str, Any]:
    """A checkpoint with its tensors on a device; raises RequestError where it is missing, or none of a network."""
    if not path.is_file():
        raise RequestError(f"expected a checkpoint at {path}, found none; a training writes last.ckpt and best.ckpt")
    held = checkpoint_content(path, device, "`tsuiseki train`")
    if not isinstance(held, dict):
        raise RequestError(f"{path}: expected a checkpoint of `tsuiseki train`, got something else")
    return held


def plain_hyperparameters(module: LightningModule) -> None:
    """Let a checkpoint of ``module`` hold plain values alone, of which Lightning makes the settings again."""
    for name, value in module.hparams.items():
        module.hparams[name] = _plain(value)
    module.hparams["_instantiator"] = "lightning.pytorch.cli.instantiate_module"


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {name: _plain(part) for name, part in dataclasses.asdict(value).items()}
    if isinstance(value, dict | Namespace):
        return {name: _plain(part) for name, part in (vars(value) if isinstance(value, Namespace) else value).items()}
    return str(value) if isinstance(value, Path) else value


# What a training started from: its checkpoint holds what came of it, and needs none of these files.
BEGINNINGS: dict[str, Any] = {"weights": None, "start": None, "teacher": {}}
# Where a checkpoint says of which class its module is.
NETWORK = "network"
# Where it says of which class the network is that a user built in Python; a command's is among the hyperparameters.
BROUGHT = "brought"
# Scores that the progress bar shows.
_ON_BAR = ("ap50", "ap75", "rank1", "map", "agreement", "mota", "switches")


class NetworkModule(LightningModule):
    """A network, its loss and its schedule, scored on all of its validation.

    ``Trainer.test`` scores it under ``test/`` instead of ``val/``.

    Attributes:
        kind: of the network: ``detector``, …
        network: what learns.
        learning_rate: at the end of the warm-up.
        optimisation: how its weights are moved beside that.
        validated: what validation steps have kept, one for each of the samples on this device.
    """

    kind: ClassVar[str]
    network: Any
    learning_rate: float
    optimisation: Optimisation

    def __init__(self) -> None:
        super().__init__()
        self.validated: list[Any] = []
        self._brought = ""

    def bring(self, *networks: nn.Module) -> None:
        """Note that ``networks`` of the user learn, which are in no folder of ours."""
        names = [f"{type(network).__module__}.{type(network).__qualname__}" for network in networks]
        self._brought = ", ".join(dict.fromkeys(names))

    def scores(self, rows: list[Any]) -> dict[str, float]:
        """The scores by their names, of what validation steps have kept on all devices."""
        raise NotImplementedError

    def on_validation_epoch_end(self) -> None:
        """Log the scores; of a check before the training only where it has all of the validation."""
        if not self.trainer.sanity_checking or math.isinf(self.trainer.num_sanity_val_steps):
            stage = "test" if self.trainer.testing else "val"
            for name, value in self.scores(gathered(self, self.validated)).items():
                self.log(f"{stage}/{name}", value, prog_bar=name in _ON_BAR, sync_dist=True)
        self.validated = []

    def test_step(self, batch: Any, batch_index: int) -> None:
        self.validation_step(batch, batch_index)

    def on_test_epoch_end(self) -> None:
        self.on_validation_epoch_end()

    def parameter_groups(self) -> list[dict[str, Any]]:
        """What learns, and how fast."""
        return self.optimisation.groups(self.network, self.learning_rate)

    def configure_optimizers(self) -> OptimizerLRSchedulerConfig:
        """AdamW or SGD under a linear warm-up and a cosine decay over the whole training."""
        return self.optimisation.scheduled(self.parameter_groups(), self.trainer)

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Let the checkpoint be made again without the files that its training started from."""
        beginnings = {name: value for name, value in BEGINNINGS.items() if name in self.hparams}
        checkpoint["hyper_parameters"] = {**checkpoint["hyper_parameters"], **beginnings}
        checkpoint[NETWORK] = type(self).__name__
        if self._brought and self.hparams["network"] is None:
            checkpoint[BROUGHT] = self._brought

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Refuse the checkpoint of another network.

        Raises:
            RequestError: it is one.
        """
        _check_kind(checkpoint, type(self), "the checkpoint")
        held, own = checkpoint["state_dict"], self.state_dict()
        fitting = [name for name, value in own.items() if name in held and held[name].shape == value.shape]
        if len(fitting) < len(own) or len(held) > len(own):
            raise RequestError(
                f"expected a checkpoint of this {type(self).__name__}, got one of another network: {len(fitting)} of "
                f"{len(own)} tensors fit; build the network as the checkpoint's was"
            )

    @classmethod
    def load_from_checkpoint(cls, checkpoint_path: Any, *args: Any, **kwargs: Any) -> Self:
        """The module in a checkpoint, see Lightning; nothing but tensors and plain values is unpickled.

        Raises:
            RequestError: the file is missing, no checkpoint, or of another module.
        """
        if isinstance(checkpoint_path, str | Path):
            held = load_checkpoint(Path(checkpoint_path), "meta")
            _check_kind(held, cls, checkpoint_path)
            if BROUGHT in held and kwargs.get("network") is None:
                raise RequestError(
                    f"{checkpoint_path}: expected `network`, a {held[BROUGHT]} as it was trained; "
                    f"{cls.__name__}.load_from_checkpoint(FILE, network=…) takes it"
                )
        try:
            return super().load_from_checkpoint(checkpoint_path, *args, **{"weights_only": True, **kwargs})
        except RequestError:
            raise
        except (RuntimeError, KeyError, TypeError, AttributeError, ArgumentError) as error:
            reason = " ".join(str(error).split())[:200]
            raise RequestError(f"{checkpoint_path}: expected a checkpoint of {cls.__name__}, got: {reason}") from error


def _check_kind(checkpoint: dict[str, Any], kind: type[NetworkModule], name: object) -> None:
    network = checkpoint.get(NETWORK, kind.__name__)
    if network != kind.__name__:
        raise RequestError(f"{name}: expected one of {kind.__name__}, got one of {network}")


def gathered(module: LightningModule, rows: list[T]) -> list[T]:
    """The ``rows`` of all devices together, as one device would have them.

    Args:
        module: on one of the devices, which Lightning gives every n-th sample of the validation.
        rows: one for each of its samples, in their order.
    """
    if module.trainer.world_size == 1:
        return rows
    parts: list[list[T]] = [[] for _ in range(module.trainer.world_size)]
    torch.distributed.all_gather_object(parts, rows)
    # So that all have as many, the last samples are the first ones again.
    samples: Any = module.trainer.test_dataloaders if module.trainer.testing else module.trainer.val_dataloaders
    return [row for step in zip(*parts, strict=True) for row in step][: len(samples.dataset)]


def first_samples(module: LightningModule, count: int, samples: Callable[[Any], Tensor]) -> Tensor:
    """The first ``count`` samples, or all, of those that a training learns from.

    Args:
        module: that is fitted.
        count: of samples.
        samples: ``(B, ...)`` those of a batch.
    """
    module.trainer.fit_loop.setup_data()
    parts, total = list[Tensor](), 0
    for batch in module.trainer.train_dataloader or ():
        parts.append(samples(batch))
        total += len(parts[-1])
        if total >= count:
            break
    return torch.cat(parts)[:count]


def normalised(images: Tensor, card: ModelCard, dtype: str | torch.dtype = torch.float32) -> Tensor:
    """``(B, C, H, W)`` as a network takes them, of ``(B, H, W, C)`` uint8 images; the ``card`` says how."""
    assert isinstance(dtype, torch.dtype)
    mean, std = (255 * torch.tensor(values, device=images.device).view(1, -1, 1, 1) for values in (card.mean, card.std))
    return ((images.permute(0, 3, 1, 2).float() - mean) / std).to(dtype)


class WarmupCosine(LambdaLR):
    """A linear rise to 1 and a cosine fall over the steps of a training, which may go on over more steps or fewer.

    A checkpoint holds where the factor was. From there it falls to the final share over the steps that are left now, so
    it never jumps; a training that had ended goes on at the final share.

    Args:
        optimiser: whose rates it sets.
        warmup: steps of the rise.
        total: steps of the training.
        final_share: of the rate, in the end.
    """

    def __init__(self, optimiser: Optimizer, warmup: int, total: int, final_share: float) -> None:
        self.warmup, self.total, self.final_share = warmup, total, final_share
        # Where the fall began, and from what factor.
        self.fall: tuple[int, float] = (warmup, 1.0)
        super().__init__(optimiser, lambda step: self.factor(step))

    def factor(self, step: int) -> float:
        """What the optimiser's learning rate is multiplied by at ``step``."""
        if step < self.warmup:
            return (step + 1) / self.warmup
        first, previous = self.fall
        progress = min(1.0, (step - first) / max(self.total - first, 1))
        return self.final_share + (previous - self.final_share) * (1 + math.cos(math.pi * progress)) / 2

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Go on from a checkpoint, over the steps that this training has."""
        total = self.total
        super().load_state_dict(state_dict)
        if total != self.total and self.last_epoch >= self.warmup:
            self.fall = (self.last_epoch, self.factor(self.last_epoch))
        self.total = total
