"""Generated sequences with labels and detections, without pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tsuiseki.datamodules.scenes.people.walkers import Motion
from tsuiseki.datamodules.scenes.street_clip import StreetSettings, plan_street
from tsuiseki.datamodules.simulated_detections import DetectorFaults, simulate_detections
from tsuiseki.tracking.formats.mot import read_ground_truth, write_detections


def write_streets(folder: Path, clips: int, frames: int, motion: Motion = "walk") -> None:
    """Clips without pictures, ``street-N``: labels, and det.txt of detectors from good to poor, at many rates.

    Args:
        folder: is made.
        clips: how many.
        frames: of each.
        motion: of people.
    """
    for number in range(clips):
        rng = np.random.default_rng([number, 1])
        settings = StreetSettings(
            width=320,
            height=240,
            frames=frames,
            frame_rate=float(rng.choice([7, 10, 14, 25, 30])),
            people=int(rng.integers(8, 22)),
            occluders=int(rng.integers(3, 11)),
            person_height=(16.0, 90.0),
            samples=1,
            motion=motion,
        )
        home = folder / f"street-{number:02d}"
        clip = plan_street(settings, number)
        clip.write_truth(home, home.name, [truth for _, truth in clip.frames()])
        truth = read_ground_truth(home / "gt" / "gt.txt")
        # Within what the detections of MOT17, MOT15, KITTI, PETS and TUD are off their labels.
        faults = DetectorFaults(
            jitter=float(rng.uniform(0.02, 0.045)),
            steady=float(rng.uniform(0.7, 0.9)),
            missed=float(rng.uniform(0.03, 0.35)),
            hidden=float(rng.uniform(0.5, 0.95)),
            false_alarms=float(rng.uniform(0.2, 4.0)),
            persistence=float(rng.uniform(0.5, 0.9)),
            doubled=float(rng.uniform(0.0, 0.1)),
        )
        found = simulate_detections(rng, truth, frames, settings.width, settings.height, faults)
        (home / "det").mkdir(parents=True)
        write_detections(home / "det" / "det.txt", found)
