"""YOLO's rows: what the sixth number is, rows without an id, and what frames count from."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.calls import evaluate_people
from tsuiseki.tracking.formats.exports import read_exported
from tsuiseki.tracking.formats.labelled import open_labelled
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.types import Track

BOX = "0 0.5 0.5 0.1 0.2"
ABOUT = "width: 640\nheight: 480\n"


def folder_of(folder: Path, rows: dict[int, list[str]], about: str = ABOUT) -> Path:
    """Rows by the number in the name of their file."""
    (folder / "labels").mkdir(parents=True)
    (folder / "data.yaml").write_text(about)
    for number, ends in rows.items():
        (folder / "labels" / f"a_{number}.txt").write_text("".join(f"{BOX} {end}\n" for end in ends))
    return folder


def tracks_in(folder: Path) -> dict[int, list[int]]:
    return {track.id: track.frames.tolist() for track in read_exported(folder).tracks}


def test_58_14_rows_without_an_id_among_others_are_left_out_and_counted(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "y", {1: ["", "2"], 2: ["1", "2"], 3: ["1", "2"]})
    with pytest.warns(InputWarning, match="1 of 6 boxes have no id"):
        assert tracks_in(folder) == {1: [1, 2], 2: [0, 1, 2]}
    (video,) = open_labelled(folder)
    with pytest.warns(InputWarning, match=r"1 of 6 labelled boxes are left out: 1 without an id \(.*in frame 1\)"):
        assert sorted(video.people().ids.tolist()) == [1, 1, 2, 2, 2]
    assert len(video.people(single=True)) == 6


def test_58_14_rows_most_of_which_have_no_id_are_refused_as_tracks(tmp_path: Path) -> None:
    (video,) = open_labelled(folder_of(tmp_path / "y", {1: ["", "2"], 2: ["", "2"], 3: ["", ""]}))
    with pytest.raises(RequestError, match=r"expected an id of each box .* found none of 4 among 6"):
        video.people()


def test_58_14_a_sixth_number_is_a_score_where_others_have_both(tmp_path: Path) -> None:
    # As ultralytics writes a track with save_conf, with a box that has no id.
    folder = folder_of(tmp_path / "y", {1: ["0.9 4", "0.8"], 2: ["0.7 4"], 3: ["0.9 4", "1"]})
    with pytest.warns(InputWarning, match="2 of 5 boxes have no id"):
        assert tracks_in(folder) == {4: [0, 1, 2]}
    assert read_exported(folder, single=True).boxes.scores.tolist() == [0.9, 0.8, 0.7, 0.9, 1.0]
    with pytest.raises(RequestError, match=r"a_2\.txt:1: .* with a score from 0 to 1 where others have score and id"):
        read_exported(folder_of(tmp_path / "both", {1: ["0.9 4"], 2: ["17"]}))


def test_58_14_a_sixth_number_that_is_no_whole_one_is_a_score_in_all_rows(tmp_path: Path) -> None:
    video = read_exported(folder_of(tmp_path / "y", {1: ["0.9", "1"], 2: ["0.25"]}), single=True)
    assert (video.identified, video.boxes.scores.tolist()) == (False, [0.9, 1.0, 0.25])


def test_58_14_frames_count_from_1_or_from_what_the_folder_says(tmp_path: Path) -> None:
    rows = {number: ["1"] for number in range(3)}
    with pytest.raises(RequestError, match=r"a_0\.txt: expected frames counted from 1 .* say it in data.yaml, such as"):
        tracks_in(folder_of(tmp_path / "a", rows))
    assert tracks_in(folder_of(tmp_path / "b", rows, f"{ABOUT}first_frame: 0\n")) == {1: [0, 1, 2]}
    # The same, whether or not there is a box in frame 0.
    assert tracks_in(folder_of(tmp_path / "c", {2: ["1"]}, f"{ABOUT}first_frame: 0\n")) == {1: [2]}
    assert tracks_in(folder_of(tmp_path / "d", {2: ["1"]})) == {1: [1]}


def test_58_14_two_files_of_one_frame_are_refused(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "y", {1: ["1"]})
    (folder / "labels" / "b_1.txt").write_text(f"{BOX} 1\n")
    with pytest.raises(RequestError, match=r"b_1\.txt: expected one file a frame, got a_1\.txt, too"):
        tracks_in(folder)


@pytest.mark.integration
def test_58_14_the_shared_case_is_scored_without_three_rows(
    data_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = data_folder / "cases/round2/02-labels"
    assert main(["evaluate", "people", str(folder / "yolo_noid_some"), str(folder / "res.txt")]) == 0
    output = capsys.readouterr()
    assert "3 of 90 labelled boxes are left out: 3 without an id (the first in frame 1)" in output.err
    with pytest.warns(InputWarning):
        scores = evaluate_people(folder / "yolo_noid_some", folder / "res.txt")
    assert (scores.labelled, scores.recall, scores.false_positives) == (87, 1, 3)


def test_58_15_more_frames_than_pictures_are_refused_in_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "pictures").mkdir()
    for number in (1, 2, 3):
        Image.new("RGB", (640, 480)).save(tmp_path / "pictures" / f"{number}.png")
    boxes = [[10.0, 20, 40, 90]] * 5
    write_tracks(tmp_path / "t.txt", [Track(1, range(5), boxes, [0.9] * 5)])  # type: ignore[arg-type]
    words = ["convert", str(tmp_path / "t.txt"), "--to", "yolo", "--out", str(tmp_path / "out")]
    assert main([*words, "--video", str(tmp_path / "pictures")]) == 2
    line = "expected frames up to 3, one a picture of pictures, got a box in frame 5; are these the pictures that"
    assert line in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out").exists()
    write_tracks(tmp_path / "t.txt", [Track(1, range(3), boxes[:3], [0.9] * 3)])  # type: ignore[arg-type]
    assert main([*words, "--video", str(tmp_path / "pictures")]) == 0
    assert sorted(path.name for path in (tmp_path / "out/labels").iterdir()) == ["1.txt", "2.txt", "3.txt"]
