"""Generated streets: labels with simulated detections in numbers, and a few clips with their pictures."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.datamodules.scenes.drone_clip import DroneSceneSettings, plan_drone
from tsuiseki.datamodules.scenes.street_clip import StreetSettings, plan_street
from tsuiseki.datamodules.simulated_detections import DetectorFaults, simulate_detections
from tsuiseki.tracking.formats.mot import read_ground_truth, write_detections
from tsuiseki.trainers.association.videos import LIKE_REAL
from tsuiseki.trainers.experiments.association.sequences import DataSet

STREETS = DataSet("streets", "generated streets", "streets")


@dataclass(frozen=True)
class StreetCount:
    """How many clips of how many frames.

    Attributes:
        clips: number of clips.
        frames: of each.
        seed: of the first.
    """

    clips: int = 10
    frames: int = 120
    seed: int = 0


def write_streets(folder: Path, count: StreetCount) -> None:
    """Clips without pictures, ``street-N``: labels, and det.txt of detectors from good to poor, at many rates.

    Args:
        folder: is made.
        count: how many.
    """
    for number in range(count.clips):
        rng = np.random.default_rng([count.seed + number, 1])
        settings = StreetSettings(
            width=320,
            height=240,
            frames=count.frames,
            frame_rate=float(rng.choice([7, 10, 14, 25, 30])),
            people=int(rng.integers(8, 22)),
            occluders=int(rng.integers(3, 11)),
            person_height=(16.0, 90.0),
            samples=1,
        )
        home = folder / f"street-{number:02d}"
        clip = plan_street(settings, count.seed + number)
        clip.write_truth(home, home.name, [truth for _, truth in clip.frames()])
        _write_det(home, settings, rng, _faults(rng))


def write_drones(folder: Path, count: StreetCount, look_alikes: float) -> None:
    """Clips from a drone that hovers, with pictures, 10 frames a second, and det.txt of one simulated detector.

    Args:
        folder: is made.
        count: how many.
        look_alikes: probability of being dressed much like somebody else around.
    """
    settings = DroneSceneSettings(
        640, 360, count.frames, 10.0, camera="calm", altitude=(10.0, 20.0), look_alikes=look_alikes, samples=1
    )
    for number in range(count.clips):
        home = write_clip(folder / f"drone-{number:02d}", plan_drone(settings, count.seed + number))
        _write_det(home, settings, np.random.default_rng([count.seed + number, 3]), replace(LIKE_REAL, missed=0.1))


def write_pictured(folder: Path, count: StreetCount, look_alikes: float) -> None:
    """Clips with pictures, 10 frames a second, and det.txt of one simulated detector.

    Args:
        folder: is made.
        count: how many.
        look_alikes: probability of being dressed much like somebody else around.
    """
    for number in range(count.clips):
        settings = StreetSettings(
            frames=count.frames, frame_rate=10.0, people=12, look_alikes=look_alikes, person_height=(40.0, 170.0)
        )
        home = write_clip(folder / f"street-{number:02d}", plan_street(settings, count.seed + number))
        _write_det(home, settings, np.random.default_rng([count.seed + number, 2]), replace(LIKE_REAL, missed=0.1))


def _faults(rng: np.random.Generator) -> DetectorFaults:
    """Within what the detections of MOT17, MOT15, KITTI, PETS and TUD are off their labels."""
    return DetectorFaults(
        jitter=float(rng.uniform(0.02, 0.045)),
        steady=float(rng.uniform(0.7, 0.9)),
        missed=float(rng.uniform(0.03, 0.35)),
        hidden=float(rng.uniform(0.5, 0.95)),
        false_alarms=float(rng.uniform(0.2, 4.0)),
        persistence=float(rng.uniform(0.5, 0.9)),
        doubled=float(rng.uniform(0.0, 0.1)),
    )


def _write_det(
    home: Path, settings: StreetSettings | DroneSceneSettings, rng: np.random.Generator, faults: DetectorFaults
) -> None:
    truth = read_ground_truth(home / "gt" / "gt.txt")
    found = simulate_detections(rng, truth, settings.frames, settings.width, settings.height, faults)
    (home / "det").mkdir(parents=True)
    write_detections(home / "det" / "det.txt", found)
