"""`tsuiseki evaluate` against the label files and folders of drone data sets, by rules that are counted by hand."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.evaluation.actions import read_labelled_actions
from tsuiseki.tracking.formats.acting_tracks import write_acting_tracks
from tsuiseki.tracking.formats.drone_action import DRONE_ACTION_CLASSES
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.formats.okutama import OKUTAMA_ACTIONS
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.tracks import ActingTrack

FRAMES = 6


def okutama_rows() -> str:
    """One who walks, one who sits and is hidden in frame 3, and one who is out of view; pixels of 3840x2160."""
    lines = []
    for frame in range(FRAMES):
        lines.append(f'0 {300 + 30 * frame} 300 {420 + 30 * frame} 600 {frame} 0 0 0 "Person" "Walking"')
        lines.append(f'1 1500 900 1620 1200 {frame} 0 {int(frame == 3)} 0 "Person" "Sitting"')
        lines.append(f'2 3000 900 3120 1200 {frame} 1 0 0 "Person" "Standing"')
    return "\n".join(lines) + "\n"


@pytest.fixture
def okutama(tmp_path: Path) -> Path:
    folder = tmp_path / "okutama"
    labels = folder / "Labels" / "SingleActionTrackingLabels" / "3840x2160"
    frames = folder / "Drone1" / "Noon" / "Extracted-Frames-1280x720" / "1.1.8"
    for place in (labels, frames):
        place.mkdir(parents=True)
    (labels / "1.1.8.txt").write_text(okutama_rows())
    for frame in range(FRAMES):
        cv2.imwrite(str(frames / f"{frame}.jpg"), np.zeros((720, 1280, 3), np.uint8))
    return folder


@pytest.fixture
def found(tmp_path: Path) -> Path:
    """Both people in all frames of 1280x720, the second for nobody's gain where hidden."""
    return write_found(tmp_path / "found", OKUTAMA_ACTIONS, ("Walking", "Sitting"))


def write_found(folder: Path, names: tuple[str, ...], says: tuple[str, str], scale: float = 1.0) -> Path:
    folder.mkdir()
    frames = np.arange(FRAMES)
    walker = np.column_stack([100 + 10 * frames, 0 * frames + 100, 140 + 10 * frames, 0 * frames + 200])
    sitter = np.tile([500.0, 300, 540, 400], (FRAMES, 1))
    people = []
    for number, (boxes, action) in enumerate(zip((walker, sitter), says, strict=True), 1):
        said = np.zeros((FRAMES, len(names)))
        said[:, names.index(action)] = 0.9
        track = Track(number, frames, scale * boxes.astype(np.float64), np.ones(FRAMES))
        people.append(ActingTrack(track, said, said))
    write_acting_tracks(folder / "tracks.json", people, names)
    write_tracks(folder / "tracks.txt", [person.track for person in people])
    return folder


def scores(kind: str, out: Path, *words: str | Path) -> dict[str, Any]:
    assert main(["evaluate", kind, *map(str, words), "--json", str(out / "scores.json"), "--overwrite"]) == 0
    values: dict[str, Any] = json.loads((out / "scores.json").read_text())
    return values


@pytest.mark.parametrize("bare", [True, False])
@pytest.mark.parametrize(("protocol", "labelled", "wrong"), [("lenient", 11, 0), ("published", 9, 1)])
def test_okutama_tracks_are_scored_by_either_protocol(
    okutama: Path, found: Path, tmp_path: Path, bare: bool, protocol: str, labelled: int, wrong: int
) -> None:
    # Two people in six frames, one of them hidden once; published leaves out frame 0 on both sides, and takes the box
    # on the hidden person for a false alarm.
    truth = next(okutama.glob("Labels/Single*/*/*.txt")) if bare else okutama
    combined = scores("people", tmp_path, truth, found, "--protocol", protocol)["found"]["combined"]
    assert (combined["labelled"], combined["false_positives"], combined["false_negatives"]) == (labelled, wrong, 0)
    assert combined["id_switches"] == 0
    assert combined["motp"] == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("bare", [True, False])
@pytest.mark.parametrize(("protocol", "rows"), [("lenient", 11), ("published", 10)])
def test_okutama_actions_are_scored_by_either_protocol(
    okutama: Path, found: Path, tmp_path: Path, bare: bool, protocol: str, rows: int
) -> None:
    truth = next(okutama.glob("Labels/Single*/*/*.txt")) if bare else okutama
    single = scores("action", tmp_path, truth, found, "--protocol", protocol)["found single"]
    assert single["rows"] == rows
    # The hidden person is said to sit, on nobody.
    sitting = {"lenient": 1.0, "published": 2 * 4 / (2 * 4 + 1)}[protocol]
    assert single["actions"]["Sitting"]["f1"] == pytest.approx(sitting)
    assert single["actions"]["Walking"]["f1"] == 1


