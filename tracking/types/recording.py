"""What a result keeps of its video, by which it knows that again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, TypeAdapter, ValidationError

from tsuiseki.tracking.bounds import refusal
from tsuiseki.tracking.errors import RequestError


@dataclass(frozen=True)
class Recording:
    """What is noted of a source beside the tracks in it.

    Attributes:
        frame_rate: frames a second; 0 where not known.
        size: width and height in pixels; None where not known.
        first_time: seconds of the first frame by the container's own clock.
        length: number of its frames, as far as it says; 0 where not known.
        fingerprint: of its files, see `fingerprint_of`; empty where there are none.
    """

    frame_rate: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    size: tuple[int, int] | None = None
    first_time: Annotated[float, Field(allow_inf_nan=False)] = 0.0
    length: Annotated[int, Field(ge=0)] = 0
    fingerprint: Annotated[str, Field(max_length=64)] = ""

    @classmethod
    def parse(cls, values: Mapping[str, Any], where: Path) -> Self:
        """What ``run.json`` has of these, among others; what it lacks is not known.

        Raises:
            RequestError: a value is of another kind.
        """
        names = [column.name for column in fields(cls)]
        present = {name: values[name] for name in names if values.get(name) is not None}
        try:
            return TypeAdapter(cls).validate_python(present)
        except ValidationError as error:
            raise RequestError(f"{where}: {refusal(error)}; it is not as a run wrote it") from error
