"""When the correlation filter is no longer to be believed, thesis 3.2.2, with two more reasons to doubt."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tsuiseki.tracking.single.foreground_colour import ForegroundColour
from tsuiseki.tracking.single.kcf_particle_settings import KcfParticleSettings
from tsuiseki.tracking.types import FloatArray, ImageArray

COLOUR_RATE = 0.04  # of learning new colours, a look


@dataclass(frozen=True)
class Running:
    """A running mean, plain over the first values, and how a new value compares to it."""

    rate: float = 0.05
    mean: float | None = None
    count: int = 0

    def add(self, value: float) -> Running:
        """With one more value."""
        share = max(self.rate, 1 / (self.count + 1))
        return Running(
            self.rate, value if self.mean is None else self.mean + share * (value - self.mean), self.count + 1
        )

    def falls_below(self, share: float, value: float) -> bool:
        """Whether ``value`` is less than ``share`` of the mean so far."""
        return self.mean is not None and value < share * self.mean


@dataclass(frozen=True)
class Confidence:
    """What the target looked like while it was tracked without doubt.

    Attributes:
        peaks: responses, a frame each.
        colours: colour scores, a look each.
        colour: the colours themselves; None where they are not used or where a box covers the whole image.
    """

    peaks: Running = Running()
    colours: Running = Running(rate=0.1)
    colour: ForegroundColour | None = None

    @classmethod
    def start(cls, settings: KcfParticleSettings, image: ImageArray, box: FloatArray) -> Confidence:
        """From the first frame."""
        wanted = settings.colour or settings.drift_switch
        return cls(colour=ForegroundColour.learn(image, box) if wanted else None)

    def doubts(self, settings: KcfParticleSettings, peak: float, colour: float | None) -> bool:
        """Whether the particle filter takes over, or goes on.

        Args:
            settings: hold the thresholds.
            peak: response of the filter at the target.
            colour: colour score there; None where nobody looked.
        """
        if peak <= settings.switch or self.peaks.falls_below(settings.relative_switch, peak):
            return True
        return colour is not None and self.colours.falls_below(settings.drift_switch, colour)

    def learn(self, image: ImageArray, box: FloatArray, peak: float, colour: float | None) -> Confidence:
        """With one more frame without doubt; ``peak`` and ``colour`` as `doubts` had them."""
        after = replace(self, peaks=self.peaks.add(peak))
        if self.colour is None or colour is None:
            return after
        new = ForegroundColour.learn(image, box)
        return replace(
            after,
            colours=self.colours.add(colour),
            colour=self.colour if new is None else self.colour.blend(new, COLOUR_RATE),
        )

    def colour_score(self, image: ImageArray, box: FloatArray) -> float:
        """Of one box ``(4,)``; 1 where colours are not used."""
        return 1.0 if self.colour is None else float(self.colour.score(image, box[None])[0])
