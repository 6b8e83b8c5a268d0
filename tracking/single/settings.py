"""All trackers of one target by their names, and the options by which the command line chooses one."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal, get_args

from pydantic import PositiveFloat
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.features.exported import Appearance
from tsuiseki.tracking.features.objectness import read_objectness
from tsuiseki.tracking.fields import Commas, Options
from tsuiseki.tracking.single import kcf, kcf_particle
from tsuiseki.tracking.single.combined import Combined, CombinedSettings
from tsuiseki.tracking.single.gradient import MeanShift, MedianFlow, Mil
from tsuiseki.tracking.single.matching import ColourParticle, HistogramMatching, PlaceNoise, TemplateMatching
from tsuiseki.tracking.single.mosse import Mosse
from tsuiseki.tracking.single.regularised import RegularisedSettings, RegularisedTracker
from tsuiseki.tracking.single.response_particles import ResponseParticles
from tsuiseki.tracking.single.siamese import open_network
from tsuiseki.tracking.single.siamese_loop import SiameseLoop
from tsuiseki.tracking.single.tracker import SingleTracker
from tsuiseki.tracking.single.witness import UPRIGHT, Recognised
from tsuiseki.tracking.weights import shipped

SingleMethod = Literal[
    "combined",
    "siamese",
    "regularised",
    "kcf-particle",
    "kcf",
    "csk",
    "mosse",
    "template",
    "template-ssd",
    "template-sad",
    "histogram",
    "kalman",
    "meanshift",
    "camshift",
    "medianflow",
    "colour-particle",
    "mil",
]
METHODS: tuple[SingleMethod, ...] = get_args(SingleMethod)
SinglePreset = Literal["robust", "thesis", "printed", "paper"]
SIZED = ("combined", "regularised", "kcf-particle", "kcf")
"""Methods that can try other sizes; combined without a network."""
NONE = (Path("none"),)
"""As a network: none."""
PLAIN: dict[SingleMethod, Callable[[int], SingleTracker]] = {
    "csk": lambda _: kcf.KcfTracker(kcf.CSK),
    "mosse": Mosse,
    "template": lambda _: TemplateMatching(),
    "template-ssd": lambda _: TemplateMatching("ssd"),
    "template-sad": lambda _: TemplateMatching("sad"),
    "histogram": lambda _: HistogramMatching(),
    "kalman": lambda _: TemplateMatching(noise=PlaceNoise()),
    "meanshift": lambda _: MeanShift(),
    "camshift": lambda _: MeanShift(adapts_size=True),
    "medianflow": lambda _: MedianFlow(),
    "colour-particle": ColourParticle,
    "mil": Mil,
}
"""Those of chapter 2, without settings, by the seed of their random numbers."""
KCF_PRESETS = {"robust": kcf.KcfSettings(), "thesis": kcf.THESIS, "paper": kcf.KCF_PAPER}
PARTICLE_PRESETS = {"robust": kcf_particle.ROBUST, "printed": kcf_particle.PRINTED}


@dataclass(frozen=True, config=SETTINGS)
class SingleChoice(Options):
    """A method and its variant.

    Attributes:
        method: how to follow. combined is a `network` whose response weighs particles; without one it is a correlation
            filter with colours and sizes that particles challenge where it is in doubt; siamese is the plain loop about
            a `network`; regularised is the filter of combined alone; kcf is a plain filter, and faster; kcf-particle
            joins kcf and particles as the thesis does; the others are simpler and are there to compare with.
        network: ONNX files of a tracker: NanoTrack's backbone and head, VitTrack's one file, or both of this toolkit's;
            by default the shipped ones. none leaves combined to its filter.
        preset: constants of kcf and kcf-particle. robust is ours; thesis, paper (both kcf only) and printed
            (kcf-particle only: the thesis to the letter) are the published ones.
        scale: whether combined, regularised, kcf and kcf-particle also try other sizes; by default the first two
            do, and the others as the preset says.
        recognise: also report lost where the shipped appearance network finds an upright person unlike the first frame;
            combined does so by itself.
        objectness: model for kcf-particle from `tsuiseki train objectness`.
        noise: of kalman, of velocity and place, in sides; by default 0.1,0.05.
    """

    method: SingleMethod = "combined"
    network: Commas[tuple[Path, ...]] = ()
    preset: SinglePreset = "robust"
    scale: bool | None = None
    recognise: bool = False
    objectness: Path | None = None
    noise: Commas[tuple[PositiveFloat, PositiveFloat] | None] = None

    def __post_init__(self) -> None:
        method, preset = self.method, self.preset
        taker = {"paper": "kcf", "printed": "kcf-particle", "thesis": "kcf"}.get(preset, method)
        if method != taker:
            raise RequestError(f"`preset` {preset}: expected with the method {taker}, got {method}")
        if self.network and method not in ("combined", "siamese"):
            raise RequestError(f"`network`: expected with `method` combined or siamese, got {method}")
        if method == "siamese" and self.network == NONE:
            raise RequestError("`network`: expected the files of a network with `method` siamese, got none")
        if method == "combined" and self.network != NONE and self.scale is not None:
            raise RequestError("`scale`: expected with `network` none, for a network gives the size itself")
        if self.objectness is not None and method != "kcf-particle":
            raise RequestError(f"`objectness`: expected with `method` kcf-particle only, got {method}")
        if self.noise is not None and method != "kalman":
            raise RequestError(f"`noise`: expected with `method` kalman only, got {method}")
        if self.scale is not None and method not in SIZED:
            raise RequestError(f"`scale`: expected with `method` {', '.join(SIZED[:-1])} or {SIZED[-1]}, got {method}")

    def tracker(self, seed: int = 0) -> SingleTracker:
        """A fresh tracker."""
        tracker = self._follower(seed)
        if not self.recognise or self.method == "combined":
            return tracker
        return Recognised(tracker, Appearance(shipped("appearance_people")).describe)

    def _follower(self, seed: int) -> SingleTracker:
        regularised = RegularisedSettings(sizes=1) if self.scale is False else RegularisedSettings()
        if self.method == "combined" and self.network == NONE:
            return Combined(CombinedSettings(regularised), seed)
        if self.method in ("combined", "siamese"):
            network = open_network(self.network or [shipped("tracker_template"), shipped("tracker_search")])
            return ResponseParticles(network, seed) if self.method == "combined" else SiameseLoop(network)
        if self.method == "regularised":
            return RegularisedTracker(regularised)
        if self.method == "kcf":
            return kcf.KcfTracker(self._sized(KCF_PRESETS[self.preset]))
        if self.method == "kcf-particle":
            settings = PARTICLE_PRESETS[self.preset]
            model = None if self.objectness is None else read_objectness(self.objectness)
            return kcf_particle.KcfParticle(replace(settings, kcf=self._sized(settings.kcf)), seed, model)
        if self.noise is not None:
            return TemplateMatching(noise=PlaceNoise(*self.noise))
        return PLAIN[self.method](seed)

    def _sized(self, settings: kcf.KcfSettings) -> kcf.KcfSettings:
        if self.scale is None:
            return settings
        return replace(settings, scale_step=kcf.KcfSettings().scale_step if self.scale else 1.0)


def warn_if_not_asked(tracker: SingleTracker) -> None:
    """Say so where the network of people was not asked about what has been followed."""
    if isinstance(tracker, Recognised) and not tracker.asked:
        warnings.warn(
            f"`recognise`: the first box is not {UPRIGHT:g} times as high as wide, so not a person's; "
            "the network of people was not asked",
            InputWarning,
            stacklevel=2,
        )
