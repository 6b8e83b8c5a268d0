"""Constants of the trackers `kcf_particle`, `regularised` and `combined`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from tsuiseki.tracking.filters.regularised_correlation import RegularisedLearning
from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.seen_before import SeenBeforeSettings

Past = Literal["uniform", "score"]

DRIFT_INTERVAL = 5
"""Frames between checks of the colours."""


@dataclass(frozen=True)
class KcfParticleSettings:
    """Constants; the defaults are Table 3.2 and the choices of 3.3.3, as they are printed.

    Attributes:
        kcf: of the correlation filters.
        switch: epsilon_1, the search starts when the greatest response is at most this.
        plain_frames: H, frames after a search in which none starts.
        stored: U, filters of the past.
        particles: N.
        divisor: a, of the covariance S of the motion.
        past_share: mu, probability of a filter of the past.
        convergence: epsilon_2, the search ends when V / (w1 h1) is below.
        response_share: alpha of equation (3.4); 1 leaves objectness out.
        hypotheses: M, maxima of the response.
        past: filters of the past drawn all alike, or by the response that each had when it was stored.

        spread: factor on the standard deviation of S: 2.7 pixels for a target of 25 is less than people move.
        reach: windows searched to each side of the one about the target; 0 is the thesis.
        sharpness: power of the likelihood; responses of right and wrong places differ by less than a factor of two.
        colour: weight of `ForegroundColour` in the exponent of the likelihood; 0 leaves it out.
        relative_switch: the search also starts when the response falls below this share of its running mean.
        drift_switch: likewise for the colour score: a filter that has settled on the background stays confident.
        ends_when_sure: the search goes on while there is still a reason to start one.
        longest_search: frames after which such a search ends all the same, since the target may look different for
            good; what follows counts as tracked only once there is no doubt.
        learns_while_searching: whether filters learn before it is known who is right.
        keeps_first: keep the filter of the first frame, the only one that is surely right, in the store.
        prefers_near: maxima near the last place are drawn more often, by `particles.jump_prior`, instead of P_J = 1/M.
        densest: output the place where particles are dense, by `particles.densest`, not the heaviest particle's.
        climbs: output the maximum of the response uphill from the best particle, not the particle.
        store_interval: frames between stored filters.
        lost_after: frames of search after which the target counts as lost.
    """

    kcf: kcf.KcfSettings = field(default_factory=lambda: kcf.THESIS)
    switch: float = 0.2
    plain_frames: int = 50
    stored: int = 20
    particles: int = 200
    divisor: float = 10 / 3
    past_share: float = 0.5
    convergence: float = 0.03
    response_share: float = 0.3
    hypotheses: int = 20
    past: Past = "uniform"

    spread: float = 1.0
    reach: int = 0
    sharpness: float = 1.0
    colour: float = 0.0
    relative_switch: float = 0.0
    drift_switch: float = 0.0
    ends_when_sure: bool = False
    longest_search: int = 30
    learns_while_searching: bool = True
    keeps_first: bool = False
    prefers_near: bool = False
    climbs: bool = False
    densest: bool = False
    store_interval: int = 1
    lost_after: int = 30


PRINTED = KcfParticleSettings()
ROBUST = KcfParticleSettings(
    kcf=kcf.KcfSettings(),
    plain_frames=3,
    past="score",
    spread=3.0,
    reach=1,
    sharpness=2.0,
    colour=6.0,
    relative_switch=0.65,
    drift_switch=0.7,
    ends_when_sure=True,
    longest_search=10,
    stored=8,
    store_interval=3,
    learns_while_searching=False,
    keeps_first=True,
    prefers_near=True,
    climbs=True,
    densest=True,
)

COLOUR_SHARE_LEARNT = 0.04
"""Share of a new frame in the histograms, in [0, 1]."""
SIZE_CHANGE = 1.06
"""Greatest factor on the size in a frame."""
SIZE_RATE = 0.025
"""Share of a new frame in the size filter, in [0, 1]."""
SIZE_COLOUR = 2.0
"""Weight of the contrast of colours beside the size filter's response."""
SIZE_RELEARNING = 0.2
"""Share of a new frame in the size filter while the size follows."""
SIZE_AREA = 512.0
"""Pixels of the template of the size filter."""
SIZE_STEP = 1.03
"""Ratio of neighbouring sizes."""
LOST_BELOW = 0.25
"""Response under which the target counts as lost; the filter goes on all the same."""


