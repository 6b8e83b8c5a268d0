"""`tsuiseki track drone` and `tsuiseki evaluate action`, from files to files."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.acting_tracks import read_acting_tracks
from tsuiseki.tracking.formats.mot import read_ground_truth, read_tracks, write_detections
from tsuiseki.tracking.types import Detections


@pytest.fixture(scope="module")
def clip(acting_clips: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The validation clip with the detections of somebody who sees all but every seventh box."""
    folder = tmp_path_factory.mktemp("clip") / "validation-0"
    shutil.copytree(acting_clips / "validation/validation-0", folder)
    truth = read_ground_truth(folder / "gt/gt.txt")
    kept = truth.select(np.arange(len(truth)) % 7 != 3)
    found = [kept.boxes[kept.frames == frame] for frame in range(22)]
    (folder / "det").mkdir()
    write_detections(folder / "det/det.txt", [Detections(b, np.full(len(b), 0.9)) for b in found])
    return folder


def words(clip: Path, streams: list[Path], out: Path, *more: str) -> list[str]:
    actions = ",".join(map(str, streams))
    given = ["--detections", str(clip / "det/det.txt"), "--appearance", "none", "--actions", actions]
    # Boxes that are all right, of people whose appearance nobody describes, are worth more than the shipped detector's.
    given += ["--drone.flow.input.detection.offset", "5"]
    return ["track", "drone", str(clip), "--out", str(out), "--threads", "1", *given, *more]


