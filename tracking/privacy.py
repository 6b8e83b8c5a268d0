"""Why people are followed, and until when the result may be kept: a record that stays with the result.

    privacy:                             # in scene.yaml, or in a file of its own
      purpose: how many people pass the entrance
      area: entrance hall, east door
      retention: 30                      # days after the run
      access: shop manager

`track people --privacy` takes it into ``run.json``, whose facts also say the day of the run. Pages show it, and `hide`
writes it into the hidden video. `tsuiseki forget` deletes by it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, StringConstraints
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.fields import refused
from tsuiseki.tracking.openers.yaml_files import read_yaml

# Of a fact of a run.
PRIVACY = "privacy"
# A sentence, which a page shows in a line or two.
Sentence = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=200)]
# Up to a hundred years.
Days = Annotated[int, Field(ge=0, le=36_500)]


@dataclass(frozen=True, config=SETTINGS)
class Privacy:
    """A record of privacy.

    Attributes:
        purpose: what the result is for.
        area: what the camera sees.
        retention: days after the run for which the result may be kept.
        access: who may see it.
    """

    purpose: Sentence
    area: Sentence
    retention: Days
    access: Sentence

    def facts(self, today: date) -> dict[str, Any]:
        """What ``run.json`` says of a run of this day."""
        return {**asdict(self), "made": today.isoformat(), "until": last_day(today, self.retention).isoformat()}


def today() -> date:
    """The day at Greenwich."""
    return datetime.now(UTC).date()


def last_day(made: date, retention: int) -> date:
    """The last day on which a result may be kept.

    >>> last_day(date(2026, 2, 27), 2).isoformat()
    '2026-03-01'
    """
    return made + timedelta(days=retention)


def metadata_of(facts: Mapping[str, Any]) -> dict[str, str]:
    """The record in the facts of a run as metadata of a video; nothing where there is none."""
    record = facts.get(PRIVACY, {})
    return {"comment": "; ".join(f"{name}: {value}" for name, value in record.items())} if record else {}


def first_to_go(facts: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Of several runs' facts the record of privacy whose days end first, as a fact; nothing where none has one."""
    records = [of_run[PRIVACY] for of_run in facts if PRIVACY in of_run]
    return {PRIVACY: min(records, key=lambda record: str(record.get("until", "")))} if records else {}


def privacy_of(content: Any, where: str) -> Privacy:
    """The record in a mapping of YAML; raises RequestError, which says ``where``."""
    names = ", ".join(Privacy.__dataclass_fields__)
    if not isinstance(content, dict) or content.keys() != Privacy.__dataclass_fields__.keys():
        raise RequestError(f"{where}: privacy: expected {names}, got {str(content)[:100]}")
    try:
        with refused():
            return Privacy(**content)
    except RequestError as error:
        raise RequestError(f"{where}: privacy: {error}") from error


def read_privacy(path: Path) -> Privacy:
    """The record in a file.

    Raises:
        RequestError: the file is missing or no YAML, has no ``privacy``, or a field of it is missing or wrong.
    """
    content = read_yaml(path, "YAML with a record of privacy")
    if not isinstance(content, dict) or PRIVACY not in content:
        raise RequestError(f"{path}: expected {PRIVACY} with {', '.join(Privacy.__dataclass_fields__)}, found none")
    return privacy_of(content[PRIVACY], str(path))
