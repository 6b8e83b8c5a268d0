"""Constants of the combined tracker: the thesis's, and ours."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from tsuiseki.tracking.single import kcf

Past = Literal["uniform", "score"]
Covariance = Literal["variances", "deviations"]
ResponseScale = Literal["printed", "greatest"]
Agreement = Literal["covariance", "lengths", "pixels"]
WindowsOf = Literal["target", "particles"]
Mixture = Literal["uniform", "heights"]
LearnsAt = Literal["heaviest", "mean"]


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

        covariance: what w1 / a and h1 / a of S are, see `particles.step_deviation`.
        response_scale: r of (3.4) as it is ``printed``, or over the ``greatest`` response of the frame.
        agreement: C of (3.7) is the ``covariance`` S of the motion; the diagonal w1 / a and h1 / a (``lengths``),
            whatever the motion takes them for; or one square pixel (``pixels``).
        decides_always: the response is compared with epsilon_1 in every frame, as Fig. 3.2 can be read: during a
            search a filter whose response is above it goes on alone at once.
        windows_of: about what the window of (3.5) lies: the ``target``'s place in the frame before, one window for all;
            or each of the ``particles``' own place in the frame before, which takes a window a particle.
        mixture: P_J, the weights of (3.1): ``uniform`` as printed in Table 3.2, or by the ``heights`` of the maxima.

        learns_at: where a filter learns in a search: at the place of its ``heaviest`` particle, or at the weighted
            ``mean`` of its particles.
        resampled_below: share of N that the effective number of particles must fall below for them to be resampled;
            1 resamples them in every frame.

        spread: factor on the standard deviation of S: 2.7 pixels for a target of 25 is less than people move.
        reach: windows searched to each side of the one about the target; 0 is the thesis.
        sharpness: power of the likelihood; responses of right and wrong places differ by less than a factor of two.
        colour: weight of `ForegroundColour` in the exponent of the likelihood; 0 leaves it out.
        relative_switch: the search also starts when the response falls below this share of its running mean.
        drift_switch: likewise for the colour score: a filter that has settled on the background stays confident.
        drift_interval: frames between checks of the colours.
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
        redetect_reach: like ``reach``, once it is lost; 0 leaves ``reach``.
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

    covariance: Covariance = "variances"
    response_scale: ResponseScale = "printed"
    agreement: Agreement = "covariance"
    decides_always: bool = False
    windows_of: WindowsOf = "target"
    mixture: Mixture = "uniform"
    learns_at: LearnsAt = "heaviest"
    resampled_below: float = 1.0

    spread: float = 1.0
    reach: int = 0
    sharpness: float = 1.0
    colour: float = 0.0
    relative_switch: float = 0.0
    drift_switch: float = 0.0
    drift_interval: int = 5
    ends_when_sure: bool = False
    longest_search: int = 30
    learns_while_searching: bool = True
    keeps_first: bool = False
    prefers_near: bool = False
    climbs: bool = False
    densest: bool = False
    store_interval: int = 1
    lost_after: int = 30
    redetect_reach: int = 0


PRINTED = KcfParticleSettings()
THESIS = KcfParticleSettings(covariance="deviations", response_scale="greatest")
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
