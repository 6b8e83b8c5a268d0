"""`tsuiseki link`: results of cameras that do not overlap, or of files that follow each other, with common ids."""

from __future__ import annotations

import csv
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from pydantic import NonNegativeFloat

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.features.exported import AppearanceLike, Describe, usual_describer
from tsuiseki.tracking.features.gallery import Gallery, opened_gallery
from tsuiseki.tracking.features.recognition import centred
from tsuiseki.tracking.fields import Commas, FrameRate
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.linking.identities import identities, remembered
from tsuiseki.tracking.linking.looks import described_tracks, mean_looks
from tsuiseki.tracking.linking.transits import MARGIN, Passages, Transits, linked, people_of, standing_out
from tsuiseki.tracking.people.tracks_of_source import boxes_of, frame_times, name_of, rates_of, tracked
from tsuiseki.tracking.privacy import Days, first_to_go
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.runs.options import Output
from tsuiseki.tracking.types import FloatArray, IntArray, Track

NONE = "none"
# Of `joins.csv` and `unsure.csv`.
COLUMNS = ("id", "result", "track", "next_result", "next_track", "seconds", "likeness", "margin")
# Of `people.csv`.
PEOPLE_COLUMNS = ("id", "name", "probability")
Linkable: TypeAlias = str | Path | Result[Track]


@dataclass(frozen=True)
class Linked:
    """Results whose ids are common.

    Attributes:
        results: in the order that they were given, with new ids; the same id is the same person.
        names: of the results.
        joins: rows as of `COLUMNS`: the new id, both results and tracks as they were, seconds in between, cosine of
            the appearance, and the margin: the natural logarithm of how much likelier all is with the join.
        unsure: likewise, of the joins that were not made; their id is that of the earlier track.
        people: of each id, where a gallery is asked: its name there, empty for nobody's, and the probability of it.
        gallery: with those who were to be remembered.
    """

    results: Sequence[Result[Track]]
    names: Sequence[str]
    joins: Sequence[tuple[Any, ...]]
    unsure: Sequence[tuple[Any, ...]]
    people: Sequence[tuple[int, str, float]] = ()
    gallery: Gallery | None = None


def link(
    results: Sequence[Linkable],
    starts: Sequence[float] | None = None,
    appearance: AppearanceLike | None = None,
    margin: float = MARGIN,
    frame_rates: Sequence[float] | None = None,
    gallery: str | Path | Gallery | None = None,
    remember: int | None = None,
) -> Linked:
    """Give the same id to the same person in several results.

    Args:
        results: see `people.tracks_of_source`: of cameras that do not overlap, or of files that follow each other.
        starts: seconds at which each begins, by one clock; by default all at once.
        appearance: as of `track_people`; by default the shipped network, where the videos are there; ``"none"`` goes
            by times and places alone.
        margin: least margin of a join that is made, natural logarithm, 0 or more; log 9 means nine to one. A join must
            also stand out from those that chance gives, see `linking.transits`; of strangers none is made.
        frame_rates: frames a second, where a result does not say: one number, or one a result.
        gallery: people to recognise, see `features.gallery`: a `Gallery` or its folder. One result is enough with it.
        remember: days for which those who are nobody of the gallery are added to it, as unknown-1 and so on, so that
            they have the same name when they come back; by default nobody is.

    Raises:
        RequestError: there are fewer than two results, two are the same, one has no tracks, the gallery is another
            network's, or see `tracked`.
    """
    if len(results) < (2 if gallery is None else 1):
        raise RequestError(f"expected two results or more to link, got {len(results)}")
    if starts is not None and len(starts) != len(results):
        raise RequestError(f"`starts`: expected {len(results)} numbers, one a result, got {len(starts)}")
    if not margin >= 0:
        raise RequestError(f"`margin`: expected 0 or more, got {margin:g}")
    rates = rates_of(frame_rates, len(results))
    loaded = [tracked(result) for result in results]
    loaded = [replace(r, frame_rate=rate or r.frame_rate) for r, rate in zip(loaded, rates, strict=True)]
    names = [name_of(result) for result in results]
    if len({*names}) < len(names):
        names = [f"{k + 1}_{name}" for k, name in enumerate(names)]
    _refuse_twice(names, loaded)
    describer = None
    if not (isinstance(appearance, str | Path) and str(appearance) == NONE):
        describer = usual_describer(appearance)
    people = None if gallery is None else opened_gallery(gallery, describer)
    pictures = [_pictures(name, result, describer) for name, result in zip(names, loaded, strict=True)]
    passages = _passages(names, loaded, starts or [0.0] * len(loaded), pictures)
    common, ids = _joined(names, loaded, passages, linked(passages), margin)
    if people is None:
        return common
    who = identities(people, passages, pictures, ids)
    rows = [(number, identity.name, round(identity.probability, 4)) for number, identity in who.items()]
    if remember is not None:
        tracks = [
            f"{name}:{track.id}" for name, result in zip(names, loaded, strict=True) for track in boxes_of(result)
        ]
        people, rows = remembered(people, rows, tracks, pictures, ids, remember)
    return replace(common, people=rows, gallery=people)


