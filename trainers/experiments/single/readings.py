"""What the text of thesis chapter 3 can mean, each reading over KCF of the same fixed size.

Open are: whether S holds variances or deviations, and whether in the motion and in (3.7) alike; whether r is as the
filter gives it or over the greatest response of the frame; the unit of V in (3.7), which is compared with an area;
whether the response is compared with epsilon_1 during a search, too (Fig. 3.2); at which of its particles a filter
learns (3.2.7); and when particles are resampled.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.kcf_particle_settings import PRINTED, THESIS, KcfParticleSettings
from tsuiseki.trainers.experiments.experiment import Outcome, Table
from tsuiseki.trainers.experiments.single.runs import Clip
from tsuiseki.trainers.experiments.single.unseen import areas, interval
from tsuiseki.trainers.experiments.store import Store

BASE = kcf.THESIS
READINGS: Mapping[str, KcfParticleSettings] = {
    "as printed": PRINTED,
    "S of deviations": replace(PRINTED, covariance="deviations"),
    "r over the greatest": replace(PRINTED, response_scale="greatest"),
    "both (preset thesis)": THESIS,
    "V in square pixels": replace(PRINTED, agreement="pixels"),
    "both, C of lengths": replace(THESIS, agreement="lengths"),
    "both, confidence looked at in every frame": replace(THESIS, decides_always=True),
    "both, C of lengths, confidence in every frame": replace(THESIS, agreement="lengths", decides_always=True),
    "both, the densest place put out": replace(THESIS, densest=True),
    "both, P_J by the heights of the maxima": replace(THESIS, mixture="heights"),
    "both, a window about each particle": replace(THESIS, windows_of="particles"),
    "both, filters learn at the mean of their particles": replace(THESIS, learns_at="mean"),
    "both, C of lengths, filters learn at the mean of their particles": replace(
        THESIS, agreement="lengths", learns_at="mean"
    ),
    "both, resampled below half of N": replace(THESIS, resampled_below=0.5),
    "both, C of lengths, a window about each particle": replace(THESIS, agreement="lengths", windows_of="particles"),
}


def readings(store: Store, clips: Sequence[Clip], seeds: Sequence[int]) -> Outcome:
    """A row a reading: the mean area of the sequences, and the gain over KCF with its interval over sequences."""
    base = areas(store, clips, BASE, seeds)
    found = {name: areas(store, clips, settings, seeds) for name, settings in READINGS.items()}
    rows = [("KCF", f"{base.mean():.1f}", "")]
    for name, row in found.items():
        mean, low, high = interval(row - base)
        rows.append((name, f"{row.mean():.1f}", f"{mean:+.1f} [{low:.1f}, {high:.1f}]"))
    names = [clip.sequence.name for clip in clips]
    title = "Readings of chapter 3, fixed size: AUC [%], 21 thresholds"
    values = {"sequences": names, "KCF": base.tolist(), **{name: row.tolist() for name, row in found.items()}}
    return Outcome(
        {"readings": values}, [Table(title, ("reading", "mean", "over KCF, 95 % interval over sequences"), rows)]
    )
