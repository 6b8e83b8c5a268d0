"""What a command says of a detector of another project: how it reads the file, and that nothing came out of it."""

from __future__ import annotations

from tsuiseki.tracking.cli.run import Run
from tsuiseki.tracking.features.foreign_detector import ForeignDetector
from tsuiseki.tracking.features.view_choice import inner_detector


def tell_reading(run: Run, detect: object) -> None:
    """Print, and keep for ``run.json``, how the file of ``detect`` is read, where that was recognised."""
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
