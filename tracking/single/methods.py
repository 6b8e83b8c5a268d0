"""All trackers of one target by the names that the command line takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, get_args

from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.colour_particle import ColourParticle
from tsuiseki.tracking.single.combined import Combined
from tsuiseki.tracking.single.combined_settings import CombinedSettings
from tsuiseki.tracking.single.gradient import MeanShift, MedianFlow, Mil
from tsuiseki.tracking.single.interface import SingleTracker
from tsuiseki.tracking.single.kcf_particle import KcfParticle
from tsuiseki.tracking.single.kcf_particle_settings import (
    PRINTED,
    ROBUST,
    THESIS,
    KcfParticleSettings,
)
from tsuiseki.tracking.single.kcf_tracker import KcfTracker
from tsuiseki.tracking.single.matching import HistogramMatching, TemplateMatching
from tsuiseki.tracking.single.mosse import Mosse
from tsuiseki.tracking.single.regularised import RegularisedTracker

SingleMethod = Literal[
    "combined",
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


def make_tracker(
    method: SingleMethod, preset: SinglePreset = "robust", scale_search: bool | None = None, seed: int = 0
) -> SingleTracker:
    """A new tracker.

    Args:
        method: one of `METHODS`.
        preset: constants of ``kcf`` and ``kcf-particle``: ours (``robust``), the thesis's as we read it (``thesis``)
            or to the letter (``printed``, of ``kcf-particle``), or (``kcf``) those of the KCF paper.
        scale_search: whether those two, ``combined`` and ``regularised`` try other sizes; by default as the preset
            says, and for the last two they do.
        seed: of its random numbers.
    """
    makers: dict[SingleMethod, Callable[[], SingleTracker]] = {
        "combined": lambda: Combined(_combined_settings(scale_search), seed),
        "regularised": lambda: RegularisedTracker(_combined_settings(scale_search).filter, seed),
        "kcf-particle": lambda: KcfParticle(_particle_settings(preset, scale_search), seed),
        "kcf": lambda: KcfTracker(_sized(KCF_PRESETS[preset], scale_search), seed=seed),
        "csk": lambda: KcfTracker(kcf.CSK, seed=seed),
        "mosse": lambda: Mosse(seed),
        "template": lambda: TemplateMatching(seed=seed),
        "template-ssd": lambda: TemplateMatching("ssd", seed=seed),
        "template-sad": lambda: TemplateMatching("sad", seed=seed),
        "histogram": lambda: HistogramMatching(seed=seed),
        "kalman": lambda: TemplateMatching("ncc", smoothed=True, seed=seed),
        "meanshift": lambda: MeanShift(seed=seed),
        "camshift": lambda: MeanShift(adapts_size=True, seed=seed),
        "medianflow": lambda: MedianFlow(seed=seed),
        "colour-particle": lambda: ColourParticle(seed=seed),
        "mil": lambda: Mil(seed),
    }
    return makers[method]()


KCF_PRESETS: dict[SinglePreset, kcf.KcfSettings] = {
    "robust": kcf.KcfSettings(),
    "thesis": kcf.THESIS,
    "paper": kcf.KCF_PAPER,
}
PARTICLE_PRESETS: dict[SinglePreset, KcfParticleSettings] = {"robust": ROBUST, "thesis": THESIS, "printed": PRINTED}


def _sized(settings: kcf.KcfSettings, scale_search: bool | None) -> kcf.KcfSettings:
    if scale_search is None:
        return settings
    return replace(settings, scale_step=kcf.KcfSettings().scale_step if scale_search else 1.0)


def _combined_settings(scale_search: bool | None) -> CombinedSettings:
    settings = CombinedSettings()
    return settings if scale_search in (None, True) else replace(settings, filter=replace(settings.filter, sizes=1))


def _particle_settings(preset: SinglePreset, scale_search: bool | None) -> KcfParticleSettings:
    settings = PARTICLE_PRESETS[preset]
    return replace(settings, kcf=_sized(settings.kcf, scale_search))
