"""All trackers of one target by their names, and the options by which the command line chooses one."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.features.exported import Appearance
from tsuiseki.tracking.features.objectness import read_objectness
from tsuiseki.tracking.options import Shared
from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.combined import Combined
from tsuiseki.tracking.single.constants import (
    PRINTED,
    ROBUST,
    CombinedSettings,
    KcfParticleSettings,
)
from tsuiseki.tracking.single.gradient import MeanShift, MedianFlow, Mil
from tsuiseki.tracking.single.kcf import KcfTracker
from tsuiseki.tracking.single.kcf_particle import KcfParticle
from tsuiseki.tracking.single.matching import ColourParticle, HistogramMatching, TemplateMatching
from tsuiseki.tracking.single.mosse import Mosse
from tsuiseki.tracking.single.recognised import Recognised
from tsuiseki.tracking.single.regularised import RegularisedTracker
from tsuiseki.tracking.single.tracker import SingleTracker
from tsuiseki.tracking.weights import shipped

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
        preset: constants of ``kcf`` and ``kcf-particle``: ours (``robust``), the thesis's (``thesis`` of ``kcf``,
            ``printed`` of ``kcf-particle``), or those of the KCF paper (``paper`` of ``kcf``).
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
PARTICLE_PRESETS: dict[SinglePreset, KcfParticleSettings] = {"robust": ROBUST, "printed": PRINTED}


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


def single_tracker(
    method: SingleMethod | SingleTracker, preset: SinglePreset = "robust", seed: int = 0
) -> SingleTracker:
    """A fresh tracker by its name; a tracker as it is.

    Raises:
        RequestError: there is no such method or preset, or the two do not go together.
    """
    if not isinstance(method, str):
        return method
    if method not in METHODS:
        raise RequestError(f"expected the method {', '.join(METHODS)} or a tracker, got {method!r}")
    if preset not in get_args(SinglePreset):
        raise RequestError(f"expected the preset {', '.join(get_args(SinglePreset))}, got {preset!r}")
    check_preset(method, preset)
    return make_tracker(method, preset, seed=seed)


def check_preset(method: SingleMethod, preset: SinglePreset) -> None:
    """Refuse constants that a method does not have.

    Raises:
        RequestError: the two do not go together.
    """
    takers = {"paper": "kcf", "printed": "kcf-particle", "thesis": "kcf"}.get(preset)
    if takers is not None and method != takers:
        raise RequestError(f"`preset` {preset}: expected with the method {takers}, got {method}")


@dataclass(frozen=True)
class SingleChoice(Shared):
    """A method and its variant.

    Attributes:
        method: how to follow. combined is a correlation filter with colours and sizes that particles challenge where it
            is in doubt; regularised is that filter alone; kcf is a plain filter, and faster; kcf-particle joins kcf and
            particles as the thesis does; the others are simpler and are there to compare with.
        preset: constants of kcf and kcf-particle. robust is ours; thesis, paper (both kcf only) and printed
            (kcf-particle only: the thesis to the letter) are the published ones.
        scale: whether combined, regularised, kcf and kcf-particle also look for other sizes; by default the first two
            do, and the others as the preset says.
        recognise: also say lost where the target, a person, no longer looks as in the first frame, by the shipped
            appearance network; combined also lets it choose where to go on. It is asked only where the first box is as
            upright as a person.
        objectness: model for kcf-particle from `tsuiseki train objectness`; by default the shipped one.
    """

    method: SingleMethod = "combined"
    preset: SinglePreset = "robust"
    scale: bool | None = None
    recognise: bool = False
    objectness: Path | None = None

    def tracker(self, seed: int = 0) -> tuple[SingleTracker, dict[str, Any]]:
        """A fresh tracker, and its constants.

        Raises:
            RequestError: the method does not take something that is asked for.
        """
        tracker, constants = self._plain(seed)
        if not self.recognise:
            return tracker, constants
        recognised = Recognised(tracker, Appearance(shipped("appearance_people")).describe)
        return recognised, {**constants, "recognition": asdict(recognised.settings)}

    def _plain(self, seed: int) -> tuple[SingleTracker, dict[str, Any]]:
        check_preset(self.method, self.preset)
        tracker = make_tracker(self.method, self.preset, self.scale, seed)
        if self.objectness is not None:
            if not isinstance(tracker, KcfParticle):
                raise RequestError(f"`objectness`: expected with `method` kcf-particle only, got {self.method}")
            tracker = KcfParticle(tracker.settings, seed, read_objectness(self.objectness))
        if self.scale is not None and self.method not in ("combined", "regularised", "kcf", "kcf-particle"):
            sized = "combined, regularised, kcf-particle or kcf"
            raise RequestError(f"`scale`: expected with `method` {sized}, got {self.method}")
        own = getattr(tracker, "settings", None)
        return tracker, asdict(own) if own is not None else {}


def warn_if_not_asked(tracker: SingleTracker) -> None:
    """Say so where the network of people was not asked about what has been followed."""
    if isinstance(tracker, Recognised) and not tracker.asked:
        warnings.warn(
            f"`recognise`: the first box is not {tracker.settings.upright:g} times as high as wide, so not a person's; "
            "the network of people was not asked",
            InputWarning,
            stacklevel=2,
        )
