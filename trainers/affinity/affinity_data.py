"""The labelled video that the flow's costs are learnt from, and what of it is given, found or drawn."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from tsuiseki.datamodules.simulated_detections import DetectorFaults
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import Appearance, Detector
from tsuiseki.tracking.formats.mot_sequence import find_sequences
from tsuiseki.tracking.options import Shared
from tsuiseki.trainers.affinity.affinity_samples import LabelledDetections, labelled_parts, stretches
from tsuiseki.trainers.affinity.seen_frames import check_unseen, looks


@dataclass(frozen=True)
class AffinityVideo(Shared):
    """What is learnt from.

    Attributes:
        folders: MOTChallenge sequences, or folders of them.
        frames: first and last frame to learn from, 1-based and both included.
        detections: ``given`` takes det/det.txt of each sequence; ``simulated`` draws faulty ones from the labels.
        detector: exported detector to use in place of both.
        appearance: exported appearance network; without one the appearance counts as unknown.
        cross_fit: exported appearance networks, one a stretch, in place of ``appearance``.
        cross_fit_detectors: exported detectors, one a stretch, in place of ``detector``.
        seen: take networks also where they were trained.
        skips: also learn from every n-th frame only, for other frame rates; 1 is the video itself.
        faults: of simulated detections.
    """

    folders: list[Path]
    frames: tuple[int, int] | None = None
    detections: Literal["given", "simulated"] = "given"
    detector: Path | None = None
    appearance: Path | None = None
    cross_fit: list[Path] | None = None
    cross_fit_detectors: list[Path] | None = None
    seen: bool = False
    skips: list[int] | None = None
    faults: DetectorFaults | None = None

    def parts(self, rng: np.random.Generator) -> list[LabelledDetections]:
        """The detections of every stretch, described, with who they are.

        Raises:
            RequestError: unusable folders or models, or a network that was trained on what it shall look at.
        """
        if self.cross_fit and self.cross_fit_detectors and len(self.cross_fit) != len(self.cross_fit_detectors):
            raise RequestError(
                f"expected as many `cross_fit_detectors` as `cross_fit`, got {len(self.cross_fit_detectors)} and "
                f"{len(self.cross_fit)}"
            )
        models = {path: Appearance(path) for path in self.cross_fit or _one(self.appearance)}
        detectors = {path: Detector(path) for path in self.cross_fit_detectors or _one(self.detector)}
        sequences = [sequence for folder in self.folders for sequence in find_sequences(folder)]
        if not self.seen:
            count = max(len(models), len(detectors))
            cut = [(sequence, stretches(sequence, self.frames, count)) for sequence in sequences]
            check_unseen([look for sequence, parts in cut for look in looks(sequence, parts, models, detectors)])
        find, faults = [*detectors.values()] or self.detections, self.faults or DetectorFaults()
        return [
            part
            for sequence in sequences
            for part in labelled_parts(sequence, self.frames, find, [*models.values()], faults, rng)
        ]


def _one(path: Path | None) -> list[Path]:
    return [] if path is None else [path]
