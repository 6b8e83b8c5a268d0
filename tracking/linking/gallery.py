"""`tsuiseki gallery`: people to recognise in later results."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.features.exported import AppearanceLike, Describe, usual_describer
from tsuiseki.tracking.features.gallery import FILE, Gallery, Look, check_network, network_of, read_gallery
from tsuiseki.tracking.features.recognition import centre_of
from tsuiseki.tracking.linking.identities import look_of
from tsuiseki.tracking.linking.looks import described_tracks, mean_looks
from tsuiseki.tracking.output import check_writable
from tsuiseki.tracking.people.tracks_of_source import boxes_of, tracked
from tsuiseki.tracking.privacy import Days
from tsuiseki.tracking.video.source import open_source

Action: TypeAlias = Literal["add", "remove", "list"]
# A result and the id of one of its tracks.
_TRACK = re.compile(r"(.+):(\d+)")


def add_person(
    gallery: Gallery | None,
    name: str,
    sources: list[str],
    appearance: AppearanceLike | None = None,
    consent: str = "",
    retention: int | None = None,
) -> Gallery:
    """The gallery with more looks of a person.

    Args:
        gallery: None for a new one.
        name: of the person, who may be there already.
        sources: pictures that show the person alone, folders of such pictures, or ``RESULT:ID`` for a track.
        appearance: as of `track_people`; by default the shipped network.
        consent: how the person agreed.
        retention: days for which the looks may be kept.

    Raises:
        RequestError: a source is missing or shows nothing, or the network is not that of the gallery.
    """
    describer = usual_describer(appearance)
    if gallery is None:
        gallery = Gallery(network_of(describer))
    check_network(gallery, describer, "the gallery")
    for source in sources:
        gallery = gallery.with_look(name, _look(source, describer), consent, retention)
    for doubt in gallery.doubts(name.strip()):
        warnings.warn(doubt, InputWarning, stacklevel=2)
    return gallery


def _look(source: str, describer: Describe) -> Look:
    track = _TRACK.fullmatch(source)
    if track is not None and not Path(source).exists():
        return _look_of_track(source, track[1], int(track[2]), describer)
    video = open_source(source)
    if video.endless or not video.has_images:
        raise RequestError(f"{source}: expected pictures of one person, or RESULT:ID, such as out/door:7")
    rows = [
        describer.describe(frame.image, np.array([[0.0, 0.0, *frame.image.shape[1::-1]]])) for frame in video.frames()
    ]
    pictures = np.concatenate(rows) if rows else np.empty((0, 1))
    pictures = pictures[np.isfinite(pictures).all(axis=1)]
    if not len(pictures):
        raise RequestError(f"{source}: expected pictures of one person, found none that the network describes")
    return look_of(source, pictures, None)


def _look_of_track(source: str, folder: str, number: int, describer: Describe) -> Look:
    result = tracked(folder)
    tracks = boxes_of(result)
    ids = [track.id for track in tracks]
    if number not in ids:
        shown = ", ".join(map(str, ids[:10])) + ("" if len(ids) <= 10 else f" and {len(ids) - 10} more")
        raise RequestError(f"{source}: expected the id of a track, one of {shown}, got {number}")
    pictures = described_tracks(result, tracks, describer)
    if pictures is None:
        raise RequestError(f"{source}: its video is not there, so that nothing tells how {number} looks")
    own = pictures[ids.index(number)]
    if not len(own):
        raise RequestError(f"{source}: no detection supports this track, so that no picture shows it")
    return look_of(source, own, centre_of(mean_looks(pictures)))


def gallery(
    what: Action,
    name: str = "",
    sources: list[str] | None = None,
    *,
    gallery: Path = Path("gallery"),
    appearance: str | None = None,
    consent: str = "",
    retention: Days | None = None,
) -> int:
    """Keep people to recognise in later results: how they look by name, never their pictures.

    tsuiseki gallery add anna anna1.jpg anna2.jpg out/door:7 keeps how anna looks in two pictures and as track 7 of a
    result. tsuiseki gallery remove anna deletes it for good. tsuiseki gallery list shows who is there. tsuiseki link
    --gallery and follow_people recognise them. It is clothes that the network knows, so a look holds for a day.

    Args:
        what: add, remove or list.
        name: of the person.
        sources: pictures that show the person alone, folders of such pictures, or RESULT:ID for a track of a result.
        gallery: folder of the gallery.
        appearance: exported network that describes people.
        consent: how the person agreed, in words; shown by list.
        retention: days for which the person may be kept; afterwards the person is not recognised any more.
    """
    if what == "list":
        print(_listed(read_gallery(gallery)))
        return 0
    if not name:
        raise RequestError(f"expected whom to {what}: tsuiseki gallery {what} NAME")
    if what == "remove":
        if sources:
            raise RequestError(f"expected one name to remove, got also {', '.join(sources)}")
        read_gallery(gallery).without(name).write(gallery)
        print(f"removed for good: {name}")
        return 0
    if not sources:
        raise RequestError(f"expected pictures of {name}, or RESULT:ID: tsuiseki gallery add {name} PICTURES")
    check_writable(gallery)
    before = read_gallery(gallery) if (gallery / FILE).exists() else None
    people = add_person(before, name, sources, appearance, consent, retention)
    people.write(gallery)
    print(f"{_count(people, name)}: {gallery}")
    return 0


def _count(gallery: Gallery, name: str) -> str:
    pictures = sum(len(look.pictures) for look in gallery.people[name.strip()].looks)
    return f"{name}: {pictures} {'picture' if pictures == 1 else 'pictures'}; {len(gallery.people)} in the gallery"


def _listed(gallery: Gallery) -> str:
    rows = [("name", "looks", "pictures", "added", "until", "consent")]
    for name, person in gallery.people.items():
        until = "no end" if person.until is None else person.until.isoformat()
        counts = str(len(person.looks)), str(sum(len(look.pictures) for look in person.looks))
        rows.append((name, *counts, person.added.isoformat(), until, person.consent or "not recorded"))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
