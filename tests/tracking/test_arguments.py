"""Whatever is given to a public name, it works or is a RequestError; a wrong type is always one."""

from __future__ import annotations

import inspect
import pickle
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest

import tsuiseki
from tsuiseki.tracking.arguments import fits

NAN, NOTHING = float("nan"), object()
VALUES = (NOTHING, "a", -1, NAN, None)
IMAGES = [np.full((48, 64, 3), 90 + 4 * n, np.uint8) for n in range(3)]
BOXES = np.array([[4.0, 4, 14, 24]])
FOUND = [np.column_stack([BOXES + n, [[0.9]]]) for n in range(3)]
TRACK = tsuiseki.Track(1, np.arange(3), BOXES + np.arange(3)[:, None], np.ones(3))
SCANS = [tsuiseki.Scan(float(n), np.array([[n, 2.0 * n]])) for n in range(3)]
MODEL = {"sensor": {"kind": "position"}, "region": [[0, 10], [0, 10]]}
PEOPLE = {"source": IMAGES, "detections": FOUND, "appearance": "none", "affinity": "none"}
BLOBS, BODIES = {"source": IMAGES, "colour": "red"}, {"source": IMAGES, "body": "goldfish"}
SINGLE, PLACES = {"source": IMAGES, "box": BOXES[0], "method": "kcf"}, {"measured": [BOXES[:, :2]], "extent": (64, 48)}


def good(folder: Path) -> dict[str, dict[str, Any]]:
    """Arguments of each public function with which it works, or ends at a file that is not there."""
    missing, out = folder / "missing", folder / "out"
    return {
        "as_detections": {"detections": FOUND[0]},
        "batch": {"command": "track people", "sources": missing, "out": out},
        "calibrate_people": {"sources": [missing, missing]},
        "check_cameras": {"given": [], "found": NOTHING},
        "convert": {"result": missing, "to": "cvat", "out": out},
        "count": {"result": [TRACK], "scene": tsuiseki.Scene(), "frame_rate": 10.0},
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
        "read_scene": {"path": missing},
        "read_tracks": {"path": missing},
        "shipped": {"name": "detector_street"},
        "track_animals": {"source": IMAGES},
        "track_blobs": BLOBS,
        "track_deformable": BODIES,
        "track_drone": {"source": IMAGES, "method": "flow", "detections": FOUND, "appearance": "none"},
        "track_fisheye": {"source": IMAGES, "cameras": missing},
        "track_floor": {"sources": [IMAGES], "cameras": missing},
        "track_measurements": {"measured": SCANS, "model": MODEL},
        "track_people": PEOPLE,
        "track_points": PLACES,
        "track_single": SINGLE,
        "track_sphere": {"sources": [IMAGES, IMAGES], "cameras": missing, "radius": 0.1},
        "track_sphere_points": {"files": [missing], "cameras": missing},
        "write_tracks": {"path": folder / "tracks.txt", "tracks": [TRACK]},
        "Appearance": {"path": tsuiseki.shipped("appearance_people")},
        "Counter": {"scene": tsuiseki.Scene()},
        "Detector": {"path": tsuiseki.shipped("detector_street")},
        "PointTracker": {"settings": tsuiseki.PointSettings(), "extent": (64, 48)},
        "Detections": {"boxes": BOXES, "scores": np.ones(1)},
        "Estimate": {"frame": 0, "box": BOXES[0], "score": 1.0, "status": "tracking"},
        "Frame": {"index": 0, "time": 0.0, "image": IMAGES[0]},
        "Scan": {"time": 0.0, "measurements": np.zeros((1, 2))},
        "Track": {"id": 1, "frames": np.arange(1), "boxes": BOXES, "scores": np.ones(1)},
    }


# Made by the toolkit alone.
RESULTS = {"ActingTrack", "Answers", "BodyTrack", "GroundTruth", "Position", "Result", "SensedTargets", "SensedTrack"}
RESULTS |= {
    "Linked",
    "PeopleCalibration",
    "PersonOnFloor",
    "SensingModel",
    "Target",
    "Targets",
    "RequestError",
    "RunError",
}


def parameters(function: Callable[..., Any]) -> Iterator[tuple[str, Any]]:
    """Names of the arguments and their types, those of a `TypedDict` of keywords among them."""
    kinds = get_type_hints(function if inspect.isroutine(function) else function.__init__)
    for name, parameter in inspect.signature(function).parameters.items():
        if parameter.kind is parameter.VAR_KEYWORD:
            yield from (get_type_hints(*inner).items() if (inner := get_args(kinds.get(name))) else ())
        elif name != "self":
            yield name, kinds[name]


def used(made: object) -> None:
    """What comes while it is asked for only, comes."""
    if isinstance(made, Iterator):
        next(made, None)


def tried(wrong: list[str], name: str, function: Callable[..., Any], known: dict[str, Any]) -> None:
    """Give ``function`` each wrong value for each argument; what is neither right nor refused goes into ``wrong``."""
    for argument, kind in parameters(function):
        for value in VALUES:
            try:
                used(function(**{**known, argument: value}))
                if value is NOTHING or not fits(value, kind):
                    wrong.append(f"{name}({argument}={value!r}) is taken")
            except (tsuiseki.RequestError, tsuiseki.RunError):
                continue
            except Exception as error:
                wrong.append(f"{name}({argument}={value!r}): {type(error).__name__}: {error}")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_every_argument_of_every_public_name_works_or_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    known, wrong = good(tmp_path), list[str]()
    for name in sorted({*tsuiseki.__all__} - RESULTS - {"__version__"}):
        tried(wrong, name, getattr(tsuiseki, name), known.get(name, {}))
    assert not wrong, "\n".join(wrong)