def _refuse_twice(names: Sequence[str], results: Sequence[Result[Track]]) -> None:
    for (first, result), (second, later_result) in combinations(zip(names, results, strict=True), 2):
        a, b = boxes_of(result), boxes_of(later_result)
        if len(a) == len(b) and all(
            np.array_equal(x.frames, y.frames) and np.array_equal(x.boxes, y.boxes) for x, y in zip(a, b, strict=True)
        ):
            raise RequestError(f"expected different results, got the same tracks in {first} and {second}")


def _passages(
    names: Sequence[str],
    results: Sequence[Result[Track]],
    starts: Sequence[float],
    pictures: Sequence[Sequence[FloatArray]],
) -> Passages:
    """All tracks of all results, one after the other."""
    views, times, ends, looks = [], [], [], []
    for k, (name, result, start) in enumerate(zip(names, results, starts, strict=True)):
        tracks, rate = boxes_of(result), result.frame_rate
        if not rate:
            raise RequestError(f"{name}: expected its frames a second, which the result does not say; give `fps`")
        seconds = frame_times(result, rate) + start
        corners = np.concatenate([track.boxes[:, 2:] for track in tracks])
        size = np.array(result.size or corners.max(axis=0))
        views += [k] * len(tracks)
        times += [(seconds[track.frames[0]], seconds[track.frames[-1]]) for track in tracks]
        feet = [np.column_stack([track.boxes[:, ::2].mean(axis=1), track.boxes[:, 3]]) / size for track in tracks]
        ends += [(foot[0], foot[-1]) for foot in feet]
        looks.append(mean_looks(pictures[k]))
    width = max((rows.shape[1] for rows in looks if rows.any()), default=1)
    same = [centred(rows) if rows.shape[1] == width else np.zeros((len(rows), width)) for rows in looks]
    clock, places = np.array(times), np.array(ends)
    return Passages(np.array(views), clock[:, 0], clock[:, 1], places[:, 0], places[:, 1], np.concatenate(same))


def _pictures(name: str, result: Result[Track], describer: Describe | None) -> list[FloatArray]:
    """Rows of pictures of each track; none where nothing describes them or the video is not there."""
    tracks = boxes_of(result)
    pictures = None if describer is None else described_tracks(result, tracks, describer)
    if pictures is None and describer is not None:
        warnings.warn(
            f"{name}: its video is not there; its people are linked by times alone", InputWarning, stacklevel=4
        )
    return [np.empty((0, 1))] * len(tracks) if pictures is None else pictures


