"""`tsuiseki train detector`: Lightning's own command line, or anchors for its configuration."""

from __future__ import annotations

from collections.abc import Sequence

from tsuiseki.tracking.cli.commands import needs_train_extra

PROPOSE = "--propose-anchors"


def detector(words: Sequence[str]) -> None:
    """Fit a person detector to labelled video; with --propose-anchors only print anchors that fit it."""
    from tsuiseki.tracking.cli.parser import call

    with needs_train_extra():
        from tsuiseki.trainers.networks.detector_labels import anchors_for
        from tsuiseki.trainers.networks.fit import fit_detector
    if PROPOSE in words:
        print(call(f"tsuiseki train detector {PROPOSE}", anchors_for, [word for word in words if word != PROPOSE]))
    else:
        fit_detector(words)
