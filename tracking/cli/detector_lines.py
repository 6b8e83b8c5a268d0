"""What a command says of its networks: what they run on, how a file is read, and that nothing came out of it."""

from __future__ import annotations

from tsuiseki.tracking.cli.run import Run
from tsuiseki.tracking.features.foreign_detector import ForeignDetector
from tsuiseki.tracking.features.view_choice import devices_of, inner_detector


def tell_models(run: Run, detect: object, *others: object) -> None:
    """Print, and keep for ``run.json``, what the networks run on, and how the file of ``detect`` is read.

    Only what is not the usual way is printed: a GPU, and a file that was recognised.
    """
    device = devices_of(detect, *others)
    run.facts |= device
    if "cuda" in device.get("device", ""):
        print(f"networks run on {device['device']}", flush=True)
    found = inner_detector(detect)
    if isinstance(found, ForeignDetector):
        run.facts["detector"] = found.facts
        print(f"{found.path.name} is read as {found}", flush=True)


def tell_blank(detect: object) -> None:
    """Print that the file of ``detect`` has given nothing for any picture, where that is so."""
    found = inner_detector(detect)
    if isinstance(found, ForeignDetector) and found.blank:
        print(
            f"{found.path.name} gave no box of any class for any picture; check that it is the right export and that "
            f"its pictures are {found.input}",
            flush=True,
        )
