"""One event: the envelope is that of CloudEvents 1.0, what happened is its ``data``.

``events-1.schema.json`` beside this file says what each type holds. It is JSON Schema 2020-12, and
``dataschema`` of every event names it. A change that a receiver of version 1 would not understand makes version 2.

Events are delivered at least once. Two with the same ``id`` are one (CloudEvents 1.0, section "id").
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Literal, get_args
from urllib.parse import quote

SCHEMA = "urn:tsuiseki:events:1"
SCHEMA_FILE = "events-1.schema.json"
# Before the name of a type, as CloudEvents asks for.
PREFIX = "tsuiseki."
EventType = Literal[
    "appeared", "moved", "crossed", "entered", "left", "stayed", "lost", "camera_lost", "camera_back", "counted",
    "correction", "dropped",
]  # fmt: skip
TYPES: tuple[EventType, ...] = get_args(EventType)
_CREDENTIALS = re.compile(r"(?<=://)[^/?#]*@")


@dataclass(frozen=True)
class Event:
    """Something that happened.

    Attributes:
        id: unique over all runs.
        camera: its name; empty for what is of no camera.
        type: what happened.
        data: how, see the schema.
        time: seconds since 1970, UTC; None where a recording does not say when it was.
    """

    id: str
    camera: str
    type: EventType
    data: Mapping[str, Any] = field(default_factory=dict)
    time: float | None = None

    @property
    def line(self) -> str:
        """The event as one line of JSON."""
        envelope: dict[str, Any] = {
            "specversion": "1.0",
            "id": self.id,
            "source": quote(self.camera, safe="/:") or "tsuiseki",
            "type": PREFIX + self.type,
        }
        if self.time is not None:
            moment = datetime.fromtimestamp(round(self.time, 3), UTC).isoformat(timespec="milliseconds")
            envelope["time"] = moment.replace("+00:00", "Z")
        envelope |= {"dataschema": SCHEMA, "data": self.data}
        return json.dumps(envelope, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def public_name(camera: str) -> str:
    """The name of a camera without the name and password of its address.

    >>> public_name("rtsp://admin:secret@10.0.0.7/stream")
    'rtsp://10.0.0.7/stream'
    """
    return _CREDENTIALS.sub("", camera)
