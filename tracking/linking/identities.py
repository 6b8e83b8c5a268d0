"""Who of a gallery the people of linked results are, and how strangers are kept in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.features.gallery import Gallery, Look
from tsuiseki.tracking.features.recognition import (
    centre_of,
    identity_of,
    recognise,
    unit_rows,
    without,
)
from tsuiseki.tracking.linking.looks import mean_looks
from tsuiseki.tracking.linking.transits import Passages
from tsuiseki.tracking.types import FloatArray, IntArray, Recognition

# Digits of a row that are kept: the network's own differ in the sixth from machine to machine.
DIGITS = 5
# Name of a stranger, by number.
STRANGER = "unknown-{}"


def look_of(source: str, pictures: FloatArray, centre: FloatArray | None) -> Look:
    """Rows ``(P, D)`` of one visit, and the centre ``(D,)`` of its view, as a gallery keeps them."""
    rows = np.round(pictures, DIGITS).tolist()
    return Look(source, rows, None if centre is None else np.round(centre, DIGITS).tolist())


def identities(
    gallery: Gallery, passages: Passages, pictures: Sequence[Sequence[FloatArray]], ids: IntArray
) -> dict[int, Recognition]:
    """Who each id is, or nobody.

    Args:
        gallery: whom to recognise.
        passages: N tracks of all views.
        pictures: of each view, the rows of each of its tracks.
        ids: ``(N,)`` of the tracks.
    """
    rows = [mean_looks(of_view) for of_view in pictures]
    centres = [centre_of(of_view, gallery.centre()) for of_view in rows]
    looks = [without(of_view, centre) for of_view, centre in zip(rows, centres, strict=True)]
    length = max(of_view.shape[1] for of_view in looks)
    tracks = np.concatenate([x if x.shape[1] == length else np.zeros((len(x), length)) for x in looks])
    numbers = np.unique(ids)
    member = numbers[:, None] == ids
    people = unit_rows(member.astype(float) @ tracks)
    overlap = (passages.begin[:, None] <= passages.end) & (passages.begin <= passages.end[:, None])
    together = (member.astype(int) @ overlap.astype(int) @ member.T.astype(int)) > 0
    likenesses = gallery.rows(next((centre for centre in centres if centre is not None), None))
    if not likenesses.size or likenesses.shape[1] != length:
        # Nothing describes the people in view, or the gallery is empty.
        likenesses = np.zeros((len(likenesses), length))
    chances = recognise(people, likenesses, together)
    return {int(number): identity_of(row, list(gallery.people)) for number, row in zip(numbers, chances, strict=True)}


def remembered(
    gallery: Gallery,
    rows: Sequence[tuple[int, str, float]],
    tracks: Sequence[str],
    pictures: Sequence[Sequence[FloatArray]],
    ids: IntArray,
    days: int,
) -> tuple[Gallery, list[tuple[int, str, float]]]:
    """The gallery with all who are nobody of it, and who is who with their new names.

    Args:
        gallery: as it was.
        rows: id, name and probability of each person.
        tracks: where each track is from.
        pictures: of each view, the rows of each of its tracks.
        ids: of the tracks.
        days: for which they are kept.
    """
    of_track = [track for of_view in pictures for track in of_view]
    centres = [centre_of(mean_looks(of_view)) for of_view in pictures for _ in of_view]
    named = []
    for number, name, probability in rows:
        described = [k for k in np.flatnonzero(ids == number).tolist() if len(of_track[k])]
        if not name and described:
            name = next(s for n in range(1, len(gallery.people) + 2) if (s := STRANGER.format(n)) not in gallery.people)
            for k in described:
                gallery = gallery.with_look(name, look_of(tracks[k], of_track[k], centres[k]), retention=days)
        named.append((number, name, probability))
    return gallery, named
