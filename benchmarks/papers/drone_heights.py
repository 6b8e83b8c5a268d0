"""The default flow beside the thesis's literal chain from three heights (`drone-heights`), without actions."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from cyclopts.types import PositiveInt

from benchmarks.papers.drone_actions import COLUMNS, METHODS, ObservedClip, people_rows, person_row
from benchmarks.papers.outcome import Outcome
from benchmarks.papers.store import Cached, Store, write_planned
from benchmarks.papers.tables import Table
from tsuiseki.datamodules.scenes.drone_clip import DroneClip, DroneSceneSettings
from tsuiseki.tracking.drone.observations import Observers, observe
from tsuiseki.tracking.evaluation.actions import read_labelled_actions
from tsuiseki.tracking.features.exported import Appearance, Detector
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.formats.mot_sequence import read_sequence
from tsuiseki.tracking.processes import on_all_cores
from tsuiseki.tracking.runs.progress import progress
from tsuiseki.tracking.video.source import open_source
from tsuiseki.tracking.weights import DRONE_DETECTOR, shipped

# Metres above the ground of the clips by turns.
HEIGHTS = ((10.0, 16.0), (16.0, 28.0), (28.0, 45.0))
# Of three clips each, one a height.
CAMERAS: tuple[Literal["still", "calm", "violent"], ...] = ("violent", "still", "violent", "calm")
PEOPLE = (14, 9)
# Seeds 40000 to 40011 chose the costs of the flow.
FIRST_SEED = 41000


def reproduce(*, store: Cached, frames: PositiveInt = 100) -> Outcome:
    """Table 5.3 without actions on twelve generated clips: three heights, moving and hovering, real detections.

    Args:
        store: of what was computed; clips and the networks' output are kept.
        frames: of each clip.
    """
    numbers = range(len(HEIGHTS) * len(CAMERAS))
    clips = list(progress(on_all_cores(partial(observe_clip, store, frames), numbers), "clips", len(numbers)))
    methods = {name: METHODS[name] for name in ("flow", "MCF as printed")}
    values = {
        motion: people_rows([clips], methods, compensate=motion == "taken out") for motion in ("taken out", "left in")
    }
    tables = [
        Table(
            f"Three heights, the camera's motion {motion}",
            COLUMNS[:-1],
            [person_row(name, row, "")[:-1] for name, row in rows.items()],
        )
        for motion, rows in values.items()
    ]
    return Outcome(values, tables)


def observe_clip(store: Store, frames: int, number: int) -> ObservedClip:
    """One of the clips with what the shipped networks make of it."""
    scene = DroneSceneSettings(
        frames=frames,
        camera=CAMERAS[number // len(HEIGHTS)],
        altitude=HEIGHTS[number % len(HEIGHTS)],
        people=PEOPLE[number % len(PEOPLE)],
        look_alikes=0.5,
    )
    return store.recall(observed, store.made(f"height-{number}", write_planned, DroneClip, scene, FIRST_SEED + number))


def observed(folder: Path) -> ObservedClip:
    """What the shipped detector and appearance network make of the frames of a clip."""
    networks = Detector(shipped(DRONE_DETECTOR), threads=1), Appearance(shipped("appearance_people"), threads=1)
    detected = list(observe(open_source(folder).frames(), Observers(*networks, camera=True)))
    truth = read_ground_truth(read_sequence(folder).ground_truth_path)
    labels = read_labelled_actions(folder, "lenient")[0]
    return ObservedClip(folder, truth, labels, detected, [], np.empty(0, dtype=np.int64))
