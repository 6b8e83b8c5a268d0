"""`track_drone` in one call; the command is tested beside it, in `cli/test_track_drone.py`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tsuiseki import track_drone
from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.datamodules.scenes.drone_clip import DroneClip, DroneSceneSettings
from tsuiseki.tracking.drone.drone_models import DroneModels
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.view_choice import ViewedDetector
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.people.settings import FindingOptions
from tsuiseki.tracking.video.source import open_source
from tsuiseki.tracking.weights import shipped


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight") / "clip"
    write_clip(folder, DroneClip(DroneSceneSettings(frames=8, width=320, height=240, people=3), 3))
    return folder


def labelled(flight: Path) -> list[np.ndarray]:
    truth = read_ground_truth(flight / "gt" / "gt.txt")
    return [truth.boxes[truth.evaluated & (truth.frames == frame)] for frame in range(8)]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["flow", "flow-saf", "flow-maf"])
def test_people_and_what_they_do(flight: Path, method: Any) -> None:
    found = track_drone(flight, method, detections=labelled(flight), threads=1)
    assert len(found) >= 2
    assert len(found.tracks) == len(list(found))
    for person in found:
        if method == "flow":
            assert person.multi is None
        else:
            assert person.multi is not None
            assert person.multi.shape == (len(person.track), len(found.names))
            assert (person.multi >= 0).all()
            assert (person.multi <= 1).all()


def test_a_detector_and_an_appearance_are_functions(flight: Path) -> None:
    given = iter(labelled(flight))
    found = track_drone(
        flight,
        "flow",
        detector=lambda _: next(given),
        appearance=lambda crops: [crop.mean(axis=(0, 1)) for crop in crops],
        frames="1-8",
    )
    assert len(found) >= 2


def test_a_bare_word_names_a_shipped_detector(flight: Path) -> None:
    """The one of drones is the default, so that what is kept of one serves the other."""
    source = open_source(flight)
    named, default = (
        DroneModels.choose(source, "flow", FindingOptions(detector=given, threads=1, view="auto"), "none")
        for given in ("drone_larger", None)
    )
    assert named.keys == default.keys
    detect = default.observers.detect
    assert isinstance(detect, ViewedDetector)
    assert not detect.enlarge
    other = DroneModels.choose(source, "flow", FindingOptions(detector="street", threads=1), "none")
    assert other.keys[0]["detector"] != default.keys[0]["detector"]
    with pytest.raises(RequestError, match="of the shipped ceiling, drone, "):
        DroneModels.choose(source, "flow", FindingOptions(detector="drones", threads=1), "none")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "sort"}, "`method`: expected flow, flow-saf or flow-maf, got 'sort'"),
        ({"detections": [], "detector": "x.onnx"}, "expected `detections` or `detector`, got both"),
        ({"actions": ["nowhere.onnx"]}, "nowhere.onnx"),
        ({"detector": lambda _: None}, "what the detector <lambda> returned"),
    ],
)
def test_what_cannot_be_says_so(flight: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(RequestError, match=message):
        track_drone(flight, **options)


def test_costs_learnt_on_pairs_are_refused_with_what_to_do(flight: Path) -> None:
    trees = shipped("affinity_printed_drone")
    with pytest.raises(RequestError, match=r"on pairs; use `preset` printed, or learn them by train association"):
        track_drone(flight, "flow", detections=labelled(flight), affinity=trees, threads=1)
