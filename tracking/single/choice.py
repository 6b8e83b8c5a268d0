"""How one target is followed: the method and what it is asked to do, as the command line takes them."""

from __future__ import annotations

import warnings
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.features.networks.exported import Appearance
from tsuiseki.tracking.features.objectness import read_objectness
from tsuiseki.tracking.options import Shared
from tsuiseki.tracking.single.combined import Combined
from tsuiseki.tracking.single.combined_settings import redetecting
from tsuiseki.tracking.single.interface import SingleTracker
from tsuiseki.tracking.single.kcf_particle import KcfParticle
from tsuiseki.tracking.single.kcf_particle_settings import Past
from tsuiseki.tracking.single.methods import SingleMethod, SinglePreset, make_tracker
from tsuiseki.tracking.single.recognised import Recognised
from tsuiseki.tracking.single.tracking import check_preset
from tsuiseki.tracking.weights import shipped


@dataclass(frozen=True)
class SingleChoice(Shared):
    """A method and its variant.

    Attributes:
        method: how to follow. combined is a correlation filter with colours and sizes that particles challenge where it
            is in doubt; regularised is that filter alone; kcf is a plain filter, and faster; kcf-particle joins kcf and
            particles as the thesis does; the others are simpler and are there to compare with.
        preset: constants of kcf and kcf-particle. robust is ours; thesis, printed (kcf-particle only: the thesis to
            the letter) and paper (kcf only) are the published ones.
        scale: whether combined, regularised, kcf and kcf-particle also look for other sizes; by default the first two
            do, and the others as the preset says.
        past: how kcf-particle draws filters of the past, all alike or by their score; by default as the preset says.
        redetect: kcf-particle searches a wider area for a lost target, and combined the whole picture, a few windows a
            frame: for targets that leave the view and come back elsewhere.
        recognise: also say lost where the target, a person, no longer looks as in the first frame, by the shipped
            appearance network; combined also lets it choose where to go on. It is asked only where the first box is as
            upright as a person.
        objectness: model for kcf-particle from `tsuiseki train objectness`; by default the shipped one.
    """

    method: SingleMethod = "combined"
    preset: SinglePreset = "robust"
    scale: bool | None = None
    past: Past | None = None
    redetect: bool = False
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
        if isinstance(tracker, KcfParticle):
            return self._kcf_particle(tracker, seed)
        redetect = self.redetect
        if isinstance(tracker, Combined) and redetect:
            tracker, redetect = Combined(redetecting(tracker.settings), seed), False
        if redetect:
            raise RequestError(f"`redetect`: expected with `method` combined or kcf-particle, got {self.method}")
        for name, value in (("past", self.past), ("objectness", self.objectness)):
            if value is not None:
                raise RequestError(f"`{name}`: expected with `method` kcf-particle only, got {self.method}")
        if self.scale is not None and self.method not in ("combined", "regularised", "kcf"):
            sized = "combined, regularised, kcf-particle or kcf"
            raise RequestError(f"`scale`: expected with `method` {sized}, got {self.method}")
        own = getattr(tracker, "settings", None)
        return tracker, asdict(own) if own is not None else {}

    def _kcf_particle(self, tracker: KcfParticle, seed: int) -> tuple[SingleTracker, dict[str, Any]]:
        settings = tracker.settings
        if self.past is not None:
            settings = replace(settings, past=self.past)
        if self.redetect:
            settings = replace(settings, redetect_reach=3)
        model = read_objectness(self.objectness) if self.objectness is not None else None
        return KcfParticle(settings, seed, model), asdict(settings)


def warn_if_not_asked(tracker: SingleTracker) -> None:
    """Say so where the network of people was not asked about what has been followed."""
    if isinstance(tracker, Recognised) and not tracker.asked:
        warnings.warn(
            f"`recognise`: the first box is not {tracker.settings.upright:g} times as high as wide, so not a person's; "
            "the network of people was not asked",
            InputWarning,
            stacklevel=2,
        )
