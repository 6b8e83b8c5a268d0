"""The labelled video that the flow's costs are learnt from, and what of it is given, found or drawn."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from tsuiseki.datamodules.simulated_detections import DetectorFaults
from tsuiseki.tracking.features.networks.exported import Appearance, Detector
from tsuiseki.tracking.formats.mot_sequence import find_sequences
from tsuiseki.tracking.options import Shared
from tsuiseki.trainers.affinity.affinity_samples import LabelledDetections, labelled_parts


@dataclass(frozen=True)
class LabelledVideo(Shared):
    """What is learnt from.

    Attributes:
        folders: MOTChallenge sequences, or folders of them.
        frames: first and last frame to learn from, 1-based and both included.
        detections: ``given`` takes det/det.txt of each sequence; ``simulated`` draws faulty ones from the labels.
        detector: exported detector to use in place of both.
        appearance: exported appearance network; without one the appearance counts as unknown.
        cross_fit: exported appearance networks, one a stretch, in place of ``appearance``.
        skips: also learn from every n-th frame only, for other frame rates; 1 is the video itself.
        faults: of simulated detections.
    """

    folders: list[Path]
    frames: tuple[int, int] | None = None
    detections: Literal["given", "simulated"] = "given"
    detector: Path | None = None
    appearance: Path | None = None
    cross_fit: list[Path] | None = None
    skips: list[int] | None = None
    faults: DetectorFaults | None = None

    def parts(self, rng: np.random.Generator) -> list[LabelledDetections]:
        """The detections of every stretch, described, with who they are.

        Raises:
            RequestError: unusable folders or models.
        """
        models = [Appearance(path) for path in (self.cross_fit or ([self.appearance] if self.appearance else []))]
        find = Detector(self.detector) if self.detector is not None else self.detections
        return [
            part
            for folder in self.folders
            for sequence in find_sequences(folder)
            for part in labelled_parts(sequence, self.frames, find, models, self.faults or DetectorFaults(), rng)
        ]
