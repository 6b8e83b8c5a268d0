"""A result is a sequence of tracks that writes itself."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.mot import read_tracks, write_tracks
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import Position, Targets, Track
from tsuiseki.tracking.types.measurements import SensedTrack
from tsuiseki.tracking.types.tracks import ActingTrack, BodyTrack, FloorTrack
from tsuiseki.tracking.video.source import open_source
from tsuiseki.tracking.video.webm import VideoWriter


def track(number: int) -> Track:
    frames = np.arange(3)
    boxes = np.tile([1.0, 2.0, 11.0, 22.0], (3, 1)) + number
    return Track(number, frames, boxes, np.full(3, 0.5), np.ones(3, dtype=np.bool_))


@pytest.fixture
def result() -> Result[Track]:
    tracks = [track(3), track(8)]
    return Result(
        tracks,
        source="street",
        frame_rate=25.0,
        settings={"seed": 4},
        facts={"camera": "stands still"},
        frames={"frame": [0, 1, 2]},
        files={
            "tracks.txt": lambda path, _: write_tracks(path, tracks),
            "page.html": lambda path, folder: path.write_text(str(sorted(p.name for p in folder.glob("*.txt")))),
        },
    )


def test_a_result_is_a_sequence_of_tracks(result: Result[Track]) -> None:
    assert [one.id for one in result] == [3, 8]
    assert (len(result), result[1].id, [one.id for one in result[:1]]) == (2, 8, [3])
    assert result.by_id[8] is result[1]
    assert repr(result) == "<Result: 2 tracks in street>"


def test_it_writes_its_files_and_the_record(result: Result[Track], tmp_path: Path) -> None:
    folder = result.save(tmp_path / "out")
    assert [one.id for one in read_tracks(folder / "tracks.txt")] == [3, 8]
    assert (folder / "page.html").read_text() == "['tracks.txt']"
    record = json.loads((folder / "run.json").read_text())
    assert record["seed"] == 4
    assert record["facts"] == {"camera": "stands still"}
    assert record["files"] == ["page.html", "tracks.txt"]


def test_an_earlier_result_stays_unless_it_is_asked_for(result: Result[Track], tmp_path: Path) -> None:
    result.save(tmp_path / "out")
    with pytest.raises(RequestError, match="already holds"):
        result.save(tmp_path / "out")
    result.save(tmp_path / "out", overwrite=True)


def boxes(number: int) -> Track:
    frames = np.array([2, 3, 6]) + number
    corners = np.array([[1.25, 2, 11, 22], [2, 2, 12, 22.5], [3, 2, 13, 22]]) + number
    return Track(number, frames, corners, np.array([0.5, 0.25, 1]), np.array([True, False, True]))


def sensed(number: int) -> SensedTrack:
    rows = np.arange(4.0).reshape(2, 2) + number
    covariances = np.stack([np.eye(4) + 0.25, 2 * np.eye(4)])
    scans = np.array([number, number + 2])
    return SensedTrack(number, scans, scans / 10, rows, rows / 2, covariances, np.array([0.5, 1]), rows / 8)


def position(number: int) -> Position:
    covariance = np.eye(3) + 0.5
    place = np.array([1.0, 2, number])
    return Position(number / 10, place, covariance, 0.75, "searching", place / 4, np.array([0.5, 1]))


def body(number: int) -> BodyTrack:
    states = np.arange(6.0).reshape(2, 3)
    return BodyTrack(number, np.array([4, 5]), states, np.array([1, 0.5]), ("tracking", "lost"))


PROBABILITIES = np.array([[0.5, 0.25], [0, 1], [0.75, 0.125]])
KINDS: dict[str, tuple[list[Any], tuple[str, ...]]] = {
    "boxes": ([boxes(1), boxes(4)], ()),
    "nobody": ([], ()),
    "acting": ([ActingTrack(boxes(k), PROBABILITIES, PROBABILITIES[::-1]) for k in (1, 4)], ("run", "walk/stand")),
    "floor": ([FloorTrack(boxes(k), np.full((3, 5), 0.5 + k), np.full((3, 2), 2.5)) for k in (1, 4)], ()),
    "bodies": ([body(1), body(2)], ("a", "b", "theta")),
    "sensed": ([sensed(1), sensed(3)], ()),
    "ball": ([position(0), position(1)], ()),
}


def plain(value: Any) -> Any:
    """Whatever a track is made of, as what can be compared."""
    if hasattr(value, "__dataclass_fields__"):
        return type(value).__name__, [plain(getattr(value, one.name)) for one in fields(value)]
    return value.tolist() if isinstance(value, np.ndarray) else value


@pytest.mark.parametrize("kind", list(KINDS))
@pytest.mark.parametrize("name", ["a.csv", "a.json", "a.parquet", "folder"])
def test_what_is_saved_is_loaded(kind: str, name: str, tmp_path: Path) -> None:
    if name == "a.parquet":
        pytest.importorskip("pyarrow")
    tracks, names = KINDS[kind]
    facts = {"settings": {"seed": 3}, "facts": {"camera": "still"}, "frames": {"frame": [4, 5], "people": [1, 2]}}
    given: Result[Any] = Result(tracks, "street.mp4", 12.5, (64, 48), **facts, names=names)
    loaded: Result[Any] = Result.load(given.save(tmp_path / name))
    assert [plain(one) for one in loaded] == [plain(one) for one in tracks]
    if name != "a.csv":
        assert (loaded.source, loaded.frame_rate, loaded.size, loaded.names) == ("street.mp4", 12.5, (64, 48), names)
        assert {key: getattr(loaded, key) for key in facts} == facts
    assert "frames count from 0" in loaded._repr_html_()


def test_text_holds_boxes_only(tmp_path: Path) -> None:
    given = Result(KINDS["boxes"][0])
    loaded: Result[Track] = Result.load(given.save(tmp_path / "a.txt"))
    assert [plain(one)[1][:4] for one in loaded] == [plain(one)[1][:4] for one in given]
    with pytest.raises(RequestError, match=r"save as \.csv"):
        Result(KINDS["ball"][0]).save(tmp_path / "b.txt")
    with pytest.raises(RequestError, match="already exists"):
        given.save(tmp_path / "a.txt")
    with pytest.raises(RequestError, match=r"\.csv, \.json, \.parquet, \.txt, \.xml, \.slp, \.h5, got"):
        given.save(tmp_path / "a.xlsx")


def test_frames_in_files_count_from_1(tmp_path: Path) -> None:
    path = Result(KINDS["boxes"][0]).save(tmp_path / "a.csv")
    assert path.read_text().splitlines()[:2] == ["frame,id,x1,y1,x2,y2,score,observed", "4,1,2.25,3,12,23,0.5,1"]


@pytest.mark.parametrize(
    ("text", "name", "said"),
    [
        ("a,b\n1,2\n", "a.csv", "expected columns of tracks"),
        ("frame,id,x1,y1,x2,y2\n1,1,5,5,2,9\n", "a.csv", "expected rows of tracks"),
        ("frame,id,x1,y1,x2,y2\n1,1,5,b,7,9\n", "a.csv", "a.csv:2: expected a finite number in column y1"),
        ('{"a": 1}', "a.json", "expected COCO's JSON"),
        ("no", "a.xlsx", "expected the folder of a result"),
        ("no", "run.json", "run.json: expected JSON"),
        ("{}", "run.json", "expected a result, such as tracks.txt, found none"),
    ],
)
def test_what_is_no_result_is_said(text: str, name: str, said: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(RequestError, match=said):
        Result.load(tmp_path if name == "run.json" else tmp_path / name)
    with pytest.raises(RequestError, match="found no such file"):
        Result.load(tmp_path / "missing.csv")
    with pytest.raises(RequestError, match=r"found no .*missing$"):
        Result.load(tmp_path / "missing")


def test_one_of_several_results_is_loaded(result: Result[Track], tmp_path: Path) -> None:
    known = {name: result.video_record() | {"frame_rate": rate} for name, rate in (("a", 10.0), ("b", 20.0))}
    (tmp_path / "run.json").write_text(json.dumps({"settings": {"seed": 1}, "results": known}))
    for name in known:
        (tmp_path / name).mkdir()
        write_tracks(tmp_path / name / "tracks.txt", result)
    loaded: Result[Track] = Result.load(tmp_path / "b")
    assert ([one.id for one in loaded], loaded.frame_rate, loaded.settings) == ([3, 8], 20.0, {"seed": 1})
    with pytest.raises(RequestError, match="holds several results; load one of"):
        Result.load(tmp_path)


def test_a_partial_result_is_said(result: Result[Track], tmp_path: Path) -> None:
    folder = result.save(tmp_path / "out")
    record = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps(record | {"partial": True, "reason": "interrupted"}))
    with pytest.warns(InputWarning, match="is a partial result: interrupted"):
        Result.load(folder)


def test_what_is_in_a_frame() -> None:
    targets = Result(KINDS["acting"][0]).at(4)
    assert isinstance(targets, Targets)
    assert (targets.ids.tolist(), targets.status.tolist(), targets.scores.tolist()) == ([1], ["searching"], [0.0])
    assert len(Result([]).at(3)) == 0
    assert [plain(one)[1][1:] for one in Result(KINDS["bodies"][0]).at(5)] == [[[5], [[3, 4, 5]], [0.5], ("lost",)]] * 2
    assert [one.times.tolist() for one in Result(KINDS["sensed"][0]).at(3)] == [[0.3], [0.3]]
    assert Result(KINDS["ball"][0]).at(1) == KINDS["ball"][0][1:]


@pytest.mark.parametrize("ending", ["mp4", "webm"])
def test_an_overlay_is_drawn_on_the_video(ending: str, tmp_path: Path) -> None:
    with VideoWriter(tmp_path / "street.webm", 10) as writer:
        for _ in range(6):
            writer.write(np.full((48, 64, 3), 90, dtype=np.uint8))
    known = {"source": str(tmp_path / "street.webm"), "frame_rate": 10.0, "size": (64, 48)}
    given = Result([track(3)], frames={"frame": [1, 2, 3]}, **known)
    loaded: Result[Track] = Result.load(given.save(tmp_path / "out"))
    seen = list(open_source(loaded.overlay(tmp_path / f"drawn.{ending}")).frames())
    assert len(seen) == 3
    assert (np.abs(seen[1].image.astype(int) - 90).max(), np.abs(seen[2].image[:30].astype(int) - 90).max()) > (60, 20)
    image = np.full((48, 64, 3), 90, dtype=np.uint8)
    drawn = loaded.draw(image, 1)
    assert drawn.shape == image.shape
    assert (image == 90).all()
    assert (drawn != 90).any()
    with pytest.raises(RequestError, match="64x48 pixels, got shape"):
        loaded.draw(image[:20], 1)
    (second,) = [frame for frame in open_source(known["source"]).frames() if frame.index == 2]
    np.testing.assert_array_equal(loaded.draw(2), loaded.draw(second.image, 2))
    with pytest.raises(RequestError, match="expected frames within 1-6"):
        loaded.draw(40)
    with pytest.raises(RequestError, match="come from no video"):
        Result([track(3)]).draw(2)
    with pytest.raises(RequestError, match="already exists"):
        loaded.overlay(tmp_path / f"drawn.{ending}")
    with pytest.raises(RequestError, match=r"\.mp4 or \.webm"):
        loaded.overlay(tmp_path / "drawn.avi")
    with pytest.raises(RequestError, match="expected a `source`"):
        Result([track(3)]).overlay(tmp_path / "other.webm")


def test_only_the_run_draws_what_has_no_boxes() -> None:
    with pytest.raises(RequestError, match="only the run that made"):
        Result(KINDS["ball"][0]).draw(np.zeros((8, 8, 3), np.uint8), 4)


@pytest.mark.parametrize("name", ["a.csv", "folder"])
def test_loaded_bodies_are_drawn(name: str, tmp_path: Path) -> None:
    states = np.array([[40.0, 30, 0, 30, 12], [40.0, 30, 0, 30, 12]])
    fish = replace(body(1), states=states)
    names = ("a", "b", "theta", "length", "width")
    loaded: Result[Any] = Result.load(Result([fish], frame_rate=5.0, names=names).save(tmp_path / name))
    drawn = loaded.draw(np.zeros((60, 80, 3), np.uint8), 4)
    assert drawn[30, 40:54].any(axis=1).all()  # the arrow ahead
    assert drawn[34:38, 38:42].any()  # the ellipse
    arrow = Result([replace(fish, states=states[:, :3])], names=names[:3]).draw(np.zeros((60, 80, 3), np.uint8), 4)
    assert arrow[30, 40:54].any(axis=1).all()
    assert not arrow[34:38, 38:42].any()


@pytest.mark.parametrize(
    ("ask", "module"), [("to_dataframe", "pandas"), ("to_supervision", "supervision"), ("save", "pyarrow")]
)
def test_what_is_not_installed_is_said(ask: str, module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, module, None)
    with pytest.raises(RequestError, match=rf"needs {module}, which is not installed; give `pip install {module}`"):
        getattr(Result(KINDS["boxes"][0]), ask)(*([tmp_path / "a.parquet"] if ask == "save" else []))


def test_a_data_frame_has_the_times_of_the_source() -> None:
    pytest.importorskip("pandas")
    table = Result(KINDS["boxes"][0], frame_rate=10.0).to_dataframe()
    assert table.columns.tolist() == ["frame", "id", "x1", "y1", "x2", "y2", "score", "observed", "time"]
    assert table["time"].tolist() == [0.3, 0.4, 0.6, 0.7, 0.7, 1.0]
    uneven = {"frame": list(range(11)), "time": [n / 5 for n in range(11)]}
    assert Result(KINDS["boxes"][0], frame_rate=10.0, frames=uneven).to_dataframe()["time"][0] == pytest.approx(0.6)


def test_to_supervision_and_back() -> None:
    pytest.importorskip("supervision")
    given = Result(KINDS["boxes"][0], frames={"frame": list(range(14))})
    frames = given.to_supervision()
    assert [len(found) for found in frames] == [0, 0, 0, 1, 1, 0, 1, 2, 0, 0, 1, 0, 0, 0]
    again = Result.from_supervision(frames, frame_rate=25.0)
    assert [plain(one)[1][:4] for one in again] == [plain(one)[1][:4] for one in given]
    assert (again.frame_rate, again.frames["frame"]) == (25.0, list(range(14)))


class Found(SimpleNamespace):
    def __len__(self) -> int:
        return len(self.xyxy)


def test_from_what_looks_like_supervision() -> None:
    found = Found(xyxy=np.array([[1.0, 1, 5, 9]]), confidence=None, tracker_id=np.array([0]))
    (one,) = Result.from_supervision([Found(xyxy=np.empty((0, 4)), confidence=None, tracker_id=None), found])
    assert plain(one)[1][:5] == [1, [1], [[1, 1, 5, 9]], [1], [True]]
    with pytest.raises(RequestError, match="expected detections with tracker_id, got none in frame 0"):
        Result.from_supervision([Found(xyxy=found.xyxy, confidence=None, tracker_id=None)])


@pytest.mark.parametrize("ending", ["csv", "json"])
def test_classes_and_rows_of_detections_are_kept(tmp_path: Path, ending: str) -> None:
    origin, boxes = np.array([[3, 2], [-1, -1], [0, 7], [1, 2]]), np.tile([1.0, 2, 5, 9], (4, 1))
    car = Track(1, np.arange(4), boxes, np.ones(4), origin[:, 0] >= 0, origin, {2: "parking meter", 7: "truck"})
    Result([car]).save(tmp_path / f"tracks.{ending}")
    (again,) = Result.load(tmp_path / f"tracks.{ending}")
    assert again.origin.tolist() == origin.tolist()
    assert (again.class_id, again.class_name) == (2, "parking meter")
    assert Result([car]).at(2).origin.tolist() == [[0, 2]]


def test_classes_come_from_supervision() -> None:
    named = {"class_name": np.array(["car"])}
    one = Found(xyxy=np.array([[1.0, 1, 5, 9]]), confidence=None, tracker_id=np.array([4]), class_id=[2], data=named)
    (track,) = Result.from_supervision([one, one])
    assert (track.class_id, track.class_name) == (2, "car")