@pytest.mark.filterwarnings("ignore")
def test_every_argument_of_every_method_works_or_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result, found = tsuiseki.Result([TRACK], frame_rate=10.0, size=(64, 48)), tsuiseki.as_detections(FOUND[0])
    known: dict[Any, dict[str, dict[str, Any]]] = {
        result: {
            "at": {"frame": 0},
            "draw": {"image": IMAGES[0], "frame": 0},
            "overlay": {"path": tmp_path / "o.webm", "source": IMAGES, "overwrite": True},
            "save": {"path": tmp_path / "tracks.csv", "overwrite": True},
            "load": {"path": tmp_path / "missing"},
        },
        tsuiseki.Detector(tsuiseki.shipped("detector_street")): {"detect": {"images": IMAGES}},
        tsuiseki.Appearance(tsuiseki.shipped("appearance_people")): {"describe": {"image": IMAGES[0], "boxes": BOXES}},
        tsuiseki.Sort(): {"update": {"detections": found}},
        tsuiseki.FlowTracker(): {"update": {"detections": found}},
    }
    wrong: list[str] = []
    for made, methods in known.items():
        for name, arguments in methods.items():
            tried(wrong, f"{type(made).__name__}.{name}", getattr(made, name), arguments)
    assert not wrong, "\n".join(wrong)


NAMED = [
    ("track_single", {**SINGLE, "seed": "a"}, "`seed`: expected a whole number, got 'a'"),
    ("track_single", {**SINGLE, "method": "zz"}, "`method`: expected one of 'combined', "),
    ("track_people", {**PEOPLE, "frame_rate": 1e-320}, "`frame_rate`: expected 0 or a number from 1e-09"),
    ("track_people", {**PEOPLE, "nonsense": 1}, "expected the keywords detections, .*, got 'nonsense'"),
    ("track_drone", {"source": IMAGES, "threads": -1}, "`threads`: expected a whole number from 0, got -1"),
    ("track_points", {**PLACES, "extent": (64, "a")}, "`extent`: expected 2 numbers, got .64, 'a'."),
    ("BlobSettings", {"particles": "a"}, "`particles`: expected a whole number, got 'a'"),
    (
        "track_blobs",
        {**BLOBS, "settings": tsuiseki.BlobSettings(particles=10**9)},
        "`settings.particles`: expected a n",
    ),
    ("FlowTracker", {"settings": tsuiseki.FlowSettings(fill=1e300)}, "`settings.fill`: expected a number below"),
    ("track_measurements", {"measured": SCANS, "model": MODEL, "particles": 10**9}, "`particles`: expected a number b"),
    ("evaluate_people", {"truth": [1], "tracks": [TRACK]}, "`truth`: expected a path or GroundTruth or "),
    ("link", {"results": np.zeros(3)}, "`results`: expected .*, got ndarray"),
    ("calibrate_people", {"sources": np.zeros(3)}, "`sources`: expected .*, got ndarray"),
    ("evaluate_target", {"truth": BOXES, "target": len}, "`target`: expected .*, got builtin_function_or_method"),
    ("Detections", {"boxes": np.zeros((2, 3)), "scores": np.zeros(2)}, r"expected boxes of shape \(N, 4\), got"),
]


@pytest.mark.parametrize(("name", "given", "said"), NAMED)
def test_a_refusal_names_the_argument_and_says_what_came(name: str, given: dict[str, Any], said: str) -> None:
    with pytest.raises(tsuiseki.RequestError, match=said):
        getattr(tsuiseki, name)(**given)


def test_public_functions_and_what_they_give_go_to_other_processes() -> None:
    assert pickle.loads(pickle.dumps(tsuiseki.track_people)) is tsuiseki.track_people
    assert pickle.loads(pickle.dumps(TRACK)) == TRACK


def test_an_argument_that_there_is_not_is_a_type_error() -> None:
    with pytest.raises(TypeError):
        tsuiseki.track_single(IMAGES, BOXES[0], nonsense=1)  # type: ignore[call-arg]
    with pytest.raises(TypeError):
        tsuiseki.Detections(BOXES, np.ones(1), nonsense=1)  # type: ignore[call-arg]


def test_numbers_and_lists_of_numpy_are_numbers_and_lists() -> None:
    assert fits(np.float32(1), float)
    assert fits(np.int16(1), int)
    assert fits(np.bool_(True), bool)
    assert not fits(True, int)
    assert not fits(np.float64("nan"), float | None)
    assert fits(np.zeros(4), Sequence[float] | None)
    tracker = tsuiseki.Sort(max_age=np.int64(3), min_hits=np.uint8(1), min_iou=np.float32(0.25))
    assert type(tracker.settings.lifecycle.max_age) is int
    assert tracker.update(BOXES, time=np.float32(0)).ids.tolist() == [1]
