"""Results of a video file: what it says of itself is recorded, and compared by all that takes the result."""

import json
import shutil

import numpy as np
import pytest
import yaml

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.counts.counting import count
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.hiding.run import hide
from tsuiseki.tracking.linking.run import link
from tsuiseki.tracking.people.api import track_people
from tsuiseki.tracking.result import Result, convert
from tsuiseki.tracking.review.reviewed import Reviewed
from tsuiseki.tracking.review.session import Session
from tsuiseki.tracking.video.source import absolute, file_of, open_source
from tsuiseki.tracking.video.webm import VideoWriter

SIZE, FRAMES, RATE = (160, 120), 24, 12.0


def write_video(path, size=SIZE, frames=FRAMES, rate=RATE, shade=60):
    with VideoWriter(path, rate) as writer:
        for number in range(frames):
            image = np.full((size[1], size[0], 3), shade, np.uint8)
            image[40:80, 10 + 4 * number : 26 + 4 * number] = 200
            writer.write(image)
    return path


@pytest.fixture(scope="module")
def tracked(tmp_path_factory):
    """A video file, and beside it the folder of its result: two people, who stay in the left upper part."""
    folder = tmp_path_factory.mktemp("files")
    video = write_video(folder / "clip.webm")
    found = [np.array([[10 + 4 * n, 40, 26 + 4 * n, 80, 0.9], [60, 10, 70, 34, 0.9]]) for n in range(FRAMES)]
    track_people(video, detections=found, appearance="none").save(folder / "result")
    return folder


@pytest.fixture
def place(tracked, tmp_path):
    """The same in a folder of its own."""
    for name in ("clip.webm",):
        shutil.copy2(tracked / name, tmp_path / name)
    shutil.copytree(tracked / "result", tmp_path / "result")
    record = json.loads((tmp_path / "result/run.json").read_text())
    record["results"]["."]["source"] = str(tmp_path / "clip.webm")
    (tmp_path / "result/run.json").write_text(json.dumps(record))
    return tmp_path


def recorded(folder):
    return json.loads((folder / "run.json").read_text())["results"]["."]


def test_what_a_video_file_says_of_itself_is_in_its_result(tracked):
    about, source = recorded(tracked / "result"), open_source(tracked / "clip.webm")
    assert about["size"] == [*SIZE]
    assert about["frame_rate"] == RATE
    assert about["length"] == FRAMES
    assert about["first_time"] == source.first_time
    assert about["fingerprint"] == source.fingerprint != ""
    loaded = Result.load(tracked / "result")
    assert loaded.size == SIZE
    assert (loaded.recording.length, loaded.recording.fingerprint) == (FRAMES, source.fingerprint)


@pytest.mark.parametrize("name", ["tracks.json", "again"])
def test_it_is_saved_with_the_tracks(tracked, tmp_path, name):
    loaded = Result.load(tracked / "result")
    again = Result.load(loaded.save(tmp_path / name))
    assert (again.size, again.recording) == (loaded.size, loaded.recording)


def test_a_review_shows_a_video_file_in_its_own_size(place):
    session = Session(place / "result")
    assert session.source is not None
    assert Reviewed(session, "result").state["size"] == SIZE
    session.close()


def test_a_review_of_an_old_result_takes_the_size_of_the_video(place):
    record = json.loads((place / "result/run.json").read_text())
    record["results"]["."] = {"source": str(place / "clip.webm"), "frame_rate": RATE, "size": None}
    (place / "result/run.json").write_text(json.dumps(record))
    with pytest.warns(InputWarning, match="does not say of which file"):
        session = Session(place / "result")
    assert Reviewed(session, "result").state["size"] == SIZE
    session.close()


def takers(folder):
    """What takes a result and its video, by name."""
    result = folder / "result"

    def review(video):
        Session(result, video).close()

    return {
        "review": review,
        "hide": lambda video: hide(video, result, folder / "hidden.webm", detector=lambda _: np.empty((0, 5))),
        "overlay": lambda video: Result.load(result).overlay(folder / "overlay.webm", video),
        "convert": lambda video: convert(result, "coco", folder / "tracks.coco.json", video=video),
    }


TAKERS = ["review", "hide", "overlay", "convert"]


@pytest.mark.parametrize("taker", TAKERS)
def test_a_video_file_of_another_size_is_refused(place, taker):
    other = write_video(place / "other.webm", (320, 240))
    with pytest.raises(RequestError, match="160x120 pixels as in the result, got 320x240"):
        takers(place)[taker](other)


@pytest.mark.parametrize("taker", TAKERS)
def test_another_video_file_of_the_same_size_is_said(place, taker):
    other = write_video(place / "other.webm", shade=90)
    with pytest.warns(InputWarning, match="other.webm is not the file that the result is of"):
        takers(place)[taker](other)


@pytest.mark.filterwarnings("error::tsuiseki.tracking.errors.InputWarning")
@pytest.mark.parametrize("taker", TAKERS)
def test_the_video_file_of_the_result_is_taken_in_silence_wherever_it_lies(place, taker):
    moved = shutil.copy2(place / "clip.webm", place / "moved.webm")
    takers(place)[taker](moved)


def test_the_source_that_changed_since_is_refused_or_said(place):
    result = Result.load(place / "result")
    write_video(place / "clip.webm", shade=90)
    with pytest.warns(InputWarning, match="is not the file"):
        result.draw(3)
    write_video(place / "clip.webm", (320, 240))
    with pytest.raises(RequestError, match="got 320x240"):
        result.draw(3)


SCENE = {"size": [*SIZE], "lines": [{"name": "door", "from": [60, 0], "to": [60, 119]}]}


