"""Whether a network was trained on the frames that costs shall be fitted to.

Where a detector or an appearance network was trained, it is right more often than elsewhere. Costs that are fitted
there trust it too much: on later frames of PETS a detector of frames 1-400 with costs fitted to them reaches an IDF1
of .764, with costs that are not fitted to them .864. An exported network says in words what it was trained on
(`ModelCard.training_data`), such as "PETS09-S2L1-first frames 1-300; streets".
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import Appearance, Detector
from tsuiseki.tracking.onnx import ModelCard

# Shorter words, such as "MOT" or "all", name no sequence.
SHORTEST_NAME = 4
_RANGE = re.compile(r"(\d+)\s*[-–]\s*(\d+)")


@dataclass(frozen=True)
class NetworkUse:
    """A network that is to look at frames of a sequence.

    Attributes:
        path: its file.
        card: what it says of itself.
        sequence: name of the sequence.
        first: frame, counted from 1.
        last: likewise, included.
    """

    path: Path
    card: ModelCard
    sequence: str
    first: int
    last: int

    @property
    def trained_there(self) -> bool:
        """Whether it was trained on one of the frames, as far as it says."""
        ranges = trained_frames(self.card.training_data, self.sequence)
        return any(first <= self.last and self.first <= last for first, last in ranges)


def trained_frames(training_data: str, sequence: str) -> list[tuple[float, float]]:
    """First and last frames of ``sequence`` that a network was trained on by its own words; all where it names none.

    Parts are separated by semicolons. A part is about the sequence where one of its words is the sequence's name, or
    its beginning from four letters on.

    >>> trained_frames("MOT17-02; PETS frames 1–300, 401-500", "PETS09-S2L1-first")
    [(1.0, 300.0), (401.0, 500.0)]
    >>> trained_frames("MOT17-02; PETS", "MOT17-02"), trained_frames("generated pictures", "MOT17-02")
    ([(0.0, inf)], [])
    """
    found: list[tuple[float, float]] = []
    for part in training_data.split(";"):
        words = re.split(r"[\s,()/]+", part)
        names = [w for w in words if len(w) >= SHORTEST_NAME and sequence.lower().startswith(w.lower())]
        if names:
            rest = " ".join(word for word in words if word not in names)
            ranges = [(float(a), float(b)) for a, b in _RANGE.findall(rest)]
            found += ranges or [(0.0, float("inf"))]
    return found


def network_uses(
    name: str, parts: Sequence[tuple[int, int]], *networks: Mapping[Path, Appearance | Detector]
) -> Iterator[NetworkUse]:
    """Which network looks at which frames: of each kind one looks at all of them, or each at its own.

    Args:
        name: of the sequence that is looked at.
        parts: first frame of each span, from 0, and the one after its last.
        networks: of each kind, by their files.
    """
    for few in networks:
        for k, (start, stop) in enumerate(parts if few else []):
            path, network = list(few.items())[k % len(few)]
            yield NetworkUse(path, network.model.card, name, start + 1, stop)


def check_unseen(uses: Sequence[NetworkUse]) -> None:
    """Refuse networks that were trained on what they look at; warn of those that do not say.

    Raises:
        RequestError: one was, by its own words.
    """
    for use in uses:
        if use.trained_there:
            raise RequestError(
                f"{use.path}: expected a {use.card.kind} that has not seen frames {use.first}-{use.last} of "
                f"{use.sequence}, got one trained on {use.card.training_data!r}; costs fitted there trust it too "
                "much. Give other `frames`, or networks that each leave a part out (`cross_fit`, "
                "`cross_fit_detectors`), or take it all the same with `seen`"
            )
    for path in dict.fromkeys(use.path for use in uses if not use.card.training_data):
        warnings.warn(
            f"{path} does not say what it was trained on; costs fitted to frames it has seen trust it too much",
            stacklevel=2,
        )
