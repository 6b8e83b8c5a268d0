"""Methods of association on given detections, on six real data sets (`reproduce association`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.people.flow_input import FlowSettings
from tsuiseki.tracking.people.settings import PeopleMethod
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments.association.camera import camera_table
from tsuiseki.trainers.experiments.association.choice import choice_table
from tsuiseki.trainers.experiments.association.online_peers import PACKAGE, PEERS, PROGRAM, peer_tracks
from tsuiseki.trainers.experiments.association.oracle import REPAIRS
from tsuiseki.trainers.experiments.association.plots import plot_scores
from tsuiseki.trainers.experiments.association.runs import (
    Result,
    clip_sums,
    counted_links,
    found_counts,
    repaired_sums,
    right_sums,
)
from tsuiseki.trainers.experiments.association.sequences import DATA_SETS, Clip, DataSet, find_clips
from tsuiseki.trainers.experiments.association.tables import (
    FoundRow,
    combined_table,
    found_table,
    link_table,
    loss_table,
    scores_csv,
    sequence_table,
    values_of,
)
from tsuiseki.trainers.experiments.association.tracks import boxes_alone, filled, method_tracks, observed_only
from tsuiseki.trainers.experiments.experiment import Bench, Outcome, Table
from tsuiseki.trainers.experiments.peers import Peer, find_peer

FLOW, UNFILLED, BOXES_ALONE = "flow", "flow, nothing filled in", "flow, boxes alone"
# Where the settings of our methods come from; the peers' are their package's defaults.
OURS: dict[PeopleMethod, str] = {
    "sort": "PETS 1–300, TUD, generated",
    "bytetrack": "paper",
    "ocsort": "paper",
    "flow": "all sets here",
}
RATES = (30.0, 15.0, 10.0, 5.0)
SETS = ("mot17", "mot15", "kitti-pedestrians", "kitti-cars", "pets", "tud")
# Seconds after which the flow answers; None is the end.
DELAYS = (0.5, 1.0, 2.0, 5.0, None)
PARTS = ("methods", "losses", "filled", "rates", "delays", "camera", "choice")
# Longest gap that the flow fills, seconds.
FILL = FlowSettings().fill
# Recall and precision of the given detections that the data sets' description states.
KNOWN = {
    "MOT17-02": (0.614, 0.878), "MOT17-05": (0.814, 0.964), "MOT17-10": (0.736, 0.949), "MOT17-13": (0.822, 0.975),
    "ADL-Rundle-6-first": (0.668, 0.725), "ADL-Rundle-8": (0.502, 0.655), "ETH-Bahnhof": (0.728, 0.635),
    "ETH-Pedcross2": (0.582, 0.792), "ETH-Sunnyday": (0.841, 0.718), "Venice-2": (0.457, 0.598),
    "MOT17 val-half": (0.706, 0.927),
}  # fmt: skip


@dataclass(frozen=True)
class Measured:
    """The results on one data set.

    Attributes:
        described: the data set.
        clips: its sequences.
        results: the rows of its table.
        tracks: of every row, by sequence, see `table_of`.
    """

    described: DataSet
    clips: Sequence[Clip]
    results: Sequence[Result]
    tracks: Mapping[str, Sequence[FloatArray]]


def reproduce(
    bench: Bench,
    data: Path = Path("../shared/data"),
    sets: list[str] = list(SETS),  # noqa: B006, the parser shows it and nobody changes it
    parts: list[str] = list(PARTS[:-1]),  # noqa: B006
    peer: str | None = None,
    gap: float = 2.0,
) -> Outcome:
    """Methods of association on the given detections of six data sets: HOTA, MOTA, IDF1, and where the rest is lost.

    DIR gets results.json, tables.md, scores.csv (every row on every sequence) and association.png.

    Args:
        bench: where it works.
        data: folder that holds mot/mot17-val-half, mot/mot15, mot/kitti and so on; a set that is not there is passed
            over.
        sets: of mot17, mot15, kitti-pedestrians, kitti-cars, pets and tud, separated by commas.
        parts: methods (all rows, combined and by sequence), losses (the default with one kind of error mended, and the
            right links over the same detections), filled (the other methods, gaps of up to 2 seconds filled on
            straight lines, as the flow fills its own), rates (mot17 at 30, 15, 10 and 5 frames a second), delays (the
            flow that answers after 0.5, 1, 2 and 5 seconds on mot17 and pets), camera (its motion from boxes, from
            pictures and from nothing on MOT17-13, where mot/mot17-13-video is there), choice (settings of the flow
            chosen without each set, from two sets on; not by default), separated by commas.
        peer: python of an environment with the package trackers, whose ByteTrack, C-BIoU, SORT and OC-SORT are measured
            beside; by default this one, if it has the package.
        gap: longest gap that the right links bridge in the picture and where the losses are told, seconds.

    Raises:
        RequestError: an unknown set or part, no data, or a python without the package.
    """
    _check(sets, parts, gap)
    environment = find_peer(peer, PROGRAM, PACKAGE)
    every = [(one, find_clips(data, one)) for one in DATA_SETS if one.key in sets]
    there = [(one, clips) for one, clips in every if clips]
    if not there:
        raise RequestError(f"`data`: expected mot/mot17-val-half or another of the data sets in {data}, found none")
    measured = [_measured(bench, one, clips, environment) for one, clips in there]
    tables, values = _method_tables(bench, measured) if "methods" in parts else ([], {})
    if "losses" in parts:
        tables += [table for one in measured for table in _loss_tables(bench, one, gap)]
    if "filled" in parts:
        tables += [_filled_table(bench, one) for one in measured]
    if "rates" in parts:
        tables += [_rate_table(bench, one) for one in measured if one.described.key == "mot17"]
    if "delays" in parts:
        tables += [_delay_table(bench, one) for one in measured if one.described.key in ("mot17", "pets")]
    if "camera" in parts:
        found = [camera_table(bench, data, one.clips) for one in measured if one.described.key == "mot17"]
        tables += [table for table in found if table is not None]
    if "choice" in parts and len(there) > 1:
        tables.append(choice_table(bench, there))
    limits = {one.described.title: _right(bench, one.clips, gap, filled=True) for one in measured}
    return Outcome(
        {"peer": environment.version if environment else None, "sets": values},
        tables,
        {"association": plot_scores({one.described.title: one.results for one in measured}, FLOW, limits)},
        files={"scores.csv": scores_csv({m.described.key: ([c.name for c in m.clips], m.results) for m in measured})},
        notes=_notes(environment, [one for one, clips in every if not clips]),
    )


def _check(sets: Sequence[str], parts: Sequence[str], gap: float) -> None:
    for name, given, known in (("sets", sets, SETS), ("parts", parts, PARTS)):
        if unknown := [one for one in given if one not in known]:
            raise RequestError(f"`{name}`: expected some of {', '.join(known)}, got {unknown[0]!r}")
    if not gap > 0:
        raise RequestError(f"`gap`: expected seconds above 0, got {gap:g}")


def _measured(bench: Bench, one: DataSet, clips: Sequence[Clip], environment: Peer | None) -> Measured:
    """Every row on every sequence of a data set."""
    tracks: dict[str, list[FloatArray]] = {}
    settings = {str(method): where for method, where in OURS.items()} | {UNFILLED: OURS["flow"]}
    work = [(method, clip) for method in OURS for clip in clips]
    for method, clip in bench.watch.over(work, one.title, len(work)):
        tracks.setdefault(method, []).append(bench.store.recall(method_tracks, clip, method))
    tracks[UNFILLED] = [observed_only(table) for table in tracks[FLOW]]
    if any(clip.pictures for clip in clips):
        tracks[BOXES_ALONE] = [bench.store.recall(boxes_alone, clip, "flow") for clip in clips]
        settings[BOXES_ALONE] = OURS["flow"]
    if environment is not None:
        for name, tables in _peers(bench, environment, one, clips).items():
            tracks[name], settings[name] = tables, "package"
    results = [
        Result(name, np.array([bench.store.recall(clip_sums, c, t) for c, t in zip(clips, each, strict=True)]),
               settings[name])
        for name, each in tracks.items()
    ]  # fmt: skip
    return Measured(one, clips, results, tracks)


def _peers(bench: Bench, environment: Peer, one: DataSet, clips: Sequence[Clip]) -> dict[str, list[FloatArray]]:
    """The peers' tracks by row; where scores are logits, also with the probabilities they stand for."""
    found: dict[str, list[FloatArray]] = {}
    for logistic in (False, True) if one.logits else (False,):
        work = bench.watch.over(clips, f"{one.title}, peers", len(clips))
        answers = [bench.store.recall(peer_tracks, environment, PROGRAM, clip, logistic) for clip in work]
        for name in PEERS:
            row = f"{name} (trackers)" + (", probabilities" if logistic else "")
            found[row] = [answer[name] for answer in answers]
    return found


