"""KCF and CSK as trackers of one target; the score is the greatest response."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.interface import TargetState, box_centre
from tsuiseki.tracking.types import FloatArray, ImageArray


class KcfTracker:
    """The correlation filter alone.

    Attributes:
        settings: constants.
        lost_below: response at which the target counts as lost; the filter goes on all the same.
    """

    def __init__(self, settings: kcf.KcfSettings, lost_below: float = 0.2, seed: int = 0) -> None:
        del seed
        self.settings = settings
        self.lost_below = lost_below

    def start(self, image: ImageArray, box: FloatArray) -> None:
        """See `SingleTracker.start`."""
        width, height = (box[2:] - box[:2]).tolist()
        self._model = kcf.Kcf.of(self.settings, width, height)
        self.state = kcf.start(self._model, image, box_centre(np.asarray(box)))

    def follow(self, image: ImageArray) -> TargetState:
        """See `SingleTracker.follow`."""
        self.state = kcf.step(self._model, self.state, image)
        status = "tracking" if self.state.peak > self.lost_below else "lost"
        return TargetState(self._model.box(self.state.centre, self.state.size), self.state.peak, status)  # type: ignore[arg-type]
