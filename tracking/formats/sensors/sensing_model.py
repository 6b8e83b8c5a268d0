"""The model of a sensor and its targets as YAML.

    sensor: {model: linear, dimensions: 2, deviation: 10}
    motion: {model: constant-velocity, acceleration: 5}     # or a list of motions that take turns
    switching: 0.1
    detection: 0.98
    survival: 0.99
    clutter: 10
    region: [[-1000, 1000], [-1000, 1000]]
    leave: gone
    births: {rate: 0.1, speed: 10}                          # or with places: [{mean: […], deviation: […], rate: 0.03}]

Every key may be left out; see `tracking.types.measurements.SensingModel` for what they mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import yaml

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types.measurements import BirthPlace, BirthSettings, MotionSettings, SensingModel, SensorSettings

T = TypeVar("T")
PLAIN = ("switching", "detection", "survival", "clutter")


def read_sensing_model(path: Path) -> SensingModel:
    """The model in a YAML file.

    Raises:
        RequestError: it is no YAML, or a key or value is not as expected.
    """
    if not path.is_file():
        raise RequestError(f"expected a YAML file with the model of the sensor at {path}, found no file")
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise RequestError(f"{path}: expected YAML, got {' '.join(str(error).split())}") from error
    try:
        return sensing_model(content or {})
    except RequestError as error:
        raise RequestError(f"{path}: {error}") from error


def sensing_model(content: Mapping[str, Any]) -> SensingModel:
    """The model of such a mapping.

    Raises:
        RequestError: a key or value is not as expected.
    """
    known = ("sensor", "motion", "region", "leave", "births", *PLAIN)
    _check_keys("the model", content, known)
    motions = content.get("motion", {})
    several = motions if isinstance(motions, list) else [motions]
    births = dict(_mapping("births", content.get("births", {})))
    places = births.pop("places", [])
    if not isinstance(places, list):
        raise RequestError(f"births.places: expected a list, got {places!r}")
    made = tuple(_made("births.places", BirthPlace, place) for place in places)
    region = content.get("region", [])
    if not isinstance(region, list) or any(not isinstance(pair, list) or len(pair) != 2 for pair in region):
        raise RequestError(f"region: expected a list of pairs low, high, got {region!r}")
    return SensingModel(
        sensor=_made("sensor", SensorSettings, content.get("sensor", {})),
        motions=tuple(_made("motion", MotionSettings, motion) for motion in several),
        region=tuple((_number("region", low), _number("region", high)) for low, high in region),
        leave=content.get("leave", "unseen"),
        births=_made("births", BirthSettings, births, places=made),
        **{name: _number(name, content[name]) for name in PLAIN if name in content},
    )


def _made(name: str, kind: type[T], content: Any, **more: Any) -> T:
    """A dataclass of numbers, words and tuples of numbers from a mapping."""
    content = _mapping(name, content)
    types = {field.name: str(field.type) for field in fields(kind) if field.name not in more}  # type: ignore[arg-type]
    _check_keys(name, content, tuple(types))
    values = {key: _value(f"{name}.{key}", types[key], value) for key, value in content.items()}
    try:
        return kind(**values, **more)
    except TypeError as error:
        missing = [key for key in types if key not in values]
        raise RequestError(f"{name}: expected the keys {', '.join(types)}, found no {missing[0]}") from error


def _value(name: str, kind: str, value: Any) -> Any:
    if kind.startswith("tuple"):
        return tuple(_number(name, each) for each in (value if isinstance(value, list) else [value]))
    return _number(name, value) if kind == "float" else value


def _mapping(name: str, content: Any) -> Mapping[str, Any]:
    if not isinstance(content, Mapping):
        raise RequestError(f"{name}: expected keys with values, got {content!r}")
    return content


def _check_keys(name: str, content: Any, known: tuple[str, ...]) -> None:
    unknown = [key for key in _mapping(name, content) if key not in known]
    if unknown:
        raise RequestError(f"{name}: expected the keys {', '.join(known)}, got {unknown[0]!r}")


def _number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise RequestError(f"{name}: expected a number, got {value!r}")
    return float(value)
