"""Methods of association on given detections, on six real data sets (`reproduce association`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.datamodules.scenes.people.walkers import Motion
from tsuiseki.tracking.people.settings import PeopleMethod
from tsuiseki.tracking.people.tracker import shifted
from tsuiseki.tracking.people.tracking import track_people
from tsuiseki.tracking.types import Detections, FloatArray, Track
from tsuiseki.trainers.experiments import given_sequences
from tsuiseki.trainers.experiments.association_peers import NAMES
from tsuiseki.trainers.experiments.given_sequences import (
    DataSet,
    GivenSequence,
    as_written,
    given_detections,
    write_streets,
)
from tsuiseki.trainers.experiments.peers import Peer, find_peer
from tsuiseki.trainers.experiments.study import Bench, Name, Outcome, Study, Table, some_of

FLOW, UNFILLED, BOXES_ALONE = "flow", "flow, nothing filled in", "flow, boxes alone"
METHODS: tuple[PeopleMethod, ...] = ("sort", "bytetrack", "ocsort", "flow")
LOGISTIC = ("", ", probabilities")
RATES = (30.0, 15.0, 10.0, 5.0)
GENERATED: tuple[Motion, ...] = ("dance", "sport")
SETS = ("mot17", "mot15", "kitti-pedestrians", "kitti-cars", "pets", "tud")
# Seconds after which the flow answers; None is the end.
DELAYS = {"flow, all": None, "0.5 s": 0.5, "1 s": 1.0, "2 s": 2.0, "5 s": 5.0}
PARTS = ("methods", "rates", "delays")
# Longest gap that the right links bridge, seconds.
GAP = 2.0
PROGRAM = Path(__file__).with_name("association_peers.py")
PACKAGE = "the packages trackers and arcsort"


@dataclass(frozen=True)
class LinkedBy:
    """A way to link given detections.

    Attributes:
        method: of `tsuiseki track people`.
        delay: seconds after which it answers; None is the end.
        pictures: compare appearance where the sequence has pictures.
    """

    method: PeopleMethod
    delay: float | None = None
    pictures: bool = True


def reproduce(
    bench: Bench,
    data: Path = Path("../shared/data"),
    sets: list[str] = list(SETS),  # noqa: B006, the parser shows it and it is never changed
    parts: list[str] = list(PARTS),  # noqa: B006
    peer: str | None = None,
) -> Outcome:
    """Methods of association on the given detections of six data sets: HOTA, MOTA and IDF1, beside peers.

    DIR gets results.json (every row on every sequence) and tables.md.

    Args:
        bench: where it works.
        data: folder that holds mot/mot17-val-half, mot/mot15, mot/kitti and so on; a set that is not there is passed
            over.
        sets: of mot17, mot15, kitti-pedestrians, kitti-cars, pets and tud, and of dance and sport, which are generated,
            separated by commas.
        parts: methods (all rows), rates (mot17 at 30, 15, 10 and 5 frames a second), delays (the flow that answers
            after 0.5, 1, 2 and 5 seconds on mot17 and pets), separated by commas.
        peer: python of an environment with the packages trackers, whose ByteTrack, C-BIoU, SORT and OC-SORT are
            measured beside, and arcsort; by default this one, if it has them.

    Raises:
        RequestError: an unknown set or part, no data, or a python without the packages.
    """
    some_of((*SETS, *GENERATED), sets=sets)
    some_of(PARTS, parts=parts)
    environment = find_peer(peer, PROGRAM, PACKAGE)
    there = _sequences(bench, data, sets)
    tables, values = list[Table](), dict[str, Any]()
    for one, sequences in there.items():
        tracks = _tracks(bench, one, sequences, environment)
        rows = _scored(bench, sequences, tracks)
        for way in (False, True):
            limit = given_sequences.sums_of(bench, given_sequences.right_sums, [(one, GAP, way) for one in sequences])
            rows[f"right links up to {GAP:g} s{', filled' if way else ''}"] = limit
        values[one.key] = {
            name: {
                **given_sequences.combined_scores(sums),
                "sequences": {
                    given.name: given_sequences.combined_scores(each[None])
                    for given, each in zip(sequences, sums, strict=True)
                },
            }
            for name, sums in rows.items()
        }
        if "methods" in parts:
            tables.append(given_sequences.score_table(one.title, rows, FLOW))
        tables += _more_tables(bench, one, sequences, parts)
    missing = [one for one in given_sequences.DATA_SETS if one.key in sets and one not in there]
    notes = [f"{one.title}: no {one.folder} in the data, passed over" for one in missing]
    if environment is None:
        notes.append(f"peers: skipped, {PACKAGE} are not installed here; name a python that has them as peer")
    version = environment.version if environment else None
    return Outcome({"peer": version, "sets": values}, tables, notes=notes)


def _sequences(bench: Bench, data: Path, sets: Sequence[str]) -> dict[DataSet, list[GivenSequence]]:
    """The real sets that are there, and the generated ones."""
    real = [key for key in SETS if key in sets]
    there = given_sequences.find_sets(data, real) if real else {}
    for motion in GENERATED:
        if motion in sets:
            one = DataSet(motion, f"generated {motion}", motion)
            made = bench.store.made(motion, write_streets, 10, 100, motion)
            there[one] = given_sequences.find_given(made.parent, one)
    return there


def _more_tables(bench: Bench, one: DataSet, sequences: Sequence[GivenSequence], parts: Sequence[str]) -> list[Table]:
    """The tables of one data set of the wanted parts but the first."""
    tables = list[Table]()

    def add(title: str, own: Sequence[GivenSequence], found: Mapping[Any, Any], base: str = FLOW) -> None:
        tables.append(given_sequences.score_table(title, _scored(bench, own, found), base))

    for rate in RATES if "rates" in parts and one.key == "mot17" else ():
        slower = [given.at(rate) for given in sequences]
        kept = ", ".join(sorted({f"{given.rate:.3g}" for given in slower}, key=float))
        found = Study({m: LinkedBy(m) for m in METHODS}, slower, linked, f"{one.title}, {rate:g}/s").run(bench)
        add(f"{one.title} at {rate:g} frames a second (kept {kept})", slower, found)
    if "delays" in parts and one.key in ("mot17", "pets"):
        delays: dict[Name, LinkedBy] = {name: LinkedBy("flow", delay) for name, delay in DELAYS.items()}
        late = Study(delays, sequences, linked, f"{one.title}, delays").run(bench)
        add(f"{one.title}: delay of the flow", sequences, late, base="flow, all")
    return tables


def linked(by: LinkedBy, given: GivenSequence) -> list[Track]:
    """The tracks of `tsuiseki track people --detections … --method METHOD`, as it writes them.

    Pictures are read where the sequence has any and all its frames are kept, as the command does.
    """
    found = given_detections(given)
    if by.pictures and given.pictures is not None and given.every == 1:
        first = given.kept.start
        whole = [Detections.empty()] * first + found
        tracks = track_people(
            given.pictures, by.method, detections=whole, frames=given.frames, threads=1, delay=by.delay
        )
        return as_written([shifted(track, -first) for track in tracks])
    return as_written(given_sequences.tracks_over(found, given.rate, given.size, by.method, delay=by.delay))


def peer_tracks(peer: Peer, program: Path, given: GivenSequence, logistic: bool) -> dict[str, list[Track]]:
    """The tracks of each tracker of the peer; boxes without an area are left out.

    Args:
        peer: its environment.
        program: runs there; its text belongs to the result.
        given: the sequence.
        logistic: scores are logits and become probabilities first.
    """
    boxes = [
        [frame, *box, 1 / (1 + np.exp(-score)) if logistic else score]
        for frame, found in enumerate(given_detections(given))
        for box, score in zip(found.boxes.tolist(), found.scores.tolist(), strict=True)
    ]
    answer = peer.answer(program, {"boxes": boxes, "length": len(given.kept), "rate": given.rate})
    tracks = {}
    for name, rows in answer.items():
        table = np.array(rows, dtype=np.float64).reshape(-1, 7)
        table = table[(table[:, 4] > table[:, 2]) & (table[:, 5] > table[:, 3])]
        parts = [table[table[:, 1] == number] for number in np.unique(table[:, 1])]
        tracks[name] = as_written([Track(int(p[0, 1]), p[:, 0].astype(int), p[:, 2:6], p[:, 6]) for p in parts])
    return tracks


def _tracks(
    bench: Bench, one: DataSet, sequences: Sequence[GivenSequence], environment: Peer | None
) -> dict[str, list[list[Track]]]:
    """The tracks of every row by sequence."""
    ways: dict[Name, LinkedBy] = {method: LinkedBy(method) for method in METHODS}
    if any(given.pictures for given in sequences):
        ways[BOXES_ALONE] = LinkedBy("flow", pictures=False)
    found = Study(ways, sequences, linked, one.title).run(bench)
    tracks = {str(name): each for name, each in found.items()}
    tracks[UNFILLED] = [
        [Track(t.id, t.frames[k], t.boxes[k], t.scores[k]) for t in each for k in [t.observed] if k.any()]
        for each in tracks[FLOW]
    ]
    for logistic in (False, True)[: 1 + one.logits] if environment else ():
        jobs = [(environment, PROGRAM, given, logistic) for given in sequences]
        answers = bench.each(peer_tracks, jobs, f"{one.title}, peers")
        tracks |= {f"{name} (peer){LOGISTIC[logistic]}": [found[name] for found in answers] for name in NAMES}
    return tracks


def _scored(
    bench: Bench, sequences: Sequence[GivenSequence], tracks: Mapping[Any, Sequence[Sequence[Track]]]
) -> dict[str, FloatArray]:
    """``(S, 83)`` sums of every row."""
    sums = given_sequences.track_sums
    return {n: given_sequences.sums_of(bench, sums, list(zip(sequences, t, strict=True))) for n, t in tracks.items()}