def test_a_stretch_is_scored_alone(
    okutama: Path, found: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for kind, rows in (("people", "labelled"), ("action", "rows")):
        values = scores(kind, tmp_path, okutama, found, "--frames", "1-3", "--protocol", "published")
        combined = values["found"]["combined"] if kind == "people" else values["found single"]
        assert combined[rows] == 4
    assert main(["evaluate", "action", str(okutama), str(found), "--frames", "9-"]) == 2
    assert "expected a labelled person who counts in frames 9-, got none" in capsys.readouterr().err


def test_tracks_of_frames_of_another_size_are_compared_in_their_pixels(
    okutama: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    large = write_found(tmp_path / "large", OKUTAMA_ACTIONS, ("Walking", "Sitting"), scale=1.5)
    labels = next(okutama.glob("Labels/Single*/*/*.txt"))
    for size, recall in (("1920,1080", 1), ("1280,720", 0)):
        values = scores("people", tmp_path, labels, large, "--size", size)["large"]["combined"]
        assert values["recall"] == recall
    for kind in ("people", "action"):
        assert main(["evaluate", kind, str(labels), str(large), "--size", "0,720"]) == 2
        assert "--size: expected a number greater than 0, got '0'" in capsys.readouterr().err
    assert main(["evaluate", "people", str(labels), str(large), "--size", "1920"]) == 2
    assert "--size: expected a value, got none" in capsys.readouterr().err


def test_label_files_of_generated_clips_are_in_pixels_of_their_own_frames(
    acting_clips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = tmp_path / "clip"
    shutil.copytree(acting_clips / "validation/validation-0", clip)
    shutil.copyfile(clip / "gt/gt.txt", tmp_path / "found.txt")
    monkeypatch.chdir(clip / "gt")
    for labels in (clip / "gt/actions.txt", Path("actions.txt")):
        combined = scores("people", tmp_path, labels, tmp_path / "found.txt")["found"]["combined"]
        # One of 5 people is hidden in one of 22 frames.
        assert (combined["labelled"], combined["false_positives"], combined["recall"]) == (22 * 5 - 1, 0, 1)
    (clip / "seqinfo.ini").write_text("[Sequence]\nseqLength=22\n")
    for kind in ("people", "action"):
        assert main(["evaluate", kind, "actions.txt", str(tmp_path / "found.txt")]) == 2
        error = capsys.readouterr().err
        assert "seqinfo.ini: expected imWidth and imHeight, to scale gt/actions.txt to them" in error


def test_detections_are_scored_against_okutama(okutama: Path, found: Path, tmp_path: Path) -> None:
    boxes = [line.split(",") for line in (found / "tracks.txt").read_text().splitlines()]
    text = "".join(f"{row[0]},-1,{','.join(row[2:6])},0.9\n" for row in boxes)
    (found / "detections.txt").write_text(text)
    lenient = scores("detection", tmp_path, okutama, found)["found"]["combined"]
    published = scores("detection", tmp_path, okutama, found, "--protocol", "published")["found"]["combined"]
    assert (lenient["boxes"], published["boxes"]) == (11, 9)
    assert lenient["average_precision"] == pytest.approx(1)
    assert published["average_precision"] < 1


def test_visdrone_folders_are_scored(tmp_path: Path) -> None:
    folder = tmp_path / "visdrone"
    (folder / "annotations").mkdir(parents=True)
    (folder / "sequences" / "uav1").mkdir(parents=True)
    rows = [
        "1,1,10,20,30,40,1,1,0,0",
        "2,1,11,20,30,40,1,2,0,0",
        "2,0,300,300,99,99,0,0,0,0",
        "2,5,600,9,50,40,1,4,0,0",
    ]
    (folder / "annotations" / "uav1.txt").write_text("\n".join(rows) + "\n")
    for frame in (1, 2):
        cv2.imwrite(str(folder / "sequences" / "uav1" / f"{frame:07d}.jpg"), np.zeros((480, 720, 3), np.uint8))
    # The person; one on the ignored region; one on a car.
    (tmp_path / "uav1.txt").write_text(
        "1,1,11,21,30,40,1,-1,-1,-1\n2,1,12,21,30,40,1,-1,-1,-1\n2,2,301,301,99,99,1,-1,-1,-1\n2,3,601,10,50,40,1,-1,-1,-1\n"
    )
    for truth in (folder, folder / "annotations" / "uav1.txt"):
        combined = scores("people", tmp_path, truth, tmp_path / "uav1.txt")["uav1"]["combined"]
        assert (combined["labelled"], combined["false_positives"], combined["recall"]) == (2, 1, 1)


def test_drone_action_folders_are_scored(tmp_path: Path) -> None:
    clip = tmp_path / "data" / "waving_hands" / "S1"
    clip.mkdir(parents=True)
    for frame in range(FRAMES):
        cv2.imwrite(str(clip / f"{frame:03d}.jpg"), np.zeros((16, 16, 3), np.uint8))
    clip.with_suffix(".txt").write_text("".join(f"{101 + 10 * n},101,40,100\n" for n in range(FRAMES)))
    found = write_found(tmp_path / "found", DRONE_ACTION_CLASSES, ("waving_hands", "kicking"))
    combined = scores("people", tmp_path, tmp_path / "data", found)["found"]["combined"]
    assert (combined["labelled"], combined["false_positives"], combined["recall"]) == (FRAMES, FRAMES, 1)
    actions = scores("action", tmp_path, tmp_path / "data", found)["found multi"]["actions"]
    assert actions["waving_hands"] == {
        "f1": 1, "precision": 1, "recall": 1, "average_precision": 1, "rows": FRAMES
    }  # fmt: skip


def test_mot_sequences_named_like_parts_of_other_data_sets_stay_what_they_are(
    acting_clips: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "mine"
    shutil.copytree(acting_clips / "validation/validation-0", folder / "kicking", ignore=shutil.ignore_patterns("img1"))
    info = folder / "kicking" / "seqinfo.ini"
    info.write_text(info.read_text().replace("validation-0", "kicking"))
    (folder / "Labels").mkdir()
    shutil.copyfile(folder / "kicking/gt/gt.txt", folder / "kicking.txt")
    combined = scores("people", tmp_path, folder, folder)["mine"]["combined"]
    assert (combined["hota"], combined["labelled"]) == (1, 22 * 5)
    (clip,) = read_labelled_actions(folder)
    assert clip.name == "kicking"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('"Sitting"', "Sitting"), ':2: expected names in double quotes, as "Person" "Walking"'),
        (('"Sitting"', '"Juggling"'), ":2: unknown action 'Juggling'; known are Handshaking, Hugging"),
        ((" 5 0 0 0", " 6 0 0 0"), "labels reach frame 6, but the video ends with frame 5; use the frames that come"),
    ],
)
@pytest.mark.parametrize("kind", ["people", "action"])
def test_broken_okutama_labels_are_refused_in_one_line(
    okutama: Path, found: Path, kind: str, change: tuple[str, str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    labels = next(okutama.glob("Labels/Single*/*/*.txt"))
    labels.write_text(labels.read_text().replace(*change))
    assert main(["evaluate", kind, str(okutama), str(found)]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("kind", ["people", "action"])
def test_okutama_boxes_outside_the_picture_are_left_out_and_counted(
    okutama: Path, found: Path, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    labels = next(okutama.glob("Labels/Single*/*/*.txt"))
    labels.write_text(labels.read_text().replace("1500 900 1620 1200", "4500 900 4620 1200"))
    assert main(["evaluate", kind, str(okutama), str(found)]) == 0
    assert "6 of 18 rows are left out: 6 without an area in 3840x2160" in capsys.readouterr().err


def test_frames_that_do_not_match_are_refused_in_one_line(
    okutama: Path, found: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = next(okutama.glob("Drone1/**/1.1.8"))
    (frames / "2.jpg").rename(frames / "9.jpg")
    assert main(["evaluate", "people", str(okutama), str(found)]) == 2
    assert "expected frames numbered 0 to 5, found no frame 2; labels would not line up" in capsys.readouterr().err
    for image in frames.iterdir():
        image.unlink()
    # The video that is offered beside the labels: larger, and of another length.
    for frame in range(FRAMES + 2):
        cv2.imwrite(str(frames / f"{frame}.jpg"), np.zeros((2160, 3840, 3), np.uint8))
    assert main(["evaluate", "action", str(okutama), str(found)]) == 2
    error = capsys.readouterr().err
    assert "the 3840x2160 video has 8 frames, the labels 6: Okutama's 4K videos and its labels do not line up" in error
    assert error.count("\n") == 1


def test_actions_of_another_data_set_are_refused_in_one_line(
    okutama: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = write_found(tmp_path / "found", DRONE_ACTION_CLASSES, ("kicking", "stabbing"))
    assert main(["evaluate", "action", str(okutama), str(found)]) == 2
    error = capsys.readouterr().err
    assert "expected the actions of the labels, Handshaking, Hugging" in error
    assert error.count("\n") == 1
