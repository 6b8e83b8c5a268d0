"""Constants of the filter of the combined tracker."""

from __future__ import annotations

from dataclasses import dataclass, field

from tsuiseki.tracking.filters.correlation.regularised_correlation import RegularisedLearning


@dataclass(frozen=True)
class RegularisedSettings:
    """Constants.

    Attributes:
        padding: side of the square window over the geometric mean of the target's sides, > 1.
        cells: along the window's longer side.
        label_sigma: of the wanted response, as a share of the geometric mean of the target's sides.
        learning: of the filter.
        colour_share: of the colours in the response of a place, in [0, 1].
        colour_rate: share of a new frame in the histograms, in [0, 1].
        sizes: how many are tried in a frame, odd; 1 keeps the first size.
        size_step: ratio of neighbouring sizes.
        size_change: greatest factor on the size in a frame.
        size_rate: share of a new frame in the size filter, in [0, 1].
        size_colour: weight of the contrast of colours beside the size filter's response.
        size_reach: steps of size to each side among which the colours look for one far from the present size, which
            the size filter does not see; 0 looks for none.
        size_margin: how much greater the contrast of colours must be there.
        size_patience: frames in a row in which it must be, always on the same side, before the size follows it.
        size_agreement: share of its response at the present size that the filter of places must have on the way there.
        size_by_area: contrast of colours from which on the number of the target's pixels tells the size, which needs
            no agreement then; 2 never does.
        size_relearning: share of a new frame in the size filter while the size follows.
        calibration: share of the first frame's calibration of the contrast of colours that is used, in [0, 1].
        size_area: pixels of the template of the size filter.
        smallest: least size relative to the first.
        largest: greatest size relative to the first.
        lost_below: response under which the target counts as lost; the filter goes on all the same.
    """

    padding: float = 3.0
    cells: int = 24
    label_sigma: float = 1 / 16
    learning: RegularisedLearning = field(default_factory=RegularisedLearning)
    colour_share: float = 0.3
    colour_rate: float = 0.04
    sizes: int = 11
    size_step: float = 1.03
    size_change: float = 1.06
    size_rate: float = 0.025
    size_colour: float = 2.0
    size_reach: int = 24
    size_margin: float = 0.03
    size_patience: int = 5
    size_agreement: float = 0.95
    size_by_area: float = 0.45
    size_relearning: float = 0.2
    calibration: float = 0.5
    size_area: float = 512.0
    smallest: float = 0.2
    largest: float = 5.0
    lost_below: float = 0.25
