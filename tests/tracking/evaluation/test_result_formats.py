"""Results in the files of other programs are scored, and so is what this one exports."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.calls import evaluate_people
from tsuiseki.tracking.evaluation.result_files import match_results, read_truths
from tsuiseki.tracking.formats.box_labels import read_kitti_video
from tsuiseki.tracking.formats.exports import FORMATS, read_boxes
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import Track

# Of those with boxes, which nothing reads back.
UNREAD = ("via", "geff", "sleap", "sleap-analysis", "deeplabcut")
KITTI = "{frame} {id} {kind} 0 0 -10 {left} 20 {right} 90 -1 -1 -1 -1000 -1000 -1000 -10{score}\n"


def walkers(count: int = 2, length: int = 12) -> list[Track]:
    frames = np.arange(length)
    lefts = [100.0 * k + frames for k in range(count)]
    boxes = [np.column_stack([x, np.full(length, 20.0), x + 30, np.full(length, 90.0)]) for x in lefts]
    return [Track(k + 1, frames, box, np.full(length, 0.5)) for k, box in enumerate(boxes)]


def truth(folder: Path, *names: str) -> Path:
    for name in names or ("S",):
        (folder / name / "gt").mkdir(parents=True)
        write_tracks(folder / name / "gt" / "gt.txt", walkers())
        path = folder / name / "gt" / "gt.txt"
        path.write_text(path.read_text().replace(",0.5000,", ",1,"))
        (folder / name / "seqinfo.ini").write_text("[Sequence]\nseqLength=12\nimWidth=640\nimHeight=480\n")
    return folder


def kitti(path: Path, *kinds: str, score: str = " 0.5") -> Path:
    rows = [
        KITTI.format(frame=frame, id=number, kind=kind, left=100 * k + frame, right=100 * k + frame + 30, score=score)
        for frame in range(12)
        for k, (number, kind) in enumerate(kind.split() for kind in kinds)
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(rows))
    return path


@pytest.mark.parametrize("name", [name for name in FORMATS if name not in UNREAD])
def test_58_15_what_is_exported_is_scored(name: str, tmp_path: Path) -> None:
    result = Result(walkers(), "video.mp4", 25.0, (640, 480), frames={"frame": list(range(12))})
    exported = result.save(tmp_path / f"out{FORMATS[name].suffix}", to=name)
    assert main(["evaluate", "people", str(truth(tmp_path / "truth") / "S"), str(exported)]) == 0
    scores = evaluate_people(tmp_path / "truth" / "S", exported)
    assert (scores.hota, scores.mota, scores.idf1, scores.labelled) == (1, 1, 1, 24)


@pytest.mark.parametrize("score", [" 0.5", ""])
def test_58_15_kittis_results_are_scored(score: str, tmp_path: Path) -> None:
    path = kitti(tmp_path / "res.txt", "0 Pedestrian", "1 Pedestrian", score=score)
    assert evaluate_people(truth(tmp_path / "truth") / "S", path).mota == 1
    tracks = read_kitti_video(path).tracks
    confidence = 0.5 if score else 1
    assert [(t.id, t.frames[0], t.scores[0]) for t in tracks] == [(1, 0, confidence), (2, 0, confidence)]
    labels = kitti(tmp_path / "K/label_02/0000.txt", "0 Pedestrian", "1 Pedestrian", "2 Car", score="")
    assert evaluate_people(labels, path).hota == 1


def test_58_15_classes_that_are_no_people_are_said_and_can_be_left_out(tmp_path: Path) -> None:
    path, sequence = kitti(tmp_path / "res.txt", "5 Pedestrian", "6 Pedestrian", "9 Car"), truth(tmp_path / "truth")
    with pytest.warns(InputWarning, match="1 of 3 tracks are of Car, and count as false; `classes` person leaves them"):
        assert evaluate_people(sequence / "S", path).false_positives == 12
    assert evaluate_people(sequence / "S", path, classes=["person"])["person"].hota == 1


def test_58_15_regions_and_rows_without_an_area_are_left_out_and_counted(tmp_path: Path) -> None:
    path = kitti(tmp_path / "res.txt", "1 Pedestrian", "-1 DontCare", "2 Pedestrian")
    path.write_text(path.read_text() + KITTI.format(frame=11, id=7, kind="Pedestrian", left=50, right=50, score=" 1"))
    with pytest.warns(InputWarning) as told:
        assert [track.id for track in read_boxes(path)] == [1, 2]
    texts = [str(warning.message) for warning in told]
    assert "1 of 37 boxes are left out: 1 without an area (in line 37)" in texts[0]
    assert "12 of 36 boxes have no id of a track, or are crowds" in texts[1]


def test_58_15_trackevals_folders_are_results(tmp_path: Path) -> None:
    folder = truth(tmp_path / "truth", "A", "B")
    for name in ("A", "B"):
        (tmp_path / "tracker/data").mkdir(parents=True, exist_ok=True)
        write_tracks(tmp_path / f"tracker/data/{name}.txt", walkers())
    pairs = match_results(read_truths(folder), tmp_path / "tracker")
    assert [(pair.name, len(pair.tracks)) for pair in pairs] == [("A", 2), ("B", 2)]
    (tmp_path / "tracker/data/B.txt").unlink()
    with pytest.raises(RequestError, match=r"expected the result of B as .* or data/B\.txt, found none"):
        match_results(read_truths(folder), tmp_path / "tracker")


def test_58_15_a_table_of_other_targets_is_refused(tmp_path: Path) -> None:
    (tmp_path / "states.csv").write_text("frame,id,a,b,theta,score,status\n1,1,2,3,0,1,tracking\n")
    with pytest.raises(RequestError):
        read_boxes(tmp_path / "states.csv")


@pytest.mark.parametrize("row", ["0 1 Pedestrian 0 0 -10 1 2 3", "0 1 Pedestrian 0 0 -10 1 2 x 4"])
def test_58_15_a_broken_row_of_kitti_is_refused_in_words(row: str, tmp_path: Path) -> None:
    path = kitti(tmp_path / "res.txt", "0 Pedestrian")
    path.write_text(path.read_text() + row + "\n")
    with pytest.raises(RequestError, match=r"res\.txt:13: expected frame track type"):
        read_kitti_video(path)