def values(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((out / "run.json").read_text())
    return found


@pytest.mark.slow
@pytest.mark.parametrize("method", ["flow", "flow-saf", "flow-maf"])
def test_people_are_followed_and_their_actions_named(
    clip: Path, action_streams: list[Path], tmp_path: Path, method: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(words(clip, action_streams, out, "--method", method)) == 0
    assert "5 people in 22 frames" in capsys.readouterr().out
    assert len(read_tracks(out / "tracks.txt")) == 5
    if method == "flow":
        with pytest.raises(RequestError, match="says nothing of actions"):
            read_acting_tracks(out / "tracks.json")
        return
    people, names = read_acting_tracks(out / "tracks.json")
    for person in people:
        assert person.multi is not None
        said = names[int(person.multi.mean(axis=0).argmax())]
        # Who sits stays in place; who runs comes furthest.
        way = person.track.boxes[-1, 0] - person.track.boxes[0, 0]
        assert said == ("Sitting" if way < 3 else "Walking" if way < 80 else "Running")


@pytest.mark.slow
def test_report_overlay_and_evaluation(
    clip: Path, action_streams: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(words(clip, action_streams, out, "--overlay")) == 0
    page = (out / "report.html").read_text()
    assert page.count("person ") >= 5
    assert re.search(r"Sitting, 0\.0 to \d+\.\d s", page)
    assert "data:video/webm" in page
    assert {"decode", "camera", "actions", "link"} <= values(out)["seconds"].keys()
    capsys.readouterr()
    scores = tmp_path / "scores.json"
    assert main(["evaluate", "action", str(clip), str(out), "--json", str(scores)]) == 0
    assert "Handshaking" in capsys.readouterr().out
    found = json.loads(scores.read_text())["out multi"]
    assert found["actions"]["Handshaking"]["f1"] is None
    assert found["actions"]["Sitting"]["average_precision"] > 0.95
    assert found["mean_f1"] > 0.9


@pytest.mark.slow
def test_given_tracks_keep_their_places_and_get_actions(clip: Path, action_streams: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    streams = ",".join(map(str, action_streams))
    truth = clip / "gt/gt.txt"
    assert main(["track", "drone", str(clip), "--out", str(out), "--tracks", str(truth), "--actions", streams]) == 0
    for given, found in zip(read_tracks(truth), read_tracks(out / "tracks.txt"), strict=True):
        np.testing.assert_array_equal(given.frames, found.frames)
        np.testing.assert_allclose(given.boxes, found.boxes, atol=0.01)
    # A stretch of it has the same people.
    part = tmp_path / "part"
    more = ["--frames", "8-15", "--tracks", str(truth), "--actions", streams]
    assert main(["track", "drone", str(clip), "--out", str(part), *more]) == 0
    assert [t.frames.tolist() for t in read_tracks(part / "tracks.txt")] == [list(range(7, 15))] * 5


def test_given_tracks_of_another_video_are_refused(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tracks = tmp_path / "tracks.txt"
    tracks.write_text("1,1,10,10,20,40,1\n23,1,10,10,20,40,1\n")
    assert main(["track", "drone", str(clip), "--out", str(tmp_path / "out"), "--tracks", str(tracks)]) == 2
    assert "tracks reach frame 23, but the video has 22 frames; are these the tracks of" in capsys.readouterr().err


@pytest.mark.slow
def test_okutama_labels_are_given_tracks_and_their_own_truth(
    acting_clips: Path, action_streams: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = acting_clips / "okutama/Drone1/Morning/Extracted-Frames-1280x720/1.1.1"
    labels = acting_clips / "okutama/Labels/SingleActionTrackingLabels/3840x2160/1.1.1.txt"
    given = ["--tracks", str(labels), "--actions", ",".join(map(str, action_streams))]
    out = tmp_path / "1.1.1"
    assert main(["track", "drone", str(frames), "--out", str(out), *given]) == 0
    for truth, more in ((labels, ["--size", "320,180"]), (acting_clips / "okutama", [])):
        file = ["--json", str(tmp_path / "scores.json"), "--overwrite", "--protocol", "published", *more]
        assert main(["evaluate", "action", str(truth), str(out), *file]) == 0
        found = json.loads((tmp_path / "scores.json").read_text())["1.1.1 multi"]
        # Frame 0 of 22 does not count; in frame 4 one of five people is hidden, whose box is a false alarm.
        assert found["rows"] == 21 * 5
        assert found["actions"]["Walking"]["rows"] == 21 * 2 - 1
        assert found["actions"]["Walking"]["recall"] == 1
        assert main(["evaluate", "people", str(truth), str(out), *file]) == 0
        combined = json.loads((tmp_path / "scores.json").read_text())["1.1.1"]["combined"]
        assert (combined["false_negatives"], combined["false_positives"], combined["id_switches"]) == (0, 1, 0)
    part = tmp_path / "part"
    shutil.copytree(frames, part / "frames")
    (part / "frames/21.jpg").unlink()
    capsys.readouterr()
    assert main(["track", "drone", str(part / "frames"), "--out", str(part / "out"), *given]) == 2
    error = capsys.readouterr().err
    assert "labels reach frame 21, but the video ends with frame 20; use the frames that come with the data" in error
    assert error.count("\n") == 1


@pytest.mark.slow
def test_the_cache_saves_looking_and_survives_damage(
    clip: Path, action_streams: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second, third = (tmp_path / name for name in ("first", "second", "third"))
    cache = tmp_path / "cache"
    assert main(words(clip, action_streams, first, "--cache", str(cache))) == 0
    (entry,) = cache.iterdir()
    assert main(words(clip, action_streams, second, "--cache", str(cache), "--drone.flow.min-time", "0.1")) == 0
    assert "actions" in values(first)["seconds"]
    assert values(second)["seconds"].keys() == {"link"}
    assert (second / "tracks.json").read_text() == (first / "tracks.json").read_text()
    content = bytearray(entry.read_bytes())
    content[len(content) // 2] ^= 255
    entry.write_bytes(content)
    capsys.readouterr()
    assert main(words(clip, action_streams, third, "--cache", str(cache))) == 0
    assert "no usable cache entry (its checksum is wrong); made anew" in capsys.readouterr().err
    assert (third / "tracks.json").read_text() == (first / "tracks.json").read_text()
    assert main(words(clip, action_streams, third, "--cache", str(cache), "--overwrite")) == 0
    assert "made anew" not in capsys.readouterr().err


@pytest.mark.slow
def test_tiles_are_looked_at_and_kept_apart(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from tsuiseki.tracking.features.exported import Detector

    looked: list[int] = []
    detect = Detector.detect
    monkeypatch.setattr(Detector, "detect", lambda self, images: looked.append(len(images)) or detect(self, images))
    common = ["track", "drone", str(clip), "--method", "flow", "--appearance", "none", "--frames", "1-4"]
    common += ["--threads", "1", "--cache", str(tmp_path / "cache")]
    for view, pictures in {"1": 4, "2x1": 3 + 12}.items():  # one frame more is looked at to say what the view costs
        assert main([*common, "--view", view, "--out", str(tmp_path / view)]) == 0
        assert sum(looked) == pictures
        looked.clear()
    assert len(list((tmp_path / "cache").iterdir())) == 2
    capsys.readouterr()
    assert main([*common, "--view", "many", "--out", str(tmp_path / "many")]) == 2
    assert "many" in capsys.readouterr().err


@pytest.mark.slow
def test_a_flow_without_actions_takes_what_is_kept_with_them(
    clip: Path, action_streams: list[Path], tmp_path: Path
) -> None:
    cache = ["--cache", str(tmp_path / "cache")]
    assert main(words(clip, action_streams, tmp_path / "maf", *cache)) == 0
    for name, more in (("kept", cache), ("fresh", [])):
        assert main(words(clip, action_streams, tmp_path / name, "--method", "flow", *more)) == 0
    assert values(tmp_path / "kept")["seconds"].keys() == {"link"}
    assert len(list((tmp_path / "cache").iterdir())) == 1
    assert (tmp_path / "kept/tracks.txt").read_text() == (tmp_path / "fresh/tracks.txt").read_text()


def test_bad_input(clip: Path, action_streams: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from importlib import resources

    weights = Path(str(resources.files("tsuiseki.tracking"))) / "weights"
    other = tmp_path / "other.onnx"
    cases = {
        "expected the actions of rgb.onnx": ["--actions", f"{action_streams[0]},{other}"],
        "expected one file a stream": ["--actions", f"{action_streams[0]},{action_streams[0]}"],
        "expected a model of kind 'action'": ["--actions", str(weights / "appearance_people.onnx")],
        "--threshold: expected a number less than or equal to 1": ["--threshold", "1.5"],
        "expected one of --detections, --detector and --tracks": ["--tracks", str(clip / "gt/gt.txt")],
        "--drone.window: expected a number greater than or equal to 0": ["--drone.window", "-1"],
    }
    save_other(other)
    for message, more in cases.items():
        assert main(words(clip, action_streams, tmp_path / "out", *more)) == 2, message
        error = capsys.readouterr().err
        assert message in error
        assert error.count("\n") == 1
        assert not (tmp_path / "out").exists()


def save_other(path: Path) -> None:
    """A stream with other actions."""
    import onnx

    from tsuiseki.tracking.features.action import ActionInput
    from tsuiseki.tracking.onnx import METADATA_KEY

    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("GlobalAveragePool", ["images"], ["probability"])],
        "other",
        [onnx.helper.make_tensor_value_info("images", onnx.TensorProto.FLOAT, ["n", 2, 16, 16])],
        [onnx.helper.make_tensor_value_info("probability", onnx.TensorProto.FLOAT, ["n", 2, 1, 1])],
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 18)], ir_version=9)
    onnx.helper.set_model_props(model, {METADATA_KEY: ActionInput("flow_local", 16).card("x", ("a", "b")).to_json()})
    onnx.save(model, path)


@pytest.mark.slow
def test_labels_with_other_actions_are_refused(
    clip: Path, action_streams: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(words(clip, action_streams, out)) == 0
    text = (out / "tracks.json").read_text()
    (out / "tracks.json").write_text(text.replace("Handshaking", "Juggling"))
    assert main(["evaluate", "action", str(clip), str(out)]) == 2
    assert "expected the actions of the labels, Handshaking" in capsys.readouterr().err
    (out / "tracks.json").write_text(text[:200])
    assert main(["evaluate", "action", str(clip), str(out)]) == 2
    assert "expected tracks.json of `tsuiseki track drone`" in capsys.readouterr().err
    (out / "tracks.json").unlink()
    assert main(["evaluate", "action", str(clip), str(out)]) == 2
    assert "found none" in capsys.readouterr().err


@pytest.mark.slow
def test_a_camera_that_stands_still_changes_nothing(data_folder: Path, tmp_path: Path) -> None:
    pets = data_folder / "mot/PETS09-S2L1-first"
    given = ["--detections", str(pets / "det/det.txt"), "--appearance", "none", "--method", "flow"]
    for name, more in (("taken", []), ("kept", ["--keep-camera-motion"])):
        words = ["track", "drone", str(pets), "--out", str(tmp_path / name), "--frames", "1-60", "--threads", "1"]
        assert main([*words, *given, *more]) == 0
    assert (tmp_path / "taken/tracks.txt").read_text() == (tmp_path / "kept/tracks.txt").read_text()
    assert len(read_tracks(tmp_path / "taken/tracks.txt")) >= 3