def _filled_table(bench: Bench, one: Measured) -> Table:
    """The online methods with their gaps filled, beside the flow, which fills its own."""
    rows = [result for result in one.results if result.name == FLOW]
    for name, tracks in one.tracks.items():
        if name in (FLOW, UNFILLED, BOXES_ALONE):
            continue
        tables = [filled(table, round(FILL * clip.rate)) for clip, table in zip(one.clips, tracks, strict=True)]
        sums = [bench.store.recall(clip_sums, clip, table) for clip, table in zip(one.clips, tables, strict=True)]
        settings = next(result.settings for result in one.results if result.name == name)
        rows.append(Result(name, np.array(sums), settings))
    return combined_table(f"{one.described.title}, gaps filled", rows, FLOW)


def _method_tables(bench: Bench, measured: Sequence[Measured]) -> tuple[list[Table], dict[str, Any]]:
    tables: list[Table] = []
    for one in measured:
        tables.append(combined_table(one.described.title, one.results, FLOW))
        if len(one.clips) > 1:
            tables.append(sequence_table(one.described.title, [clip.name for clip in one.clips], one.results))
    tables.append(found_table(_found(bench, measured)))
    return tables, {one.described.key: {r.name: values_of(r) for r in one.results} for one in measured}


def _found(bench: Bench, measured: Sequence[Measured]) -> list[FoundRow]:
    """The given detections by data set, and by sequence where recall and precision are known."""
    rows: list[FoundRow] = []
    for one in measured:
        counts = [bench.store.recall(found_counts, clip) for clip in one.clips]
        rows += [(c.name, n, KNOWN[c.name]) for c, n in zip(one.clips, counts, strict=True) if c.name in KNOWN]
        together = np.array(counts).sum(axis=0)
        total = (int(together[0]), int(together[1]), int(together[2]))
        rows.append((one.described.title, total, KNOWN.get(one.described.title)))
    return rows


