"""How a result was made, for the foot of its page: what was asked for, how good it is, and the versions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tsuiseki.tracking.output import versions
from tsuiseki.tracking.privacy import PRIVACY
from tsuiseki.tracking.runs.files import CHOSEN


def how_made(
    settings: Mapping[str, Any], facts: Mapping[str, Any], quality: Mapping[str, str | None]
) -> dict[str, Any]:
    """Names and values to list; values of None are left out there.

    Args:
        settings: of the run; of these the source and the method are listed.
        facts: of the run, with what the user asked for as `CHOSEN`.
        quality: of the result, by name.
    """
    asked = {
        name: "see run.json" if isinstance(value, Mapping) else value for name, value in facts.get(CHOSEN, {}).items()
    }
    return {
        **{name: settings[name] for name in ("method", "source") if name in settings},
        "options": {name: value for name, value in asked.items() if name not in ("method", "source")},
        **quality,
        "versions": versions(),
        **facts.get(PRIVACY, {}),
    }
