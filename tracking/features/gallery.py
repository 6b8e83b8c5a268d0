"""A gallery: people by name, how they look, and until when that may be kept.

A folder with one file, ``gallery.json``::

    {"network": "sha256 of the network that describes, or its kind",
     "people": {"anna": {"consent": "…", "added": "2026-11-30", "retention": 30, "looks": [
         {"source": "out/door:7", "pictures": [[…], …], "centre": […]}]}}}

A look is one visit: rows of the network for its pictures, and the mean of all people in that view, or null where only
pictures of the person are there. Who is removed leaves the file as it is written anew; pictures are never kept.
"""

from __future__ import annotations

import json
import warnings
from dataclasses import field, replace
from datetime import date
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, RootModel, StringConstraints, ValidationError
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS, refusal
from tsuiseki.tracking.errors import InputWarning, RequestError, a_path
from tsuiseki.tracking.features.exported import Describe
from tsuiseki.tracking.features.recognition import centre_of, unit_rows, without
from tsuiseki.tracking.fields import refused
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.output import whole_file
from tsuiseki.tracking.privacy import Days, last_day, today
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.weights.catalogue import file_sum

FILE = "gallery.json"
# Cosine of a picture with the others under the same name, below which it may show somebody else. Of generated people
# one in fifty of their own pictures has less, of others' pictures nine in ten.
UNLIKE = 0.35
# Cosine from which on two people are mistaken for each other: the usual one of one person on two days.
ALIKE = 0.8
# Names stand in tables, on pages and in files.
PersonName = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=60, pattern=r"^[^\x00-\x1f]+$")
]
Row = Annotated[list[float], Field(min_length=1, max_length=65_536)]


@dataclass(frozen=True, config=SETTINGS, repr=False)
class Look:
    """One visit of a person.

    Attributes:
        source: where the pictures are from.
        pictures: a row of the network for each.
        centre: mean row of all people in that view; None where it is not known.
    """

    source: Annotated[str, Field(max_length=4096)]
    pictures: Annotated[list[Row], Field(min_length=1, max_length=10_000)]
    centre: Row | None = None

    def __repr__(self) -> str:
        return f"<Look: {len(self.pictures)} pictures of {self.source[-60:]}>"

    @property
    def mean(self) -> FloatArray:
        """``(1, D)`` mean of the pictures, each of unit length."""
        return np.asarray(unit_rows(np.array(self.pictures)).mean(axis=0, keepdims=True))

    def centre_or(self, usual: FloatArray | None) -> FloatArray | None:
        """``(D,)`` the centre, or the usual one where it is not known."""
        return usual if self.centre is None else np.array(self.centre)


@dataclass(frozen=True, config=SETTINGS)
class KnownPerson:
    """Somebody in a gallery.

    Attributes:
        added: the day of the first look.
        looks: of the person.
        consent: how the person agreed; empty where that is not recorded.
        retention: days after ``added`` for which the looks may be kept; None for no end.
    """

    added: date
    looks: Annotated[list[Look], Field(min_length=1)]
    consent: Annotated[str, Field(max_length=500)] = ""
    retention: Days | None = None

    @property
    def until(self) -> date | None:
        """The last day; None for no end."""
        return None if self.retention is None else last_day(self.added, self.retention)


