"""Constants of the combined tracker."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from tsuiseki.tracking.single.regularised_settings import RegularisedSettings
from tsuiseki.tracking.single.seen_before import SeenBeforeSettings


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
        doubtful_rate: speed of learning at the beginning of a doubt, in [0, 1].
        hidden: share of the running median under which a response says that the target is hidden: nothing is learnt.
        lost_after: frames of doubt after which the target counts as lost.
        stored: filters kept from frames without doubt, beside the first frame's.
        store_interval: frames between them.
        particles: N.
        renewed: share of the particles that are drawn anew in every frame of a doubt, at the maxima of all filters.
        roaming: further windows, all over the picture in turn, that are searched in a frame once the target is lost.
        reach: windows searched to each side of the one about the target; 1 gives 3 x 3.
        spread: standard deviation of the particles' step, as a share of the target's sides.
        size_spread: likewise of the logarithm of their size; 0 leaves it as it is. More takes three times as long.
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
    doubtful_rate: float = 0.25
    hidden: float = 0.4
    lost_after: int = 5
    stored: int = 3
    store_interval: int = 25
    particles: int = 200
    renewed: float = 0.25
    roaming: int = 0
    reach: int = 1
    spread: float = 0.25
    size_spread: float = 0.0
    sharpness: float = 20.0
    margin: float = 0.1
    wins: int = 3
    seen_before: SeenBeforeSettings = field(default_factory=SeenBeforeSettings)


def redetecting(settings: CombinedSettings) -> CombinedSettings:
    """``settings`` that also find a lost target that comes back anywhere in the picture."""
    return replace(settings, roaming=4)