@dataclass(frozen=True)
class RegularisedSettings:
    """Constants.

    Attributes:
        padding: side of the square window over the geometric mean of the target's sides, > 1.
        cells: along the window's longer side.
        label_sigma: of the wanted response, as a share of the geometric mean of the target's sides.
        learning: of the filter.
        colour_share: of the colours in the response of a place, in [0, 1].
        sizes: how many are tried in a frame, odd; 1 keeps the first size.
        size_reach: steps of size to each side among which the colours look for one far from the present size, which
            the size filter does not see; 0 looks for none.
        size_margin: how much greater the contrast of colours must be there.
        size_patience: frames in a row in which it must be, always on the same side, before the size follows it.
        size_agreement: share of its response at the present size that the filter of places must have on the way there.
        size_by_area: contrast of colours from which on the number of the target's pixels tells the size, which needs
            no agreement then; 2 never does.
        calibration: share of the first frame's calibration of the contrast of colours that is used, in [0, 1].
        smallest: least size relative to the first.
        largest: greatest size relative to the first.
    """

    padding: float = 3.0
    cells: int = 24
    label_sigma: float = 1 / 16
    learning: RegularisedLearning = field(default_factory=RegularisedLearning)
    colour_share: float = 0.3
    sizes: int = 11
    size_reach: int = 24
    size_margin: float = 0.03
    size_patience: int = 5
    size_agreement: float = 0.95
    size_by_area: float = 0.45
    calibration: float = 0.5
    smallest: float = 0.2
    largest: float = 5.0


DOUBTFUL_RATE = 0.25
"""Speed of learning at the beginning of a doubt, in [0, 1]."""


@dataclass(frozen=True)
class CombinedSettings:
    """Constants.

    Attributes:
        filter: of the filter that goes on alone.
        doubt: share of its running median under which a response is low, where the colours are low, too.
        colour_doubt: likewise for the colours.
        sure: share of its running median from which on a response ends the doubt.
        memory: frames of the running medians.
        certain: share of its running median from which on a response without doubt is learnt at full speed.
        hidden: share of the running median under which a response says that the target is hidden: nothing is learnt.
        lost_after: frames of doubt after which the target counts as lost.
        stored: filters kept from frames without doubt, beside the first frame's.
        store_interval: frames between them.
        particles: N.
        renewed: share of the particles that are drawn anew in every frame of a doubt, at the maxima of all filters.
        reach: windows searched to each side of the one about the target; 1 gives 3 x 3.
        spread: standard deviation of the particles' step, as a share of the target's sides.
        sharpness: factor on the response in the log-likelihood.
        margin: how much more than the filter's a challenger's response must be.
        wins: frames in a row in which it must be.
        seen_before: when the box shows what stood there before; then the status is lost.
    """

    filter: RegularisedSettings = field(default_factory=RegularisedSettings)
    doubt: float = 0.6
    colour_doubt: float = 0.95
    sure: float = 0.75
    memory: int = 50
    certain: float = 0.8
    hidden: float = 0.4
    lost_after: int = 5
    stored: int = 3
    store_interval: int = 25
    particles: int = 200
    renewed: float = 0.25
    reach: int = 1
    spread: float = 0.25
    sharpness: float = 20.0
    margin: float = 0.1
    wins: int = 3
    seen_before: SeenBeforeSettings = field(default_factory=SeenBeforeSettings)
