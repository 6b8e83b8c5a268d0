"""What public calls say of wrong arguments: settings refuse values, borders say what they expected and got."""

from __future__ import annotations

import importlib
import inspect
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
from pydantic import ValidationError

import tsuiseki

NOTHING = object()
IMAGES = [np.full((48, 64, 3), 90 + 4 * n, np.uint8) for n in range(3)]
BOXES = np.array([[4.0, 4, 14, 24]])
DETECTIONS = [np.column_stack([BOXES + n, [[0.9]]]) for n in range(3)]
TRACK = tsuiseki.Track(1, np.arange(3), BOXES + np.arange(3)[:, None], np.ones(3))
SCANS = [tsuiseki.Scan(float(n), np.array([[n, 2.0 * n]])) for n in range(3)]
MODEL = {"sensor": {"model": "linear"}, "region": [[0, 10], [0, 10]]}
PEOPLE = {"source": IMAGES, "detections": DETECTIONS, "appearance": "none", "affinity": "none"}
BLOBS, BODIES = {"source": IMAGES, "colour": "red"}, {"source": IMAGES, "body": "goldfish"}
SINGLE, PLACES = {"source": IMAGES, "box": BOXES[0], "method": "kcf"}, {"measured": [BOXES[:, :2]], "extent": (64, 48)}


def working(folder: Path) -> dict[str, dict[str, Any]]:
    """Arguments of each public function with which it works, or ends at a file that is not there."""
    missing, out = folder / "missing", folder / "out"
    return {
        "as_detections": {"detections": DETECTIONS[0]},
        "batch": {"command": "track people", "sources": missing, "out": out},
        "calibrate_people": {"sources": [missing, missing]},
        "check_cameras": {"cameras": [], "calibration": NOTHING},
        "convert": {"result": missing, "to": "cvat", "out": out},
        "count": {"result": [TRACK], "scene": tsuiseki.Scene(), "frame_rate": 10.0},
        "count_visitors": {"result": [TRACK], "frame_rate": 10.0},
        "evaluate_people": {"truth": [TRACK], "tracks": [TRACK]},
        "evaluate_points": {"truth": [TRACK], "tracks": [TRACK], "frames": 3},
        "evaluate_target": {"truth": TRACK.boxes, "target": TRACK.boxes},
        "follow_blobs": BLOBS,
        "follow_deformable": BODIES,
        "follow_measurements": {"scans": SCANS, "model": MODEL},
        "follow_people": {**PEOPLE, "method": "sort"},
        "follow_points": PLACES,
        "follow_single": SINGLE,
        "follow_sphere": {"sources": [IMAGES, IMAGES], "cameras": missing, "radius": 0.1},
        "hide": {"video": missing, "result": [TRACK], "out": out},
        "link": {"results": [missing, missing]},
        "add_person": {"gallery": None, "name": "anna", "sources": [str(missing)]},
        "read_gallery": {"folder": missing},
        "read_scene": {"path": missing},
        "read_tracks": {"path": missing},
        "shipped": {"name": "detector_street"},
        "track_animals": {"source": IMAGES},
        "track_blobs": BLOBS,
        "track_deformable": BODIES,
        "track_drone": {"source": IMAGES, "method": "flow", "detections": DETECTIONS, "appearance": "none"},
        "track_fisheye": {"source": IMAGES, "cameras": missing},
        "track_floor": {"sources": [IMAGES], "cameras": missing},
        "track_measurements": {"measured": SCANS, "model": MODEL},
        "track_people": PEOPLE,
        "track_points": PLACES,
        "track_single": SINGLE,
        "track_sphere": {"sources": [IMAGES, IMAGES], "cameras": missing, "radius": 0.1},
        "track_sphere_points": {"files": [missing], "cameras": missing},
        **{
            f"train_{name}": {"train": missing, "out": out}
            for name in ("action", "appearance", "association", "detector")
        },
        "with_page": {"result": tsuiseki.Result([TRACK])},
        "write_tracks": {"path": folder / "tracks.txt", "tracks": [TRACK]},
    }


# `training` is a module of names of its own.
PUBLIC = {name: getattr(tsuiseki, name) for name in tsuiseki.__all__ if name not in ("__version__", "training")}
# A gallery is what a run is asked about, and no settings of it.
SETTINGS = {k for k in PUBLIC.values() if hasattr(k, "__pydantic_validator__") and k is not tsuiseki.Gallery}


def arguments_of(function: Callable[..., Any], kind: Callable[[Any], bool]) -> Iterator[str]:
    """Names of the arguments one of whose types is of a kind."""
    hints = get_type_hints(function.__init__ if inspect.isclass(function) else function)
    for name in inspect.signature(function).parameters:
        types = get_args(hints.get(name)) or (hints.get(name),)
        if any(kind(part) for part in types):
            yield name


def first_of(made: object) -> None:
    """An iterator opens what it needs when it is asked for the first."""
    if isinstance(made, Iterator):
        next(made)


