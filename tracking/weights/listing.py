"""All networks that a name stands for, in one table: what ships with the toolkit, then the catalogue."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from tsuiseki.tracking.onnx import card_of
from tsuiseki.tracking.weights import shipped, shipped_names
from tsuiseki.tracking.weights.catalogue import CATALOGUE, CatalogueModel

# Of the toolkit, and of the networks that ship with it where their own card says nothing.
LICENCE = "Apache-2.0"
HEAD = ("name", "kind", "MB", "licence", "time", "PETS", "MOT-02", "MOT-13")
NOTE = """\
time: of a picture of 640x480 on one thread, multiples of that of the detector people. PETS, MOT-02,
MOT-13: AP50 of frames 301-400 of PETS09-S2L1, four stills of MOT17-02 and the video of MOT17-13,
with --view auto; - where it was not measured. The first ones ship with tsuiseki. `tsuiseki models
get NAME` shows what one learnt from, and asks before it fetches one of the others."""
# Names of shipped networks begin with their kinds, which --detector and --appearance leave out.
SHORTENED = ("detector_", "appearance_")


@dataclass(frozen=True)
class Measured:
    """What was measured of a detector.

    Attributes:
        time: of a picture of 640 x 480 on one thread, multiples of that of ``people``.
        average_precision: at IoU 0.5 on PETS09-S2L1, MOT17-02 and MOT17-13; none for networks of other cameras.
    """

    time: float
    average_precision: tuple[float, ...] = ()


# What was measured of each network, by name; see `Measured`.
MEASURED = {
    "detector_people": Measured(1.0, (0.954, 0.373, 0.271)),
    "detector_street": Measured(0.47),
    "detector_figures": Measured(0.85),
    "detector_ceiling": Measured(0.25),
    "detector_drone": Measured(0.76),
    "detector_drone_larger": Measured(1.34),
    "nanodet-g": Measured(1.54, (0.959, 0.623, 0.419)),
    "ssd-openimages": Measured(0.61, (0.908, 0.402, 0.315)),
    "blazepose": Measured(0.4, (0.073, 0.055, 0.005)),
    "pedestrian-ssdlite": Measured(0.62, (0.470, 0.181, 0.066)),
}


def table() -> str:
    """Of all networks, a line each, with what its columns are."""
    rows = [HEAD, *map(_shipped_row, shipped_names()), *map(_row, CATALOGUE)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join([*lines, "", NOTE])


def _short(name: str) -> str:
    return next((name.removeprefix(kind) for kind in SHORTENED if name.startswith(kind)), name)


def _shipped_row(name: str) -> Sequence[str]:
    file = shipped(name)
    size = f"{file.stat().st_size / 1e6:.1f}"
    if file.suffix != ".onnx":
        return (name, "objectness", size, LICENCE, *_measured(name))
    card = card_of(file)
    return (_short(name), card.kind, size, card.licence or LICENCE, *_measured(name))


def _row(entry: CatalogueModel) -> Sequence[str]:
    size = f"{entry.size / 1e6:.1f}" if entry.size else "-"
    licence = re.sub(r" \(.*?\)", "", entry.licence)
    return (entry.name, entry.kind, size, licence, *_measured(entry.name))


def _measured(name: str) -> Sequence[str]:
    measured = MEASURED.get(name)
    if measured is None:
        return ("-",) * 4
    values = [f"{x:.3f}" for x in measured.average_precision]
    return (f"{measured.time:.2f}", *values, *["-"] * (3 - len(values)))