def _right(bench: Bench, clips: Sequence[Clip], seconds: float, *, filled: bool) -> Result:
    sums = np.array([bench.store.recall(right_sums, clip, seconds, filled) for clip in clips])
    reach = f"up to {seconds:g} s" if seconds else "of one frame"
    return Result(f"right links {reach}{', filled' if filled else ''}", sums)


def _loss_tables(bench: Bench, one: Measured, gap: float) -> list[Table]:
    """Where our default loses: each kind of error mended alone, and what the detections allow."""
    kept = [observed_only(table) for table in one.tracks[FLOW]]
    rows = [result for result in one.results if result.name == UNFILLED]
    for what in REPAIRS:
        sums = [bench.store.recall(repaired_sums, c, t, what) for c, t in zip(one.clips, kept, strict=True)]
        rows.append(Result("… with the right links" if what == "links" else f"… without {what}", np.array(sums)))
    rows += [_right(bench, one.clips, seconds, filled=False) for seconds in (0.0, 0.4, gap)]
    rows += [_right(bench, one.clips, gap, filled=True)]
    counts = [bench.store.recall(counted_links, c, t) for c, t in zip(one.clips, kept, strict=True)]
    return [loss_table(f"{one.described.title}, losses", rows), link_table(one.described.title, counts)]


def _rate_table(bench: Bench, one: Measured) -> Table:
    """The same sequences at fewer frames a second, by the same defaults."""
    rows = []
    for rate in RATES:
        clips = [clip.at(rate) for clip in one.clips]
        for method in OURS:
            sums = [bench.store.recall(clip_sums, c, bench.store.recall(method_tracks, c, method)) for c in clips]
            kept = ", ".join(sorted({f"{clip.rate:.3g}" for clip in clips}, key=float))
            found = values_of(Result(method, np.array(sums)))
            shares = [f"{found[k]:.3f}" for k in ("hota", "mota", "idf1")]
            rows.append([f"{rate:g} ({kept})", method, *shares, str(int(found["id_switches"]))])
    columns = (f"{one.described.title}: frames a second (kept)", "method", "HOTA", "MOTA", "IDF1", "IDSW")
    return Table("", columns, rows)


def _delay_table(bench: Bench, one: Measured) -> Table:
    """What it costs the flow to answer so many seconds after each frame."""
    rows = []
    for delay in DELAYS:
        tables = [bench.store.recall(method_tracks, clip, "flow", delay) for clip in one.clips]
        sums = [bench.store.recall(clip_sums, clip, table) for clip, table in zip(one.clips, tables, strict=True)]
        found = values_of(Result("flow", np.array(sums)))
        shares = [f"{found[k]:.3f}" for k in ("hota", "mota", "idf1")]
        rows.append(["all" if delay is None else f"{delay:g} s", *shares, str(int(found["id_switches"]))])
    return Table("", (f"{one.described.title}: delay of the flow", "HOTA", "MOTA", "IDF1", "IDSW"), rows)


def _notes(environment: Peer | None, missing: Sequence[DataSet]) -> list[str]:
    notes = [f"{one.title}: no {one.folder} in the data, passed over" for one in missing]
    if environment is None:
        notes.append("peers: skipped, the package trackers is not installed here; name a python that has it as peer")
    return notes