@pytest.mark.parametrize("name", [name for name in PUBLIC if inspect.isfunction(PUBLIC[name])])
def test_an_array_is_no_path_and_a_word_no_settings(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    call, arguments = PUBLIC[name], working(tmp_path)[name]
    wrong = {argument: np.zeros(3) for argument in arguments_of(call, lambda part: part is Path)}
    wrong |= dict.fromkeys(arguments_of(call, lambda part: part in SETTINGS), "word")
    for argument, value in wrong.items():
        with pytest.raises((tsuiseki.RequestError, ValidationError), match="xpected"):
            first_of(call(**{**arguments, argument: value}))


WRONG = [
    ("track_single", {**SINGLE, "method": "zz"}, "`method`: expected 'combined', "),
    ("track_points", {**PLACES, "extent": (64, "a")}, "`extent`: expected width and height"),
    ("evaluate_people", {"truth": [1], "tracks": [TRACK]}, "expected the truth as a folder, a file or tracks"),
    ("link", {"results": [1, 2]}, "expected .*, got int"),
    ("Detections", {"boxes": np.zeros((2, 3)), "scores": np.zeros(2)}, r"expected boxes of shape \(N, 4\), got"),
    ("FlowTracker", {"frame_rate": float("nan")}, "expected a frame rate above 0"),
    ("Sort", {"settings": tsuiseki.FlowSettings()}, "`settings`: expected SortSettings, got FlowSettings"),
]


@pytest.mark.parametrize(("name", "arguments", "line"), WRONG)
def test_a_refusal_says_what_was_expected_and_what_came(name: str, arguments: dict[str, Any], line: str) -> None:
    with pytest.raises(ValueError, match=line):
        PUBLIC[name](**arguments)


OUT_OF_BOUNDS = [
    ("SortSettings", {"max_age": 20_000}, "max_age\n.*less than or equal to 10000"),
    ("Sort", {"max_age": 20_000}, "max_age\n.*less than or equal to 10000"),
    ("Sort", {"min_iou": float("nan")}, "min_iou\n.*finite number"),
    ("BlobSettings", {"particles": "a"}, "particles\n.*valid integer"),
    ("BlobSettings", {"particles": 10**9}, "particles\n.*less than or equal to 1000000"),
    ("FlowSettings", {"fill": 1e300}, "fill\n.*less than or equal to 86400"),
    ("FlowTracker", {"fill": 1e300}, "fill\n.*less than or equal to 86400"),
    ("SortSettings", {"min_hitz": 1}, "min_hitz\n.*[Uu]nexpected keyword argument"),
]


@pytest.mark.parametrize(("name", "arguments", "lines"), OUT_OF_BOUNDS)
def test_settings_and_trackers_refuse_by_the_same_rule(name: str, arguments: dict[str, Any], lines: str) -> None:
    with pytest.raises(ValidationError, match=lines):
        PUBLIC[name](**arguments)


@pytest.mark.slow
def test_a_class_is_the_same_from_everywhere() -> None:
    """The package hands out what the modules define, and nothing changes by being named."""
    for name, public in PUBLIC.items():
        assert getattr(importlib.import_module(public.__module__), name) is public
    code = """
from tsuiseki.tracking.people.sort import Sort
from tsuiseki.tracking.types import Detections
def said():
    for wrong in (lambda: Sort(max_age="a"), lambda: Sort(nonsense=1), lambda: Sort(5), lambda: Detections([1], [1])):
        try:
            wrong()
        except Exception as error:
            yield type(error), str(error)
before = [*said()]
import tsuiseki
_ = [getattr(tsuiseki, name) for name in tsuiseki.__all__]
assert len(before) == 4 and before == [*said()], before
"""
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("name", sorted(kind.__name__ for kind in SETTINGS))
def test_settings_are_frozen_and_have_defaults_within_their_bounds(name: str) -> None:
    kind = PUBLIC[name]
    assert is_dataclass(kind)
    assert kind.__dataclass_params__.frozen  # type: ignore[attr-defined]
    settings = kind()
    kind.__pydantic_validator__.validate_python({}, self_instance=kind())
    for field, value in vars(settings).items():
        assert kind(**{field: value}) == settings


def test_public_functions_and_what_they_give_go_to_other_processes() -> None:
    assert pickle.loads(pickle.dumps(tsuiseki.track_people)) is tsuiseki.track_people
    assert pickle.loads(pickle.dumps(TRACK)) == TRACK


def test_an_argument_that_there_is_not_is_a_type_error() -> None:
    with pytest.raises(TypeError, match="nonsense"):
        tsuiseki.track_single(IMAGES, BOXES[0], nonsense=1)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="nonsense"):
        tsuiseki.Detections(BOXES, np.ones(1), nonsense=1)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="min_hitz"):
        tsuiseki.Sort(min_hitz=1)  # type: ignore[call-arg]


def test_every_public_call_names_its_keywords() -> None:
    for name, public in PUBLIC.items():
        tracks = hasattr(public, "update") and hasattr(public, "tracks")
        if tracks or name.startswith(("track_", "follow_")):
            for parameter in inspect.signature(public).parameters.values():
                assert parameter.kind not in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL), name
                assert parameter.annotation is not parameter.empty, (name, parameter.name)


def test_numbers_of_numpy_are_numbers() -> None:
    tracker = tsuiseki.Sort(max_age=np.int64(3), min_hits=np.uint8(1), min_iou=np.float32(0.25))  # type: ignore[arg-type]
    assert type(tracker.settings.max_age) is int
    assert tracker.update(BOXES, time=np.float32(0)).ids.tolist() == [1]  # type: ignore[arg-type]
