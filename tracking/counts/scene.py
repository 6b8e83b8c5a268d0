"""`scene.yaml`: the lines and zones of a picture in which people are counted.

    size: [1920, 1080]         # width, height of the picture, pixels
    unit: pixels               # of all places below; or metres, with a scale or a camera
    scale: 0.02                # optional: metres a pixel, of a picture straight from above
    camera: cameras.yaml       # optional, beside this file: a calibrated camera over the floor; of several
                               # cameras `{file: cameras.yaml, name: left}`
    lines:
    - name: door
      from: [100, 400]
      to: [300, 400]
      directions: [in, out]    # optional: from the left of the line to its right, as seen from `from`; and back
    zones:
    - name: shop
      corners: [[400, 100], [800, 100], [800, 500], [400, 500]]
      stay: 60                 # optional: seconds after which an event says that somebody stays
    events: {moves: 1, counts: 60}   # optional: seconds from an event to the next: of where a person is, and of counts
    region: [[0, 200], [1920, 200], [1920, 1080], [0, 1080]]   # optional: people outside are not counted
    ignored: []                # optional: polygons in which people are not counted
    privacy: {purpose: ..., area: ..., retention: 30, access: ...}    # optional: see `privacy`

Zones may lie inside each other. Their borders may not cross.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np
import yaml

from tsuiseki.tracking.cameras.camera_files import AnyCamera, read_cameras
from tsuiseki.tracking.counts.polygons import crosses_itself, edges_cross
from tsuiseki.tracking.errors import RequestError, a_path
from tsuiseki.tracking.openers.yaml_files import read_yaml
from tsuiseki.tracking.privacy import PRIVACY, Privacy, privacy_of
from tsuiseki.tracking.types import FloatArray

# Lines or zones of a scene, and corners of a polygon.
MOST = 1000
# Characters of a name, so that it fits into a plot.
LONGEST_NAME = 60
DIRECTIONS = ("in", "out")
# Seconds of a stay or an interval: a week.
LONGEST_SECONDS = 604_800
Unit = Literal["pixels", "metres"]


@dataclass(frozen=True, eq=False)
class SceneLine:
    """A line that people cross.

    Attributes:
        name: unique in a scene.
        ends: ``(2, 2)`` in the unit of the scene.
        directions: what a crossing from left to right is called, as seen from the first end; and one
            back.
    """

    name: str
    ends: FloatArray
    directions: tuple[str, str] = DIRECTIONS


@dataclass(frozen=True, eq=False)
class SceneZone:
    """A place that people enter and leave.

    Attributes:
        name: unique in a scene.
        corners: ``(N, 2)`` in the unit of the scene.
        stay: seconds after which an event says that somebody stays; None for never.
    """

    name: str
    corners: FloatArray
    stay: float | None = None


@dataclass(frozen=True)
class EventIntervals:
    """Seconds from an event to the next: ``moves`` of where a person is, ``counts`` of how many there were."""

    moves: float = 1.0
    counts: float = 60.0


@dataclass(frozen=True, eq=False)
class Scene:
    """What is counted in a picture; see the head of this file.

    Attributes:
        lines: that people cross.
        zones: that they enter and leave.
        size: width and height of the picture, pixels; None where it is not known.
        unit: of all places.
        scale: metres a pixel; None where it is not known.
        camera: over the floor; None where there is none.
        region: ``(N, 2)`` corners outside of which people are not counted; None for the whole picture.
        ignored: ``(N, 2)`` corners each, inside of which people are not counted.
        events: how often events of a running camera come.
        privacy: the record of it; None where there is none.
    """

    lines: Sequence[SceneLine] = ()
    zones: Sequence[SceneZone] = ()
    size: tuple[int, int] | None = None
    unit: Unit = "pixels"
    scale: float | None = None
    camera: AnyCamera | None = None
    region: FloatArray | None = None
    ignored: Sequence[FloatArray] = ()
    events: EventIntervals = EventIntervals()
    privacy: Privacy | None = None

    @property
    def has_metres(self) -> bool:
        """Whether places on the floor are known in metres."""
        return self.scale is not None or self.camera is not None

    def metres(self, pixels: FloatArray) -> FloatArray:
        """``(N, 2)`` metres on the floor of ``(N, 2)`` pixels; NaN where a pixel shows no floor."""
        if self.camera is not None:
            return self.camera.ground(pixels)[:, :2]
        assert self.scale is not None
        return pixels * self.scale

    def pixels(self, points: FloatArray) -> FloatArray:
        """``(N, 2)`` pixels of ``(N, 2)`` points in the unit of the scene."""
        if self.unit == "pixels":
            return points
        if self.camera is not None:
            return self.camera.project(np.insert(points, 2, 0.0, axis=1))[0]
        assert self.scale is not None
        return points / self.scale

    def on_floor(self) -> Scene:
        """The same scene in metres.

        Raises:
            RequestError: metres are not known, or a place shows no floor.
        """
        if self.unit == "metres":
            return self
        if not self.has_metres:
            raise RequestError("`anchor`: floor needs a scale or a camera in the scene, got neither; take feet")

        def moved(name: str, points: FloatArray) -> FloatArray:
            floor = self.metres(points)
            if not np.isfinite(floor).all():
                raise RequestError(f"{name}: expected places on the floor, got some at or above the horizon")
            return floor

        return replace(
            self,
            lines=[replace(line, ends=moved(line.name, line.ends)) for line in self.lines],
            zones=[replace(zone, corners=moved(zone.name, zone.corners)) for zone in self.zones],
            unit="metres",
            region=None if self.region is None else moved("region", self.region),
            ignored=[moved("ignored", corners) for corners in self.ignored],
        )

    @property
    def right_is(self) -> float:
        """1 where y points down, as in pictures; -1 where it points up, as on the floor under a camera."""
        return -1.0 if self.unit == "metres" and self.camera is not None else 1.0

    def check_video(self, size: tuple[int, int] | None, where: str = "scene") -> None:
        """Refuse a scene that is of another picture; a size of None is not known, ``where`` is for messages.

        Raises:
            RequestError: the size is another, or a place lies outside.
        """
        if size is None:
            return
        advice = f"the video has {size[0]}x{size[1]}; draw the scene on this video"
        if self.size is not None and self.size != size:
            raise RequestError(
                f"{where}: expected the size of the video, got {self.size[0]}x{self.size[1]}, and {advice}"
            )
        if self.unit == "pixels":
            for name, points in self.places():
                if (points < 0).any() or (points > np.array(size)).any():
                    raise RequestError(
                        f"{where}: {name}: expected places in the picture, got {points.tolist()}; {advice}"
                    )

    def places(self) -> list[tuple[str, FloatArray]]:
        """The points of each line and zone, by name."""
        return [(line.name, line.ends) for line in self.lines] + [(zone.name, zone.corners) for zone in self.zones]


def read_scene(path: str | Path) -> Scene:
    """The scene in a file.

    Raises:
        RequestError: the file is missing or no YAML, a field is unknown, missing or wrong, a line has no length, the
            borders of zones cross, or two things have one name.
    """
    path = a_path(path)
    return scene_of(read_yaml(path, "YAML with lines and zones"), str(path), path.parent)


def scene_of(content: Any, where: str, folder: Path) -> Scene:
    """As `read_scene`, of a mapping of YAML or JSON; ``where`` is for messages, camera files lie in ``folder``."""
    parts = ("size", "unit", "scale", "camera", "lines", "zones", "region", "ignored", "events", PRIVACY)
    _fields(content, parts, where)
    unit = content.get("unit", "pixels")
    if unit not in ("pixels", "metres"):
        raise RequestError(f"{where}: unit: expected pixels or metres, got {unit!r}")
    size = _size(content.get("size"), where)
    camera = _camera(content.get("camera"), where, folder, size)
    scale = content.get("scale")
    if scale is not None and not (_is_number(scale) and 0 < scale < 1e6):
        raise RequestError(f"{where}: scale: expected metres a pixel above 0, got {scale!r}")
    if scale is not None and camera is not None:
        raise RequestError(f"{where}: expected a scale or a camera, got both; leave one out")
    if unit == "metres" and scale is None and camera is None:
        raise RequestError(f"{where}: unit: metres need a scale or a camera, got neither; add one, or give pixels")
    lines = [_line(entry, f"{where}: line {k + 1}") for k, entry in enumerate(_entries(content, "lines", where))]
    zones = [_zone(entry, f"{where}: zone {k + 1}") for k, entry in enumerate(_entries(content, "zones", where))]
    if not lines and not zones:
        raise RequestError(f"{where}: expected at least one entry under lines or zones, got none")
    region, privacy = content.get("region"), content.get(PRIVACY)
    scene = Scene(
        lines,
        zones,
        size,
        unit,
        scale,
        camera,
        None if region is None else _polygon(region, f"{where}: region"),
        [_polygon(e, f"{where}: ignored {k + 1}") for k, e in enumerate(_entries(content, "ignored", where))],
        _intervals(content.get("events", {}), f"{where}: events"),
        None if privacy is None else privacy_of(privacy, where),
    )
    _check_together(scene, where)
    return scene


def _check_together(scene: Scene, where: str) -> None:
    names = [name for name, _ in scene.places()]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RequestError(f"{where}: expected a name of its own for each line and zone, got {twice} twice")
    for zone, neighbour in combinations(scene.zones, 2):
        if edges_cross(zone.corners, neighbour.corners):
            raise RequestError(
                f"{where}: expected zones beside or inside each other, but the borders of {zone.name} and "
                f"{neighbour.name} cross; move one"
            )
    scene.check_video(scene.size, where)


def scene_text(scene: Scene) -> str:
    """The text of a file for `read_scene`, without a camera."""
    content: dict[str, Any] = {"size": list(scene.size)} if scene.size else {}
    content |= {"unit": scene.unit}
    content |= {"scale": scene.scale} if scene.scale is not None else {}
    content["lines"] = [
        {"name": line.name, "from": start, "to": end, "directions": [*line.directions]}
        for line in scene.lines
        for start, end in (line.ends.tolist(),)
    ]
    content["zones"] = [
        {"name": zone.name, "corners": zone.corners.tolist()} | ({} if zone.stay is None else {"stay": zone.stay})
        for zone in scene.zones
    ]
    content |= {"events": vars(scene.events)} if scene.events != EventIntervals() else {}
    content |= {"region": scene.region.tolist()} if scene.region is not None else {}
    content |= {PRIVACY: asdict(scene.privacy)} if scene.privacy is not None else {}
    content |= {"ignored": [corners.tolist() for corners in scene.ignored]} if len(scene.ignored) else {}
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, allow_unicode=True, width=100)


def _fields(entry: Any, allowed: Sequence[str], where: str, needed: Sequence[str] = ()) -> None:
    """Refuse an entry that is no mapping, has a field that is not ``allowed``, or lacks one that is ``needed``."""
    optional = ", ".join(name for name in allowed if name not in needed)
    takes = f"{', '.join(needed)}{' and, where wanted, ' if needed and optional else ''}{optional}"
    if not isinstance(entry, dict):
        raise RequestError(f"{where}: expected the fields {takes}, got {str(entry)[:60]!r}")
    unknown = [str(name) for name in entry if name not in allowed]
    if unknown:
        raise RequestError(f"{where}: expected the fields {takes}, got {unknown[0][:60]!r}")
    missing = [name for name in needed if name not in entry]
    if missing:
        raise RequestError(f"{where}: expected the fields {takes}, found no {missing[0]}")


def _entries(content: dict[str, Any], name: str, where: str) -> list[Any]:
    entries = content.get(name)
    entries = [] if entries is None else entries
    if not isinstance(entries, list) or len(entries) > MOST:
        raise RequestError(
            f"{where}: {name}: expected a list of up to {MOST} entries (- each), got {str(entries)[:60]!r}"
        )
    return entries


def _line(entry: Any, where: str) -> SceneLine:
    _fields(entry, ("name", "from", "to", "directions"), where, ("name", "from", "to"))
    name = _name(entry["name"], where)
    ends = _points([entry["from"], entry["to"]], f"{where}, {name}: from, to")
    if np.array_equal(ends[0], ends[1]):
        raise RequestError(f"{where}, {name}: expected two ends, got one point {ends[0].tolist()} twice")
    directions = entry.get("directions", DIRECTIONS)
    if not isinstance(directions, list | tuple) or len(directions) != 2:
        raise RequestError(f"{where}, {name}: directions: expected two names, got {directions!r}")
    first, second = (_name(direction, f"{where}, {name}: directions") for direction in directions)
    if first == second:
        raise RequestError(f"{where}, {name}: directions: expected two different names, got {first} twice")
    return SceneLine(name, ends, (first, second))


def _zone(entry: Any, where: str) -> SceneZone:
    _fields(entry, ("name", "corners", "stay"), where, ("name", "corners"))
    name = _name(entry["name"], where)
    stay = None if entry.get("stay") is None else _seconds(entry["stay"], f"{where}, {name}: stay")
    return SceneZone(name, _polygon(entry["corners"], f"{where}, {name}: corners"), stay)


def _intervals(entry: Any, where: str) -> EventIntervals:
    _fields(entry, ("moves", "counts"), where)
    return EventIntervals(**{name: _seconds(value, f"{where}: {name}") for name, value in entry.items()})


def _seconds(value: Any, where: str) -> float:
    if not (_is_number(value) and 0 < value <= LONGEST_SECONDS):
        raise RequestError(f"{where}: expected seconds above 0, up to {LONGEST_SECONDS}, got {value!r}")
    return float(value)


def _name(value: Any, where: str) -> str:
    if isinstance(value, bool) or not isinstance(value, str | int | float) or not str(value).strip():
        raise RequestError(f"{where}: expected a name, got {value!r}; put it into quotes")
    name = str(value).strip()
    # Names go into pages, and into cells of tables, where a spreadsheet may take them for a formula.
    if len(name) > LONGEST_NAME or re.search(r"[<>&\"`\x00-\x1f\x7f]|^[=+@]", name):
        raise RequestError(
            f"{where}: expected a name of up to {LONGEST_NAME} letters and digits, got {name[:LONGEST_NAME]!r}; "
            "leave markup out"
        )
    return name


def _polygon(value: Any, where: str) -> FloatArray:
    corners = _points(value, where)
    if len(corners) > 1 and np.array_equal(corners[0], corners[-1]):
        corners = corners[:-1]
    if len(corners) < 3 or len(corners) > MOST:
        raise RequestError(f"{where}: expected 3 to {MOST} corners x, y, got {len(corners)}")
    if (corners == np.roll(corners, 1, axis=0)).all(axis=1).any():
        raise RequestError(f"{where}: expected corners apart from each other, got one twice in a row")
    if crosses_itself(corners):
        raise RequestError(f"{where}: expected a border that does not cross itself; give the corners in order")
    return corners


def _points(value: Any, where: str) -> FloatArray:
    expected = f"{where}: expected points such as [100, 400], got {str(value)[:80]}"
    if not isinstance(value, list) or not all(
        isinstance(point, list) and len(point) == 2 and all(map(_is_number, point)) for point in value
    ):
        raise RequestError(expected)
    return np.array(value, dtype=np.float64).reshape(-1, 2)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e9


def _size(value: Any, where: str) -> tuple[int, int] | None:
    if value is None:
        return None
    if not (isinstance(value, list) and len(value) == 2 and all(type(v) is int and 0 < v < 100_000 for v in value)):
        raise RequestError(f"{where}: size: expected width, height in pixels, got {value!r}")
    return value[0], value[1]


def _camera(value: Any, where: str, folder: Path, size: tuple[int, int] | None) -> AnyCamera | None:
    if value is None:
        return None
    entry = {"file": value} if isinstance(value, str) else value
    _fields(entry, ("file", "name"), f"{where}: camera", ("file",))
    file, name = PurePosixPath(str(entry["file"])), entry.get("name")
    if file.is_absolute() or ".." in file.parts:
        raise RequestError(f"{where}: camera: expected a file beside the scene, got {file}; copy it there")
    cameras = read_cameras(folder / file)
    matches = [c for c in cameras if name is None or c.name == name]
    if len(matches) != 1:
        named = ", ".join(c.name for c in cameras)
        raise RequestError(f"{where}: camera: expected the name of one of {named}, got {name!r}")
    camera = matches[0].camera
    if size is not None and size != (camera.width, camera.height):
        raise RequestError(
            f"{where}: camera: expected one of {size[0]}x{size[1]} as the scene, got {camera.width}x{camera.height}"
        )
    return camera