def _joined(
    names: Sequence[str], results: Sequence[Result[Track]], passages: Passages, links: Transits, margin: float
) -> tuple[Linked, IntArray]:
    """The results with common ids, and ``(N,)`` the id of each track."""
    sure = standing_out(passages, links, margin)
    ids = people_of(len(passages.view), links, sure)
    tracks = [track for result in results for track in boxes_of(result)]
    rows: dict[bool, list[tuple[Any, ...]]] = {True: [], False: []}
    for k in np.lexsort([links.later, links.earlier]):
        i, j = int(links.earlier[k]), int(links.later[k])
        numbers = (float(round(part[k], 4)) for part in (links.seconds, links.likeness, links.margins))
        ends = names[passages.view[i]], tracks[i].id, names[passages.view[j]], tracks[j].id
        rows[bool(sure[k])].append((int(ids[i]), *ends, *numbers))
    begin, linked_results = 0, []
    for result in results:
        boxes = boxes_of(result)
        numbered = zip(boxes, ids[begin : begin + len(boxes)].tolist(), strict=True)
        linked_results.append(replace(result, tracks=_merged(numbered), files={}, painter=None, points=None))
        begin += len(boxes)
    return Linked(linked_results, names, rows[True], rows[False]), ids


def _merged(numbered: Any) -> list[Track]:
    """Tracks by their ids; a person who comes back to a view has one track there."""
    by_id: dict[int, list[Track]] = {}
    for track, number in numbered:
        by_id.setdefault(number, []).append(track)
    merged = []
    for number, parts in sorted(by_id.items()):
        frames, boxes, scores, observed, origin = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("frames", "boxes", "scores", "observed", "origin")
        )
        times, row = np.unique(frames, return_index=True)
        merged.append(Track(number, times, boxes[row], scores[row], observed[row], origin[row], parts[0].names))
    return merged


def link_results(
    results: list[str],
    *,
    output: Output,
    starts: Commas[list[float] | None] = None,
    appearance: str | None = None,
    margin: NonNegativeFloat = MARGIN,
    fps: Commas[list[FrameRate] | None] = None,
    gallery: Path | None = None,
    remember: Days | None = None,
) -> int:
    """Give a person the same id in cameras that do not overlap, or in files that follow each other.

    DIR gets a folder with tracks.txt for each result, joins.csv, and unsure.csv with joins that were not made. With a
    gallery it also gets people.csv, with the name of each id and its probability.

    Args:
        results: folders of results of track people, files of tracks, or videos, which are tracked first.
        starts: seconds at which each begins, by one clock, separated by commas; by default all at once.
        appearance: exported network that describes people; none goes by times and places alone.
        margin: least margin of a join that is made, natural logarithm, 0 or more: 2.2 is nine to one.
        fps: frames a second, where a result does not say; one number, or one a result, separated by commas.
        gallery: folder of people to recognise, see tsuiseki gallery; one result is enough with it.
        remember: also keep people who are not in the gallery, as unknown-1 and so on, for so many days.
    """
    if remember is not None and gallery is None:
        raise RequestError("`remember`: expected it with `gallery`, whose people it adds to; give both")
    with output.run() as run:
        with run.times.measure("link"):
            common = link(results, starts, appearance, margin, fps, gallery, remember)
        run.facts |= first_to_go(result.facts for result in common.results)
        for name, result in zip(common.names, common.results, strict=True):
            run.write(f"{name}/tracks.txt", write_tracks, result.tracks)
            run.results[name] = result.video_record()
        for name, rows in (("joins.csv", common.joins), ("unsure.csv", common.unsure)):
            run.write(name, write_joins, rows)
        people = len({track.id for result in common.results for track in result})
        summary = f"{people} people, {len(common.joins)} joins, {len(common.unsure)} unsure ones not made"
        if gallery is not None:
            run.write("people.csv", write_people, common.people)
            summary += f"; {sum(bool(row[1]) for row in common.people)} of them are of the gallery"
        if not common.joins and len(results) > 1:
            when = "" if starts else ", or did not begin at once: give --starts"
            summary += f"; nobody stands out from strangers: these cameras share nobody, or few{when}"
        if gallery is not None and remember is not None and common.gallery is not None:
            common.gallery.write(gallery)
        run.done(f"{summary}: {output.out}")
    return run.status


def write_joins(path: Path, rows: Sequence[tuple[Any, ...]]) -> None:
    """Write joins as CSV."""
    _write_rows(path, [COLUMNS, *rows])


def write_people(path: Path, rows: Sequence[tuple[int, str, float]]) -> None:
    """Write who is who as CSV."""
    _write_rows(path, [PEOPLE_COLUMNS, *rows])


def _write_rows(path: Path, rows: Sequence[tuple[Any, ...]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)
