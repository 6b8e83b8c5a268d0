"""`tsuiseki train`: the trainers' own command lines, which need the `train` extra."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from tsuiseki.tracking.cli.extra import needs_train_extra
from tsuiseki.tracking.cli.parser import parse

PROPOSE = "--propose-anchors"


def detector(words: Sequence[str]) -> int:
    """Fit a person detector to labelled video; with --propose-anchors only print anchors that fit it."""
    if PROPOSE in words:
        return _propose_anchors([word for word in words if word != PROPOSE])
    with needs_train_extra():
        from tsuiseki.trainers.networks.fit import fit_detector
    return _fit(fit_detector, words)


def _propose_anchors(words: Sequence[str]) -> int:
    with needs_train_extra():
        from tsuiseki.trainers.networks.anchors import anchors_for

    def print_anchors(given: Sequence[str]) -> None:
        print(anchors_for(**parse(f"tsuiseki train detector {PROPOSE}", anchors_for, ("folder",), given)))

    return _fit(print_anchors, words)


def appearance(words: Sequence[str]) -> int:
    """Fit an appearance network to crops of labelled people."""
    with needs_train_extra():
        from tsuiseki.trainers.networks.fit import fit_appearance
    return _fit(fit_appearance, words)


def action(words: Sequence[str]) -> int:
    """Fit the streams of an action network to clips labelled with actions."""
    with needs_train_extra():
        from tsuiseki.trainers.networks.fit import fit_action
    return _fit(fit_action, words)


def affinity(words: Sequence[str]) -> int:
    """Fit the costs of the flow to labelled video."""
    with needs_train_extra():
        from tsuiseki.trainers.affinity.affinity import fit_affinity
    return _fit(lambda given: fit_affinity(**parse("tsuiseki train affinity", fit_affinity, (), given)), words)


def affinity_drone(words: Sequence[str]) -> int:
    """Fit the costs of the flow, with actions, to labelled video from a drone."""
    with needs_train_extra():
        from tsuiseki.trainers.affinity.affinity_drone import fit_drone_affinities
    name = "tsuiseki train affinity-drone"
    return _fit(lambda given: fit_drone_affinities(**parse(name, fit_drone_affinities, (), given)), words)


def _fit(function: Callable[[Sequence[str]], Any], words: Sequence[str]) -> int:
    try:
        function(words)
    except SystemExit as done:
        return int(done.code or 0)
    return 0
