"""`tsuiseki train detector`, `appearance`, `action` and `association`: Lightning's own command line, in our frame."""

from __future__ import annotations

from collections.abc import Sequence

from tsuiseki.tracking.cli.commands import needs_train_extra

PROPOSE = "--propose-anchors"


def detector(words: Sequence[str]) -> None:
    """Fit a person detector to labelled video; with --propose-anchors only print anchors that fit it."""
    if PROPOSE in words:
        _propose_anchors([word for word in words if word != PROPOSE])
        return
    with needs_train_extra():
        from tsuiseki.trainers.networks.fit import fit_detector
    fit_detector(words)


def _propose_anchors(words: Sequence[str]) -> None:
    from tsuiseki.tracking.cli.parser import call

    with needs_train_extra():
        from tsuiseki.trainers.networks.anchors import anchors_for
    print(call(f"tsuiseki train detector {PROPOSE}", anchors_for, words))


def appearance(words: Sequence[str]) -> None:
    """Fit an appearance network to crops of labelled people."""
    with needs_train_extra():
        from tsuiseki.trainers.networks.fit import fit_appearance
    fit_appearance(words)


def action(words: Sequence[str]) -> None:
    """Fit the streams of an action network to clips labelled with actions."""
    with needs_train_extra():
        from tsuiseki.trainers.networks.fit import fit_action
    fit_action(words)


def association(words: Sequence[str]) -> None:
    """Fit the costs of the flow to labelled video, through the flow."""
    with needs_train_extra():
        from tsuiseki.trainers.networks.fit import fit_association
    fit_association(words)
