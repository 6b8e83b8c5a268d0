"""People hidden in a video: where, through what, and what the file holds besides."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import tsuiseki
from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.counts import page
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.hiding.places import GREY, Places, paint, places_of
from tsuiseki.tracking.hiding.run import HideChoice, Hiding
from tsuiseki.tracking.report import overlay
from tsuiseki.tracking.report.pictures import Pictures
from tsuiseki.tracking.types import FloatArray, Frame, ImageArray, Track
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.video.source import open_source

SIZE, BOX = (200, 100), [80.0, 20.0, 100.0, 80.0]


def walker(frames: list[int], score: float = 1.0, step: float = 2.0, observed: list[bool] | None = None) -> Track:
    boxes = np.array(BOX) + np.outer(frames, [step, 0, step, 0])
    known = np.array(observed) if observed else np.empty(0, dtype=np.bool_)
    return Track(1, np.array(frames), boxes, np.full(len(frames), score), known)


def nobody(_: ImageArray) -> FloatArray:
    return np.empty((0, 5))


def places(track: Track, heads: bool = False, rate: float = 5.0) -> Places:
    return places_of(track, rate, SIZE, 100, heads)


def test_a_second_before_and_after_moves_on_as_the_track_does() -> None:
    found = places(walker([10, 11, 12, 13]))
    assert found.frames.tolist() == list(range(5, 19))
    assert found.bare[:, 0].tolist() == [80 + 2 * n for n in range(5, 19)]
    assert found.held.tolist() == [-1] * 5 + [0] * 4 + [1] * 5
    # Half a second away, a quarter of a height to each side.
    wider = (found.bare[:, 0] - found.boxes[:, 0])[[5, 4, 2]]
    assert np.allclose(np.diff(wider), [0.5 * 60 * 0.2, 0.5 * 60 * 0.4])
    assert found.boxes.min() >= 0
    assert (found.boxes.max(axis=0) <= [200, 100, 200, 100]).all()


def test_gaps_are_held_and_filled_boxes_are_wider() -> None:
    missing, filled = places(walker([10, 14])), places(walker([*range(10, 15)], observed=[True, *[False] * 3, True]))
    assert np.allclose(missing.boxes[5:10], filled.boxes[5:10])
    assert missing.held[5:10].tolist() == [0, 2, 2, 2, 0]
    width = np.diff(missing.boxes[:, [0, 2]])[5:10, 0]
    assert width.argmax() == 2
    assert np.allclose(width, width[::-1])


def test_doubt_widens() -> None:
    def width(track: Track) -> float:
        found = places(track)
        return float(np.diff(found.boxes[found.frames == 12, ::2])[0, 0])

    steady, sure = walker([*range(10, 15)]), width(walker([*range(10, 15)]))
    assert width(walker([*range(10, 15)], score=0.2)) > sure
    shaken = steady.boxes + np.outer([0, 0, 6, 0, 0], [1, 0, 1, 0])
    assert width(replace(steady, boxes=shaken)) > sure
    assert width(walker([*range(10, 15)], score=float("nan"))) == width(walker([*range(10, 15)], score=0))


def test_a_place_that_left_the_picture_is_none() -> None:
    found = places(walker([0, 1, 2, 3], step=30))
    assert found.frames.max() < 8
    assert (found.boxes[:, 2] > found.boxes[:, 0]).all()


def test_heads_are_the_upper_part() -> None:
    whole, heads = places(walker([1, 2, 3])), places(walker([1, 2, 3]), heads=True)
    assert np.array_equal(whole.boxes[:, :3], heads.boxes[:, :3])
    assert (heads.boxes[:, 3] < whole.boxes[:, 3]).all()


@pytest.mark.parametrize("heads", [False, True])
def test_painting_changes_the_inside_alone_and_keeps_no_detail(heads: bool) -> None:
    image = np.random.default_rng(0).integers(0, 256, (100, 200, 3)).astype(np.uint8)
    box = np.array([[10.4, 5.6, 49.5, 94.2]])
    inside = np.zeros((100, 200), dtype=np.bool_)
    inside[5:95, 10:50] = True
    for style in ("pixelated", "filled"):
        hidden = paint(image, box, style, heads)  # type: ignore[arg-type]
        assert np.array_equal(hidden[~inside], image[~inside])
        colours = np.unique(hidden[inside], axis=0)
        assert len(colours) == 1 if style == "filled" else len(colours) <= 8 * 4
    assert (hidden[inside] == GREY).all()


def head_of(box: FloatArray, size: tuple[int, int]) -> tuple[slice, slice]:
    """Rows and columns of a labelled head: the upper 1/6.5 of a box, its middle third; borders outwards."""
    x1, y1, x2, y2 = box
    third, high = (x2 - x1) / 6, (y2 - y1) / 6.5
    left, right = np.clip([np.floor((x1 + x2) / 2 - third), np.ceil((x1 + x2) / 2 + third)], 0, size[0]).astype(int)
    top, bottom = np.clip([np.floor(y1), np.ceil(y1 + high)], 0, size[1]).astype(int)
    return slice(top, bottom), slice(left, right)


def clear_heads(hiding: Hiding, labels: GroundTruth, size: tuple[int, int]) -> tuple[set[int], int]:
    """Frames in which a pixel of a labelled head is clear, and how many have a head."""
    clear, numbers = set[int](), np.unique(labels.frames[labels.evaluated])
    for frame in numbers.tolist():
        white = np.full((size[1], size[0], 3), 255, dtype=np.uint8)
        hidden = paint(white, hiding.places.boxes[hiding.places.at(frame)], "filled", hiding.heads)
        heads = [head_of(box, size) for box in labels.boxes[(labels.frames == frame) & labels.evaluated]]
        if any((hidden[head] == 255).any() for head in heads):
            clear.add(frame)
    return clear, len(numbers)


def tracks_of(labels: GroundTruth, every: int = 1) -> list[Track]:
    """The labels as tracks, of every ``every``-th frame."""
    rows = labels.evaluated & (labels.frames % every == 0)
    parts = [np.flatnonzero(rows & (labels.ids == identity)) for identity in np.unique(labels.ids[rows])]
    return [Track(int(labels.ids[p[0]]), labels.frames[p], labels.boxes[p], np.ones(len(p))) for p in parts]


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("street") / "clip"
    return write_clip(folder, StreetClip(StreetSettings(frames=20, width=320, height=240, people=6), 41))


@pytest.mark.slow
@pytest.mark.parametrize("hide", ["people", "heads"])
@pytest.mark.parametrize("every", [1, 5])
def test_no_labelled_head_is_clear_with_given_boxes(hide: str, every: int, street: Path, tmp_path: Path) -> None:
    labels = read_ground_truth(street / "gt" / "gt.txt")
    hiding = tsuiseki.hide(street, tracks_of(labels, every), tmp_path / "o.webm", hide=hide, detector=nobody)
    clear, count = clear_heads(hiding, labels, (320, 240))
    assert (clear, count) == (set(), 20)


def test_people_nobody_tracked_are_hidden_and_listed(street: Path, tmp_path: Path) -> None:
    box = [30.0, 20.0, 60.0, 110.0]

    def sometimes(_: ImageArray) -> FloatArray:
        seen.append(1)
        return np.array([[*box, 0.4]]) if len(seen) in (8, 9, 10, 14) else np.empty((0, 5))

    seen: list[int] = []
    out = tmp_path / "o.webm"
    hiding = tsuiseki.hide(street, [], out, detector=sometimes, style="filled", threads=1)
    assert set(hiding.places.frames) == set(range(20))
    assert set(hiding.places.ids) == {0}
    pictures = [frame.image for frame in open_source(out).frames()]
    assert all(np.abs(picture[25:105, 35:55].astype(int) - GREY).max() < 8 for picture in pictures)
    rows = list(csv.DictReader((tmp_path / "o.doubtful.csv").read_text().splitlines()))
    assert {int(row["frame"]) for row in rows} == set(range(1, 21)) - {8, 9, 10, 14}
    assert {(row["id"], row["why"]) for row in rows if int(row["frame"]) == 12} == {("", "in a gap of the track")}
    assert rows[0]["time"] == "0.000"


def still(identity: int, left: float) -> Track:
    boxes = np.tile([left, 50.0, left + 30, 120.0], (20, 1))
    return Track(identity, np.arange(20), boxes, np.ones(20))


def test_all_but_some_stay_as_they_are(street: Path, tmp_path: Path) -> None:
    tracks = [still(3, 40), still(4, 200)]

    def both(_: ImageArray) -> FloatArray:
        return np.array([[41, 50, 70, 121, 0.9], [201, 50, 230, 121, 0.9]])

    hiding = tsuiseki.hide(street, tracks, tmp_path / "o.webm", hide="all-but 3", detector=both)
    assert hiding.places.boxes[:, 0].min() > 150
    assert set(hiding.places.ids) == {0, 4}


# EBML: the elements that hold others, and all that may stand in them.
CONTAINERS = {"18538067", "1549a966", "1654ae6b", "ae", "1254c367", "7373", "67c8", "63c0"}
ALLOWED = CONTAINERS | {
    "1a45dfa3", "114d9b74", "ec", "1f43b675", "1c53bb6b",  # header, list of contents, void, pictures, index
    "2ad7b1", "4d80", "5741", "4489",  # unit of time, the writer's names, duration
    "d7", "73c5", "88", "9c", "22b59c", "86", "83", "23e383", "e0", "55b0", "55ee",  # the track: numbers, codec, size
    "63c5", "45a3", "4487",  # tags: of which track, name, text
}  # fmt: skip


def elements(data: bytes) -> list[tuple[str, bytes]]:
    """All elements of a WebM file but those within pictures, depth first."""
    found, at = [], 0
    while at < len(data):
        length = 9 - data[at].bit_length()
        name, at = data[at : at + length].hex(), at + length
        length = 9 - data[at].bit_length()
        size = int.from_bytes(data[at : at + length], "big") & ((1 << 7 * length) - 1)
        inside, at = data[at + length : at + length + size], at + length + size
        found += [(name, inside), *(elements(inside) if name in CONTAINERS else [])]
    return found


def test_the_file_holds_pictures_and_nothing_else_of_the_original(inputs: Any, tmp_path: Path) -> None:
    folder = tmp_path / "Main Street 5"
    (folder / "img1").mkdir(parents=True)
    for frame in open_source(inputs.video).frames():
        cv2.imwrite(str(folder / "img1" / f"{frame.index + 1:06d}.png"), frame.image[..., ::-1])
    info = (
        "[Sequence]\nname=Main Street 5\nimDir=img1\nframeRate=10\nseqLength=12\nimWidth=64\nimHeight=48\nimExt=.png\n"
    )
    (folder / "seqinfo.ini").write_text(info)
    files = [tmp_path / "a.webm", tmp_path / "b.webm"]
    for video, out in zip((folder, inputs.video), files, strict=True):
        tsuiseki.hide(video, [], out, detector=lambda _: np.array([[8, 8, 24, 40, 0.9]]))
    assert files[0].read_bytes() == files[1].read_bytes()
    found = elements(files[0].read_bytes())
    assert {name for name, _ in found} <= ALLOWED
    assert [inside for name, inside in found if name == "83"] == [b"\1"], "one track, of pictures"
    assert {inside.rstrip(b"\0") for name, inside in found if name == "45a3"} <= {b"ENCODER", b"DURATION"}


@pytest.fixture
def result(inputs: Any, tmp_path: Path) -> Path:
    assert main([*inputs.words(inputs.images), "--out", str(tmp_path / "r")]) == 0
    return tmp_path / "r"


@pytest.mark.slow
def test_the_command_hides_and_counts_doubtful_frames(
    inputs: Any, result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [
        "hide",
        str(result),
        str(inputs.images),
        "--detector",
        str(inputs.detector),
        "--out",
        str(tmp_path / "o.webm"),
    ]
    assert main(words) == 0
    doubts = tmp_path / "o.doubtful.csv"
    assert (
        f"0 of 12 frames are doubtful: a place is held there without a detection ({doubts})" in capsys.readouterr().out
    )
    assert doubts.read_text() == "frame,time,id,why,x1,y1,x2,y2\n"
    assert len(list(open_source(tmp_path / "o.webm").frames())) == 12


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--hide=all-but=7,1"], "--hide: expected ids of the result (1), got 7"),
        (["--hide", "faces"], "--hide: expected people, heads or all-but with ids, such as all-but=3,5, got 'faces'"),
        (["--hide", "all-but"], "--hide: expected people, heads or all-but with ids, such as all-but=3,5, got"),
        (["--out", "{folder}/o.avi"], "--out: expected a name that ends in .webm or .mp4, got {folder}/o.avi"),
        (["--out", "/proc/o.webm"], "cannot write to /proc: "),
        (["--score-threshold", "7"], "--score-threshold: expected a number less than or equal to 1, got 7"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(
    words: list[str], line: str, inputs: Any, result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = [] if "--out" in words else ["--out", str(tmp_path / "o.webm")]
    given = [word.format(folder=tmp_path) for word in words]
    capsys.readouterr()
    status = main(["hide", str(result), str(inputs.images), "--detector", str(inputs.detector), *given, *out])
    error = capsys.readouterr().err.splitlines()[-1]
    assert status == 2
    assert error.startswith(f"tsuiseki: {line.format(folder=tmp_path)}")
    assert not (tmp_path / "o.webm").exists()


def longer_video(images: Path, folder: Path) -> Path:
    for number in range(1, 20):
        cv2.imwrite(str(folder / f"{number:06d}.png"), cv2.imread(str(images / "000001.png")))
    return folder


def shorter_video(images: Path, folder: Path) -> Path:
    for number in range(1, 5):
        cv2.imwrite(str(folder / f"{number:06d}.png"), cv2.imread(str(images / "000001.png")))
    return folder


@pytest.mark.parametrize("other", [longer_video, shorter_video])
def test_a_result_of_another_video_is_refused(
    other: Callable[[Path, Path], Path], inputs: Any, result: Path, tmp_path: Path
) -> None:
    (tmp_path / "other").mkdir()
    video = other(inputs.images, tmp_path / "other")
    with pytest.raises(RequestError, match="expected the video of the result, which has 12 frames, got"):
        tsuiseki.hide(video, result, tmp_path / "o.webm", detector=nobody)
    assert not (tmp_path / "o.webm").exists()


def test_a_result_of_other_pictures_is_refused(inputs: Any, tmp_path: Path) -> None:
    tracked = tsuiseki.track_people(inputs.images, "sort", detector=str(inputs.detector))
    with pytest.raises(RequestError, match="expected frames of 640x480 pixels as in the result, got 64x48"):
        tsuiseki.hide(inputs.images, replace(tracked, size=(640, 480)), tmp_path / "o.webm", detector=nobody)


def test_ids_that_no_track_has_are_refused_before_the_second_look(inputs: Any, result: Path, tmp_path: Path) -> None:
    def look(_: object) -> Any:
        raise AssertionError("nobody is to look")

    with pytest.raises(RequestError, match=r"expected ids of the result \(1\), got 7"):
        tsuiseki.hide(inputs.images, result, tmp_path / "o.webm", hide="all-but 7", detector=look)
    assert not (tmp_path / "o.webm").exists()


def test_the_video_itself_is_never_replaced(inputs: Any) -> None:
    before = inputs.video.read_bytes()
    with pytest.raises(RequestError, match="expected another file than the video"):
        tsuiseki.hide(inputs.video, [], inputs.video, overwrite=True)
    assert inputs.video.read_bytes() == before


@pytest.mark.parametrize("text", ["", "all-but 1,,2", "all-but -1", "people,heads", "all-but x"])
def test_what_is_hidden_is_named_well(text: str) -> None:
    with pytest.raises(RequestError, match="expected people, heads or all-but"):
        HideChoice.parse(text)


def test_an_overlay_hides_before_it_draws(inputs: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--overlay", "--hide", "people", "--out", str(tmp_path / "o")]
    assert main([*inputs.words(inputs.images), *words]) == 0
    assert (tmp_path / "o" / "doubtful.csv").read_text().startswith("frame,time,id,why,x1,y1,x2,y2\n")
    assert "of 12 frames are doubtful" in capsys.readouterr().out
    assert len(list(open_source(tmp_path / "o" / "overlay.webm").frames())) == 12


def noise_in(folder: Path) -> Path:
    rng, noise = np.random.default_rng(0), folder / "noise"
    noise.mkdir()
    for number in range(1, 7):
        cv2.imwrite(str(noise / f"{number:06d}.png"), rng.integers(0, 256, (48, 64, 3)).astype(np.uint8))
    return noise


def test_an_overlay_is_drawn_on_hidden_frames(inputs: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[ImageArray] = []

    def note(_: Path, frames: Iterable[Frame], *_more: object) -> None:
        drawn.extend(frame.image for frame in frames)

    monkeypatch.setattr(overlay, "write_drawn", note)
    main([*inputs.words(noise_in(tmp_path)), "--overlay", "--hide", "people", "--out", str(tmp_path / "o")])
    # The detector's person is at 8, 8 to 24, 40: blocks of 8 pixels.
    assert [len(np.unique(image[8:40, 8:24].reshape(-1, 3), axis=0)) <= 40 for image in drawn] == [True] * 6


@pytest.mark.slow
@pytest.mark.parametrize(("hide", "clear"), [("people", False), ("heads", False), ("all-but=1", True)])
def test_the_report_shows_hidden_pictures(
    inputs: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, hide: str, clear: bool
) -> None:
    shown: list[ImageArray] = []

    def note(frames: Iterable[Frame], _: object) -> Pictures:
        shown.extend(frame.image for frame in frames)
        return Pictures()

    monkeypatch.setattr(page, "pictures_of", note)
    assert main([*inputs.words(noise_in(tmp_path)), "--hide", *hide.split(), "--out", str(tmp_path / "o")]) == 0
    assert [len(np.unique(image[8:16, 8:24].reshape(-1, 3), axis=0)) > 40 for image in shown] == [clear] * len(shown)
    assert len(shown) >= 3
    # Who counts later looks at the video itself, and nothing hides there.
    shown.clear()
    (tmp_path / "s.yaml").write_text("lines:\n- {name: door, from: [0, 24], to: [64, 24]}\n")
    assert main(["count", str(tmp_path / "o"), "--scene", str(tmp_path / "s.yaml"), "--out", str(tmp_path / "c")]) == 0
    assert shown == []


@pytest.mark.slow
def test_heads_are_hidden_in_a_street_that_is_filmed(data_folder: Path, tmp_path: Path) -> None:
    video = data_folder / "mot" / "PETS09-S2L1-first"
    labels = read_ground_truth(video / "gt" / "gt.txt")
    tracked = tsuiseki.track_people(video, "sort", frames="201-260")
    hiding = tsuiseki.hide(video, tracked, tmp_path / "o.webm", hide="heads")
    rows = np.flatnonzero((labels.frames >= 200) & (labels.frames < 260))
    clear, count = clear_heads(hiding, labels.select(rows), (480, 360))
    assert (clear, count) == (set(), 60)


def test_nobody_to_hide_is_said(tmp_path: Path) -> None:
    nobody = Hiding(Places.joined([]), np.zeros(0, bool), False, "pixelated", 0, [0.0, 0.1])
    assert nobody.summary(tmp_path).startswith("nothing is hidden")
