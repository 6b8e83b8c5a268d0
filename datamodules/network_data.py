"""What all data modules share: they ask the module that a Trainer fits what its network takes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import lightning

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.onnx import ModelCard

# Names of arguments by those of the card's fields.
NAMES = {"input_height": "height", "input_width": "width", "class_names": "classes"}


class NetworkData(lightning.LightningDataModule):
    """Samples for a network.

    Attributes:
        kind: of the network, as its module says it.
        asked: fields of the network's card that arguments name; None for those that the module decides.
        seed: of everything drawn.
    """

    kind: ClassVar[str]
    seed: int

    def __init__(self, **asked: Any) -> None:
        super().__init__()
        self.asked = {name: value for name, value in asked.items() if value is not None}

    def prepare_data(self) -> None:
        """Refuse the module of another network.

        Raises:
            RequestError: it is one.
        """
        kind = getattr(self.module, "kind", self.kind)
        if kind != self.kind:
            raise RequestError(f"expected a module for {self.kind} data, got one of the {kind} network")

    @property
    def module(self) -> Any:
        """The module that is fitted; None without a Trainer."""
        return None if self.trainer is None else self.trainer.lightning_module

    @property
    def card(self) -> ModelCard:
        """What the network takes.

        Raises:
            RequestError: neither the module nor the arguments say it, or they contradict each other.
        """
        card = getattr(self.module, "card", None)
        if isinstance(card, ModelCard):
            for name, value in self.asked.items():
                if getattr(card, name) != value:
                    own = getattr(card, name)
                    raise RequestError(
                        f"`{NAMES.get(name, name)}`: expected data with that of the module, {own}, got {value}; leave "
                        "it out"
                    )
            return card
        card = replace(ModelCard("detector", ""), **self.asked)
        if not card.input_height or not card.input_width:
            raise RequestError(
                "expected a Trainer with a module, or `height` and `width` of its input, got none of them"
            )
        return card

    def epoch_seed(self) -> tuple[int, ...]:
        """Seed of the samples of an epoch and a device; of one epoch where some batches are learnt by heart."""
        if self.trainer is None:
            return (self.seed,)
        epoch = 0 if getattr(self.trainer, "overfit_batches", 0) else self.trainer.current_epoch
        return self.seed, epoch, self.trainer.global_rank


def check_positive(**numbers: float) -> None:
    """Refuse arguments below 1, by their names.

    Raises:
        RequestError: one is.
    """
    for name, number in numbers.items():
        if number < 1:
            raise RequestError(f"`{name}`: expected at least 1, got {number}")
