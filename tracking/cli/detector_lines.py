"""What a command says of its networks: what they run on, how a file is read, and that nothing came out of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tsuiseki.tracking.cli.run import Run
    from tsuiseki.tracking.features.foreign_detector import ForeignDetector


def tell_models(run: Run, detect: object, *others: object) -> None:
    """Print, and keep for ``run.json``, what the networks run on, and how the file of ``detect`` is read.

    Only what is not the usual way is printed: a GPU, and a file that was recognised.
    """
    from tsuiseki.tracking.features.view_choice import devices_of

    device = devices_of(detect, *others)
    run.facts |= device
    if "cuda" in device.get("device", ""):
        print(f"networks run on {device['device']}", flush=True)
    found = _foreign(detect)
    if found is not None:
        run.facts["detector"] = found.facts
        print(f"{found.path.name} is read as {found}", flush=True)


def tell_blank(detect: object) -> None:
    """Print that the file of ``detect`` has given nothing for any picture, where that is so."""
    found = _foreign(detect)
    if found is not None and found.blank:
        print(
            f"{found.path.name} gave no box of any class for any picture; check that it is the right export and that "
            f"its pictures are {found.input}",
            flush=True,
        )


def _foreign(detect: object) -> ForeignDetector | None:
    from tsuiseki.tracking.features.foreign_detector import ForeignDetector
    from tsuiseki.tracking.features.view_choice import inner_detector

    inner = inner_detector(detect)
    return inner if isinstance(inner, ForeignDetector) else None
