"""Networks that a user brings along: what they say about themselves, and a trial before the first batch."""

from __future__ import annotations

import contextlib
import pkgutil
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from tsuiseki.models.contract import NetworkCard
from tsuiseki.models.losses import IGNORED, PADDING, PERSON
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.onnx import Kind, ModelCard

# Samples of the trial: with one, a network that takes no others would pass.
_PICTURES = 2
# Difference of the length of a feature to 1 that rounding explains, in half precision too.
_LENGTH_TOLERANCE = 1e-2


def refuse_parts(parts: Mapping[str, Any], usual: Mapping[str, Any]) -> None:
    """Refuse arguments that decide what a network of one's own decides itself.

    Args:
        parts: arguments by name.
        usual: what they are where nobody gives them.

    Raises:
        RequestError: one is another.
    """
    named = [name for name, value in parts.items() if value != usual.get(name)]
    if named:
        raise RequestError(
            f"`{named[0]}`: expected none beside `network`, which decides it itself, got {parts[named[0]]}; leave it "
            "out, or make it an argument of the network"
        )


def card_of_network(network: nn.Module, kind: Kind, **fields: Any) -> ModelCard:
    """What the exported file of ``network`` will say about itself.

    Args:
        network: with a `NetworkCard`.
        kind: of the network.
        fields: of the card that are known of such a network.

    Raises:
        RequestError: it has no such card.
    """
    card = getattr(network, "card", None)
    if not isinstance(card, NetworkCard):
        raise RequestError(
            f"`network`: expected {type(network).__name__} to have a tsuiseki.training.NetworkCard as its card, got "
            f"{type(card).__name__}"
        )
    return ModelCard(**{"kind": kind, **vars(card), **fields})


def try_detector(network: nn.Module) -> ModelCard:
    """The card of a `DetectorNetwork` that does what it must on noise.

    Raises:
        RequestError: it does not.
    """
    name = type(network).__name__
    missing = [method for method in ("decode", "loss") if not callable(getattr(network, method, None))]
    if missing:
        raise RequestError(f"`network`: expected {name} to be a DetectorNetwork, it has no method {missing[0]}")
    card = card_of_network(network, "detector")
    with _trial(network, (3, card.input_height, card.input_width)) as images:
        outputs = network(images)
        decoded = network.decode(outputs)  # type: ignore[operator]
        # With a labelled box, and without.
        boxes = images.new_tensor([0.0, 0.0, card.input_width / 2, card.input_height / 2]).expand(_PICTURES, 2, 4)
        labels = torch.tensor([[PERSON, PADDING], [IGNORED, PADDING]], device=images.device)
        terms = network.loss(outputs, boxes.clone(), labels)  # type: ignore[operator]
    _check_decoded(decoded, len(card.class_names), name)
    fine = isinstance(terms, Mapping) and all(isinstance(term, Tensor) and term.ndim == 0 for term in terms.values())
    if not (fine and terms):
        raise RequestError(f"`network`: expected {name}.loss to give a dict of scalar tensors, got {_shown(terms)}")
    return card


def try_appearance(network: nn.Module) -> ModelCard:
    """The card of an `AppearanceTrunk` that gives features of unit length for noise.

    Raises:
        RequestError: it does not.
    """
    name = type(network).__name__
    card = appearance_card(network, 0)
    with _trial(network, (3, card.input_height, card.input_width)) as images:
        features = network(images)
    if not isinstance(features, Tensor) or features.ndim != 2 or len(features) != _PICTURES:
        raise RequestError(f"`network`: expected {name} to give features ({_PICTURES}, D), got {_shown(features)}")
    lengths = features.float().norm(dim=1)
    if not bool(((lengths - 1).abs() < _LENGTH_TOLERANCE).all()):
        raise RequestError(
            f"`network`: expected {name} to give features of unit length, got length {float(lengths[0]):.3g}; end it "
            "with torch.nn.functional.normalize(features, dim=1)"
        )
    return appearance_card(network, features.shape[1])


def appearance_card(network: nn.Module, feature_length: int) -> ModelCard:
    """What the exported file of an `AppearanceTrunk` will say; crops are stretched to its input."""
    return card_of_network(network, "appearance", class_names=(), resize="stretch", feature_length=feature_length)


