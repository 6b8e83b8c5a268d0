"""Rows of the networks that look at pictures: the Siamese network and the detector's heads, before and after."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.association.windows import TrackerName
from tsuiseki.trainers.experiments.association.runs import Result
from tsuiseki.trainers.experiments.association.tables import values_of
from tsuiseki.trainers.experiments.end_to_end import appearance, heads
from tsuiseki.trainers.experiments.end_to_end.appearance import appearance_sums
from tsuiseki.trainers.experiments.end_to_end.heads import heads_sums
from tsuiseki.trainers.experiments.end_to_end.pictured import Stretch
from tsuiseki.trainers.experiments.end_to_end.streets import StreetCount, write_drones, write_pictured
from tsuiseki.trainers.experiments.end_to_end.tables import gain_table
from tsuiseki.trainers.experiments.experiment import Bench, Table

PETS = "mot/PETS09-S2L1-first"
FRAMES, CLIPS = 60, 6
# The detector learns from as many frames of PETS as its trunk looks at in a minute.
HEADS_FROM = 201
LOOK_ALIKES, UNLIKE = 0.7, 0.0
# What is learnt from, and what is tracked: PETS by thirds of its last hundred frames, streets by clips.
Data = tuple[tuple[Stretch, ...], tuple[Stretch, ...]]


def appearance_tables(bench: Bench, data: Path) -> tuple[list[Table], dict[str, Any]]:
    """The Siamese network that ships, trained on by its own loss, and through the flow."""
    sources = {
        "PETS 1–300 → 301–400": _pets(data),
        "streets of look-alikes": pictured_clips(bench, write_pictured, LOOK_ALIKES),
        "streets of unlike clothing": pictured_clips(bench, write_pictured, UNLIKE),
        "drone, look-alikes": pictured_clips(bench, write_drones, LOOK_ALIKES),
        "drone, unlike clothing": pictured_clips(bench, write_drones, UNLIKE),
    }
    tables, values, start = list[Table](), dict[str, Any](), shipped("appearance_people")
    for title, source in sources.items():
        if source is None:
            continue
        tracker: TrackerName = "drone" if title.startswith("drone") else "people"
        found = {
            way: np.stack(bench.store.recall(appearance_sums, *source, start, way, tracker))
            for way in bench.watch.over(appearance.WAYS, f"appearance, {title}")
        }
        links = {way: sums[:, 83:].sum(axis=0) for way, sums in found.items()}
        more = {way: f"{int(made)} of {int(every)}" for way, (every, made) in links.items()}
        _add(tables, values, title, found, appearance.WAYS[0], "links over gaps", more)
    return tables, values


def heads_tables(bench: Bench, data: Path) -> tuple[list[Table], dict[str, Any]]:
    """The detector of drawn people, its heads trained on by its own loss, through the flow, and by both."""
    sources = {
        f"PETS {HEADS_FROM}–300 → 301–400": _pets(data, HEADS_FROM),
        "streets": pictured_clips(bench, write_pictured, UNLIKE),
    }
    tables, values, start = list[Table](), dict[str, Any](), shipped("detector_street")
    for title, source in sources.items():
        if source is None:
            continue
        bench.watch.say(f"heads, {title}")
        every = bench.store.recall(heads_sums, *source, start)
        found = {way: np.stack(sums) for way, sums in zip(heads.WAYS, every, strict=True)}
        more = {way: f"{sums[:, 83].mean():.3f}" for way, sums in found.items()}
        _add(tables, values, title, found, heads.WAYS[0], "AP50", more)
    return tables, values


def _add(
    tables: list[Table],
    values: dict[str, Any],
    title: str,
    found: dict[Any, FloatArray],
    base: str,
    heading: str,
    more: dict[Any, str],
) -> None:
    """A table with a column more, and its values."""
    rows = [Result(way, sums[:, :83], more[way]) for way, sums in found.items()]
    table = gain_table(title, rows, (base,))
    tables.append(Table(table.title, [*table.columns[:-1], heading], table.rows))
    values[title] = {row.name: {**values_of(row), heading: row.settings} for row in rows}


def _pets(data: Path, first: int = 1) -> Data | None:
    folder = data / PETS
    if not folder.is_dir():
        return None
    return (Stretch(folder, first, 300),), tuple(Stretch(folder, a, a + 49) for a in (301, 351))


def pictured_clips(bench: Bench, write: Callable[[Path, StreetCount, float], None], look_alikes: float) -> Data:
    """Generated clips with pictures: half of them to learn from, half to track."""
    home = bench.store.made("pictured", write, StreetCount(CLIPS, FRAMES, 500), look_alikes)
    clips = [Stretch(folder, 1, FRAMES) for folder in sorted(home.iterdir())]
    return tuple(clips[: CLIPS // 2]), tuple(clips[CLIPS // 2 :])