def test_a_scene_of_another_size_than_the_video_file_is_refused(place, capsys):
    scene = place / "scene.yaml"
    scene.write_text(yaml.safe_dump({**SCENE, "size": [320, 240]}))
    assert main(["count", str(place / "result"), "--scene", str(scene), "--out", str(place / "o")]) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    assert "320x240" in error
    assert "the video has 160x120" in error


@pytest.mark.slow
def test_who_crosses_in_a_video_file_is_counted(place, capsys):
    scene = place / "scene.yaml"
    scene.write_text(yaml.safe_dump(SCENE))
    assert main(["count", str(place / "result"), "--scene", str(scene), "--out", str(place / "o")]) == 0
    tables = json.loads((place / "o/answers.json").read_text())
    assert sorted(tables["lines"]["count"]) == [0, 1]
    assert "not the file" not in capsys.readouterr().err


def test_an_old_result_without_a_size_is_counted_and_that_is_said(place):
    (place / "scene.yaml").write_text(yaml.safe_dump(SCENE))
    old = Result(Result.load(place / "result").tracks, str(place / "clip.webm"), RATE)
    with pytest.warns(InputWarning, match="does not say the size of its video"):
        answers = count(old, place / "scene.yaml")
    assert sum(answers.tables["lines"]["count"]) == 1


@pytest.mark.slow
def test_the_page_of_a_count_shows_no_pictures_of_another_video(place):
    (place / "scene.yaml").write_text(yaml.safe_dump(SCENE))
    write_video(place / "clip.webm", (320, 240))
    words = ["count", str(place / "result"), "--scene", str(place / "scene.yaml"), "--out", str(place / "o")]
    with pytest.warns(InputWarning, match="got 320x240.* without its pictures"):
        count_page(place)
    assert main(words) == 0


def count_page(place):
    from tsuiseki.tracking.counts.page import TrackedPage

    result = Result.load(place / "result")
    assert not TrackedPage(result, count(result, place / "scene.yaml")).pictures.crops


@pytest.mark.parametrize("form", ["coco", "cvat", "label-studio"])
def test_a_result_of_a_video_file_is_converted_without_naming_it(place, form):
    ending = {"cvat": "xml"}.get(form, "json")
    out = convert(place / "result", form, place / f"tracks.{ending}")
    assert out.stat().st_size > 0
    if form == "coco":
        content = json.loads(out.read_text())
        assert {(image["width"], image["height"]) for image in content["images"]} == {SIZE}


def test_results_whose_video_file_has_another_size_now_are_not_linked_by_it(place):
    shutil.copytree(place / "result", place / "second")
    result = Result.load(place / "second")
    moved = Result([t for t in result.tracks if t.id == 1], str(place / "clip.webm"), RATE, (640, 480))
    with pytest.raises(RequestError, match="640x480 pixels as in the result, got 160x120"):
        link([place / "result", moved])


def test_a_result_of_another_size_is_not_scored(place, capsys):
    truth = place / "seq"
    (truth / "gt").mkdir(parents=True)
    rows = (place / "result/tracks.txt").read_text().splitlines()
    labels = [",".join([*row.split(",")[:6], "1", "1", "1"]) for row in rows]
    (truth / "gt/gt.txt").write_text("\n".join(labels) + "\n")
    about = f"[Sequence]\nname=seq\nimDir=img1\nframeRate=12\nseqLength={FRAMES}\nimExt=.jpg\n"
    for size, status in ((SIZE, 0), ((320, 240), 2)):
        (truth / "seqinfo.ini").write_text(f"{about}imWidth={size[0]}\nimHeight={size[1]}\n")
        assert main(["evaluate", "people", str(truth), str(place / "result")]) == status
    assert "expected a result of seq, 320x240 pixels, got one of 160x120" in capsys.readouterr().err


def test_a_number_of_a_stream_belongs_to_an_address_and_not_to_a_file(place, monkeypatch):
    clip = place / "clip.webm"
    assert file_of(f"{clip}#stream=1") == file_of(str(clip)) == clip
    assert file_of("") is None
    assert file_of(f"{place / 'none.mkv'}#stream=2") is None
    monkeypatch.chdir(place)
    assert absolute("clip.webm#stream=1") == f"{clip.resolve()}#stream=1"
    assert absolute("rtsp://camera/1#stream=2") == "rtsp://camera/1#stream=2"
    assert absolute("") == ""


@pytest.mark.filterwarnings("error::tsuiseki.tracking.errors.InputWarning")
def test_a_result_of_a_chosen_stream_finds_its_video_again(place, monkeypatch):
    monkeypatch.chdir(place)
    found = [np.array([[10 + 4 * n, 40, 26 + 4 * n, 80, 0.9]]) for n in range(FRAMES)]
    result = track_people("clip.webm#stream=1", detections=found, appearance="none")
    result.save(place / "chosen")
    monkeypatch.chdir("/")
    loaded = Result.load(place / "chosen")
    assert loaded.source == f"{(place / 'clip.webm').resolve()}#stream=1"
    assert loaded.draw(2).shape == (120, 160, 3)
    session = Session(place / "chosen")
    assert session.source == loaded.source
    session.close()
    with pytest.raises(RequestError, match="another file than the video"):
        hide(loaded.source, loaded, place / "clip.webm", overwrite=True)


@pytest.mark.parametrize(
    ("name", "value"), [("size", "abc"), ("length", "many"), ("fingerprint", [1]), ("frame_rate", -1), ("size", [1])]
)
def test_a_record_that_no_run_wrote_is_refused_in_a_line(place, name, value):
    record = json.loads((place / "result/run.json").read_text())
    record["results"]["."][name] = value
    (place / "result/run.json").write_text(json.dumps(record))
    with pytest.raises(RequestError, match=name):
        Result.load(place / "result")