@dataclass(frozen=True, config=SETTINGS, repr=False)
class Gallery:
    """People by name.

    Attributes:
        network: what describes them, see `network_of`.
        people: by name.
    """

    network: Annotated[str, Field(min_length=1, max_length=200)]
    people: dict[PersonName, KnownPerson] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<Gallery: {len(self.people)} people>"

    def with_look(self, name: str, look: Look, consent: str = "", retention: int | None = None) -> Gallery:
        """The gallery with one more look of a person, who may be new; a consent or retention replaces an earlier one.

        Raises:
            RequestError: the name or a value cannot be used, or the rows have another length than those there.
        """
        lengths = {len(row) for person in self.people.values() for part in person.looks for row in part.pictures}
        came = {len(row) for row in look.pictures}
        if len(lengths | came) > 1:
            raise RequestError(f"{look.source}: expected rows of {min(lengths or came)} numbers, got {max(came)}")
        before = self.people.get(name.strip())
        with refused():
            added = KnownPerson(
                added=before.added if before else today(),
                looks=[*(before.looks if before else []), look],
                consent=consent or (before.consent if before else ""),
                retention=retention if retention is not None else (before.retention if before else None),
            )
            return Gallery(self.network, {**self.people, name.strip(): added})

    def without(self, name: str) -> Gallery:
        """The gallery without a person.

        Raises:
            RequestError: nobody has the name.
        """
        if name not in self.people:
            raise RequestError(f"expected one of {', '.join(sorted(self.people)) or 'nobody'}, got {name!r}")
        return replace(self, people={other: person for other, person in self.people.items() if other != name})

    def current(self) -> Gallery:
        """The gallery without those whose time is over, which is said."""
        over = [name for name, person in self.people.items() if person.until is not None and person.until < today()]
        if over:
            warnings.warn(
                f"the time of {', '.join(over)} in the gallery is over; they are not recognised. Remove them",
                InputWarning,
                stacklevel=3,
            )
        return replace(self, people={name: person for name, person in self.people.items() if name not in over})

    def rows(self, centre: FloatArray | None = None) -> FloatArray:
        """``(K, D)`` how the people look, as `recognition.recognise` takes them.

        Args:
            centre: ``(D,)`` mean of the people in view, for looks without one in a gallery of few people.
        """
        own = self.centre()
        usual = centre if own is None else own
        visits = [[without(look.mean, look.centre_or(usual))[0] for look in p.looks] for p in self.people.values()]
        return unit_rows(np.array([np.mean(rows, axis=0) for rows in visits])) if visits else np.empty((0, 0))

    def centre(self) -> FloatArray | None:
        """``(D,)`` mean of those in the gallery; None where there are too few."""
        first = [person.looks[0].mean for person in self.people.values()]
        return centre_of(np.concatenate(first)) if first else None

    def doubts(self, name: str) -> list[str]:
        """Why the looks of a person may not be those of one person, or be those of another; a sentence each."""
        person = self.people[name]
        usual = self.centre()
        pictures = np.concatenate([without(np.array(x.pictures), x.centre_or(usual)) for x in person.looks])
        sources = [look.source for look in person.looks for _ in look.pictures]
        said = []
        if len(pictures) > 1:
            # About the picture that is most like the others lie those of one person.
            cosines = pictures @ pictures.T
            core = cosines[cosines.sum(axis=0).argmax()] >= UNLIKE
            unlike = pictures @ unit_rows(pictures[core].mean(axis=0)[None])[0] < UNLIKE
            if unlike.any():
                where = ", ".join(dict.fromkeys(np.array(sources)[unlike].tolist()))
                said.append(
                    f"{int(unlike.sum())} of {len(pictures)} pictures of {name!r} look like somebody else: {where}"
                )
        names, rows = list(self.people), self.rows()
        alike = rows @ rows[names.index(name)]
        said += [
            f"{name!r} and {other!r} look alike (cosine {cosine:.2f}) and will be mistaken for each other"
            for other, cosine in zip(names, alike, strict=True)
            if other != name and cosine > ALIKE
        ]
        return said

    def write(self, folder: Path) -> None:
        """Write ``gallery.json``; what is there is replaced as a whole."""
        content = RootModel[Gallery](self).model_dump(mode="json")
        with whole_file(folder / FILE) as file:
            file.write((json.dumps(content, ensure_ascii=False) + "\n").encode())


def read_gallery(folder: str | Path) -> Gallery:
    """The gallery in a folder.

    Raises:
        RequestError: there is none, or its file is broken.
    """
    path = a_path(folder, "folder") / FILE
    if not path.is_file():
        raise RequestError(f"{folder}: expected a gallery, found no {FILE}; make one with `tsuiseki gallery add`")
    content = read_json(path, "a gallery")
    try:
        return RootModel[Gallery].model_validate(content).root
    except ValidationError as error:
        raise RequestError(f"{path}: {refusal(error)}") from error


def network_of(describer: Describe) -> str:
    """What describes: the sum of its file, or what kind of function it is."""
    path = getattr(getattr(describer, "model", describer), "path", None)
    return file_sum(Path(path)) if path is not None else type(describer).__name__


def check_network(gallery: Gallery, describer: Describe, where: str | Path) -> None:
    """Refuse rows of another network than the gallery's; raises RequestError."""
    network = network_of(describer)
    if network != gallery.network:
        raise RequestError(
            f"{where}: its people were described by network {gallery.network[:12]}, this is {network[:12]}; name the "
            f"same `appearance`, or make a gallery anew"
        )


def opened_gallery(gallery: str | Path | Gallery, describer: Describe | None) -> Gallery:
    """The people whose time is not over; raises RequestError where the describer is not that of the gallery."""
    where = "the gallery" if isinstance(gallery, Gallery) else str(gallery)
    people = gallery if isinstance(gallery, Gallery) else read_gallery(gallery)
    if describer is None:
        raise RequestError(f"{where} needs an appearance network; leave appearance none out")
    check_network(people, describer, where)
    return people.current()
