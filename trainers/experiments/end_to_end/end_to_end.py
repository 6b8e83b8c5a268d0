"""Networks learnt through the flow (`reproduce end-to-end`): costs, the Siamese network, the detector's heads."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tsuiseki.tracking.errors import RequestError
from tsuiseki.trainers.experiments.association.sequences import DATA_SETS, Clip, DataSet, find_clips
from tsuiseki.trainers.experiments.association.tables import values_of
from tsuiseki.trainers.experiments.end_to_end.choosing import hota
from tsuiseki.trainers.experiments.end_to_end.detected import detected_tables
from tsuiseki.trainers.experiments.end_to_end.given import (
    ALTERNATIVES,
    BOTH,
    DEFAULT,
    LOGISTIC,
    OTHERS,
    TREES,
    alternatives,
    given,
)
from tsuiseki.trainers.experiments.end_to_end.gradient import draw_gradient
from tsuiseki.trainers.experiments.end_to_end.limits import limits
from tsuiseki.trainers.experiments.end_to_end.streets import STREETS, StreetCount, write_streets
from tsuiseki.trainers.experiments.end_to_end.tables import gain_table
from tsuiseki.trainers.experiments.end_to_end.through_pictures import appearance_tables, heads_tables
from tsuiseki.trainers.experiments.end_to_end.unseen import unseen_tables
from tsuiseki.trainers.experiments.experiment import Bench, Outcome, Table

# Sets that can teach each other.
POOL = ("mot15", "mot17", "kitti-pedestrians")
SETS = ("mot15", "mot17", "kitti-pedestrians", "kitti-cars", "streets")
PARTS = ("given", "limits", "alternatives", "unseen", "detected", "appearance", "heads", "gradient")


def reproduce(
    bench: Bench,
    data: Path = Path("../shared/data"),
    sets: list[str] = list(SETS),  # noqa: B006, the parser shows it and nobody changes it
    parts: list[str] = list(PARTS),  # noqa: B006
    rows: list[str] = list(ALTERNATIVES),  # noqa: B006
    processes: int = 0,
) -> Outcome:
    """Networks learnt through the flow against costs learnt on pairs and those by default: HOTA, MOTA, IDF1, switches.

    The sequences of a set are cut into groups; each is tracked by what was learnt on the others.

    Args:
        bench: where it works.
        data: folder that holds mot/mot17-val-half, mot/mot15, mot/kitti, mot/PETS09-S2L1-first; what is not there is
            passed over.
        sets: of mot15, mot17, kitti-pedestrians, kitti-cars, and streets, which are generated, separated by commas; for
            the parts given, limits and alternatives.
        parts: given (all sets), limits (what limits them: links that are not in the graph, what errors cost, what the
            features tell), alternatives (other ways to learn, on the first set, and those for few sequences on the
            second), unseen (costs learnt on generated streets, on real sequences), detected (likewise, after
            detectors that ship), appearance (the Siamese network), heads (of the detector), gradient (the picture),
            separated by commas.
        rows: of the part alternatives, separated by commas.
        processes: groups that are learnt at the same time; 0 takes all cores.

    Raises:
        RequestError: an unknown set, part or row, or no data.
    """
    _check(data, sets, parts, rows)
    tables, values = list[Table](), dict[str, object]()
    streets = None
    of_sets = {"given", "limits", "alternatives"} & set(parts)
    if "unseen" in parts or (of_sets and "streets" in sets):
        streets = bench.store.made("streets", write_streets, StreetCount())
    if of_sets:
        there = _sets_of(data, streets, sets)
        if "given" in parts:
            found, numbers = _given(bench, there, processes)
            tables += found
            values |= numbers
        if "limits" in parts:
            for one, clips in there:
                found, values[f"{one.key}, limits"] = limits(bench, one, clips)
                tables += found
        if "alternatives" in parts:
            for number, (one, clips) in enumerate(there[:2]):
                others = [] if number else _of_other_sets(data, one)
                asked = [name for name in rows if number == 0 or name not in OTHERS]
                results = alternatives(bench, one, clips, others, processes, asked)
                values[f"{one.key}, alternatives"] = {result.name: values_of(result) for result in results}
                tables.append(gain_table(f"{one.title}, alternatives", results, (DEFAULT, BOTH)))
    if "unseen" in parts and streets is not None:
        found, values["unseen"] = unseen_tables(bench, data, streets)
        tables += found
    if "detected" in parts:
        found, values["detected"] = detected_tables(bench, data)
        tables += found
    if "appearance" in parts:
        found, values["appearance"] = appearance_tables(bench, data)
        tables += found
    if "heads" in parts:
        found, values["heads"] = heads_tables(bench, data)
        tables += found
    plots = {"gradient": draw_gradient()} if "gradient" in parts else {}
    return Outcome(values, tables, plots, notes=_notes())


def _sets_of(data: Path, streets: Path | None, sets: Sequence[str]) -> list[tuple[DataSet, list[Clip]]]:
    """The sets that are there, in the order of `SETS`, with their sequences."""
    there = [(one, find_clips(data, one)) for one in DATA_SETS if one.key in sets]
    if streets is not None:
        there.append((STREETS, find_clips(streets.parent, STREETS)))
    there = [(one, clips) for one, clips in there if clips and one.key in sets]
    if not there:
        raise RequestError(f"data: expected mot/mot17-val-half or another of the data sets in {data}, found none")
    return sorted(there, key=lambda pair: SETS.index(pair[0].key))


def _given(
    bench: Bench, there: Sequence[tuple[DataSet, list[Clip]]], processes: int
) -> tuple[list[Table], dict[str, object]]:
    tables, values = list[Table](), dict[str, object]()
    for one, clips in there:
        results = given(bench, one, clips, processes)
        values[one.key] = {result.name: values_of(result) for result in results}
        better = max((r for r in results if r.name in (LOGISTIC, TREES)), key=lambda result: hota(list(result.sums)))
        tables.append(gain_table(one.title, results, (DEFAULT, better.name)))
    return tables, values


def _of_other_sets(data: Path, one: DataSet) -> list[Clip]:
    """Real sequences of people in other sets; none for a set that is no such."""
    pool = [other for other in DATA_SETS if other.key in POOL]
    return [clip for other in pool if other != one for clip in find_clips(data, other)] if one in pool else []


def _check(data: Path, sets: Sequence[str], parts: Sequence[str], rows: Sequence[str]) -> None:
    for name, asked, known in (("sets", sets, SETS), ("parts", parts, PARTS), ("rows", rows, ALTERNATIVES)):
        wrong = [one for one in asked if one not in known]
        if wrong or not asked:
            raise RequestError(f"{name}: expected some of {', '.join(known)}, got {', '.join(wrong) or 'none'}")
    generated = set(parts) <= {"given", "limits", "alternatives", "gradient"} and set(sets) == {"streets"}
    if not (generated or set(parts) == {"gradient"} or (data / "mot").is_dir()):
        raise RequestError(f"data: expected mot/mot17-val-half or another of the data sets in {data}, found no mot/")


def _notes() -> list[str]:
    return [
        "Intervals: paired bootstrap over sequences, 2,000 samples, 95 %. Settings of the fits were chosen on MOT15; "
        "the other sets had no part in that. The default's were chosen with all real sets in sight."
    ]
