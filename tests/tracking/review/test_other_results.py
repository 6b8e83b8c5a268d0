"""Results of other kinds are reviewed, too: a single target, a table, boxes without a video."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from tests.tracking.review.conftest import FRAMES as FRAMES_OF_CLIP
from tests.tracking.review.conftest import PEOPLE
from tsuiseki.datamodules.labelled_images import labelled_images
from tsuiseki.datamodules.video_pictures import read_image
from tsuiseki.tracking.formats.labelled import open_labelled
from tsuiseki.tracking.formats.single import read_boxes, write_boxes
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.review.reviewed import Reviewed
from tsuiseki.tracking.review.session import Session
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.video.webm import VideoWriter
from tsuiseki.trainers.flow.videos import detected, labelled_sequences

FRAMES, LOST = 100, slice(60, 90)


def of_one_target(folder):
    """Somebody who walks 4 pixels a frame; the tracker loses them, and its box stays where it was."""
    t = np.arange(FRAMES)
    right = np.column_stack([20 + 4 * t, 50 + 0 * t, 50 + 4 * t, 130 + 0 * t]).astype(float)
    boxes, found = right.copy(), np.ones(FRAMES, dtype=bool)
    boxes[LOST], found[LOST] = right[LOST.start - 1], False
    frames = {"frame": t.tolist(), "score": found.tolist(), "status": ["tracking" if f else "lost" for f in found]}
    files = {"boxes.txt": lambda path, _: write_boxes(path, boxes)}
    known = {"frame_rate": 25.0, "size": (640, 360), "frames": frames, "files": files}
    return Result([Track(1, t, boxes, found, found)], **known).save(folder), right, boxes


def test_a_target_that_was_lost_goes_on_from_both_sides_of_a_click(tmp_path):
    folder, right, before = of_one_target(tmp_path / "result")
    session = Session(folder)
    reviewed = Reviewed(session, "result")
    assert reviewed.state["single"]
    middle = (right[75, :2] + right[75, 2:]) / 2
    answer = reviewed.change("correct", {"kind": "target", "frame": 75, "point": middle.tolist(), "of": 1})
    assert answer["changed"] == [(1, LOST.start, LOST.stop - 1)]
    assert np.abs(session.tracks()[0].boxes - right).max() < 1
    session.close()
    assert np.abs(Result.load(folder)[0].boxes - right).max() < 1
    assert np.abs(read_boxes(folder / "boxes.txt") - right).max() < 1
    session = Session(folder)
    assert np.abs(session.tracks()[0].boxes - right).max() < 1
    session.undo()
    assert np.abs(session.tracks()[0].boxes - before).max() < 0.01
    session.close()
    assert np.abs(read_boxes(folder / "boxes.txt") - before).max() < 0.01


def test_a_click_where_the_target_is_tracked_moves_its_box(tmp_path):
    folder, right, _ = of_one_target(tmp_path / "result")
    session = Session(folder)
    middle = (right[30, :2] + right[30, 2:]) / 2 + [9, 0]
    Reviewed(session, "result").change("correct", {"kind": "target", "frame": 30, "point": middle.tolist(), "of": 1})
    assert session.tracks()[0].boxes[30] == pytest.approx(right[30] + [9, 0, 9, 0])
    session.close()


def test_a_table_of_tracks_is_corrected(tmp_path):
    t = np.arange(40)
    walks = [20 + 4 * t, 200 - 4 * t]
    tracks = [
        Track(k + 1, t, np.column_stack([x, 50 + 0 * x, x + 30, 130 + 0 * x]), np.ones(40)) for k, x in enumerate(walks)
    ]
    folder = Result(tracks, frame_rate=25.0, frames={"frame": t.tolist()}).save(tmp_path / "result")
    session = Session(folder)
    reviewed = Reviewed(session, "result", "there is no video")
    assert (reviewed.state["size"], reviewed.state["single"]) == ([230, 130], False)
    reviewed.change("correct", {"kind": "switch", "ids": [1, 2], "frame": 30})
    session.close()
    saved = Result.load(folder).by_id
    assert saved[1].boxes[35, 0] == pytest.approx(walks[1][35])
    assert saved[2].boxes[35, 0] == pytest.approx(walks[0][35])
    assert saved[1].boxes[20, 0] == pytest.approx(walks[0][20])


def test_a_reviewed_result_is_training_data(reviewable, tracked):
    session = Session(reviewable)
    session.correct(session.made("delete", [3]))
    session.correct(session.made("box", [1], 10, box=(30, 40, 50, 60)))
    session.close()
    (video,) = open_labelled(reviewable)
    truth = video.people()
    assert [path.name for path in video.files] == sorted(path.name for path in (tracked.parent / "clip").iterdir())
    assert set(truth.ids.tolist()) == set(range(1, PEOPLE + 1)) - {3}
    moved = truth.select((truth.ids == 1) & (truth.frames == 10))
    assert moved.boxes.tolist() == [[30, 40, 80, 100]]
    assert (truth.evaluated != truth.ignored).all()
    assert len(labelled_images(reviewable)) == FRAMES_OF_CLIP


@pytest.mark.slow
def test_a_reviewed_result_of_a_video_file_is_training_data(reviewable, tracked, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with VideoWriter(tmp_path / "clip.webm", 25) as writer:
        for path in sorted((tracked.parent / "clip").iterdir()):
            writer.write(cv2.imread(str(path))[..., ::-1])
    record = json.loads((reviewable / "run.json").read_text())
    record["results"]["."]["source"] = str(tmp_path / "clip.webm")
    record["frames"] = {"frame": list(range(21, 61))}
    (reviewable / "run.json").write_text(json.dumps(record))
    (reviewable / "corrections.jsonl").write_text("")
    images = labelled_images(reviewable)
    assert len(images) == 40
    # Where people are, pictures and labels show the same.
    sums = [[read_image(one.picture)[int(b[1]) + 20, int(b[0]) + 15].astype(int) for b in one.boxes] for one in images]
    colours = np.array([[200, 90 * n % 256, 40 * n % 256] for n in images[0].ids])
    assert np.abs(np.array(sums[0]) - colours).max() < 60
    (video,) = labelled_sequences([reviewable])
    assert (video.frame_rate, len(video.images), len(video.detections)) == (25.0, 40, 40)
    assert min(map(len, detected(video, "given", np.random.default_rng(0)).detections)) == PEOPLE