def try_action(network: nn.Module, channels: int) -> NetworkCard:
    """The card of an `ActionClassifier` that gives a logit an action for noise of so many ``channels``.

    Raises:
        RequestError: it does not, or takes no squares.
    """
    name = type(network).__name__
    card = card_of_network(network, "action")
    if card.input_height != card.input_width:
        raise RequestError(
            f"`network`: expected {name} to take squares, as people are cropped, got {card.input_height}x"
            f"{card.input_width}"
        )
    with _trial(network, (channels, card.input_height, card.input_width)) as images:
        logits = network(images)
    expected = _PICTURES, len(card.class_names)
    if not isinstance(logits, Tensor) or logits.shape != expected:
        raise RequestError(
            f"`network`: expected {name} to give logits {expected}, one an action of its card; got {_shown(logits)}"
        )
    own: NetworkCard = network.card  # type: ignore[assignment]
    return own


def try_link_costs(network: nn.Module, features: int) -> None:
    """Refuse what gives no change of a cost a link for noise of so many ``features``; raises RequestError."""
    with _trial(network, (features,)) as rows:
        changes = network(rows)
    if not isinstance(changes, Tensor) or changes.shape not in ((_PICTURES,), (_PICTURES, 1)):
        raise RequestError(
            f"`network`: expected {type(network).__name__} to give a change of the cost of each link, ({_PICTURES},) "
            f"of features ({_PICTURES}, {features}), got {_shown(changes)}"
        )


@contextlib.contextmanager
def importable_here() -> Iterator[None]:
    """Meanwhile a class may lie in a file of the working folder, as for ``python file.py``; all others come first."""
    here = str(Path.cwd())
    sys.path.append(here)
    try:
        yield
    finally:
        sys.path.remove(here)


def check_class(path: str) -> None:
    """Refuse what names no class of modules for a network; what is no name of a class is the parser's to refuse.

    Raises:
        RequestError: it does not.
    """
    if not path.replace(".", "").isidentifier():
        return
    wish = f"`network`: expected a class of torch modules, as my.Net of a file my.py in the working folder, got {path}"
    try:
        named = pkgutil.resolve_name(path)
    except (ImportError, AttributeError, ValueError) as error:
        raise RequestError(f"{wish}: {error}") from error
    if not (isinstance(named, type) and issubclass(named, nn.Module)):
        raise RequestError(wish)


@contextlib.contextmanager
def _trial(network: nn.Module, shape: tuple[int, ...]) -> Iterator[Tensor]:
    """Samples of a ``shape`` for ``network``, while it is evaluated and nothing learns."""
    training = network.training
    example = next(network.parameters(), torch.zeros(0))
    network.eval()
    try:
        with torch.no_grad():
            # Normal numbers are what normalised pictures look like.
            yield torch.randn((_PICTURES, *shape), generator=torch.Generator().manual_seed(0)).to(example.device)
    finally:
        network.train(training)


def _check_decoded(decoded: Any, classes: int, name: str) -> None:
    """Refuse what is no boxes and scores of a class each."""
    expected = (
        f"`network`: expected {name}.decode to give boxes ({_PICTURES}, N, 4) and scores ({_PICTURES}, N, {classes})"
    )
    fine = isinstance(decoded, tuple | list) and len(decoded) == 2 and all(isinstance(x, Tensor) for x in decoded)
    if fine:
        boxes, scores = (tuple(x.shape) for x in decoded)
        fine = boxes == (_PICTURES, *scores[1:2], 4) and scores == (_PICTURES, *boxes[1:2], classes)
    if not fine:
        raise RequestError(f"{expected}, a class each of its card; got {_shown(decoded)}")
    scores = decoded[1]
    if scores.numel() and not bool(((scores >= 0) & (scores <= 1)).all()):
        low, high = float(scores.min()), float(scores.max())
        raise RequestError(
            f"{expected} in [0, 1], got scores from {low:.3g} to {high:.3g}; take their sigmoid or softmax"
        )


def _shown(value: Any) -> str:
    """Shapes of tensors, and types of what is none."""
    if isinstance(value, Tensor):
        return str(tuple(value.shape))
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{name}: {_shown(part)}" for name, part in value.items()) + "}"
    if isinstance(value, tuple | list):
        return ", ".join(map(_shown, value)) or "nothing"
    return type(value).__name__
