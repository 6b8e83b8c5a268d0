"""What is written is read again: tracks, labels, detections and what people say of them, in each format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.properties.drawn import boxes_of, new_folder, seeds, tracks_of
from tsuiseki.tracking.formats.acting_tracks import OKUTAMA_ACTIONS, read_acting_tracks, write_acting_tracks
from tsuiseki.tracking.formats.box_labels import read_kitti, write_kitti
from tsuiseki.tracking.formats.correction_log import (
    KINDS,
    Box,
    CorrectedVideo,
    Correction,
    CorrectionLog,
    append,
    read_corrections,
)
from tsuiseki.tracking.formats.exports import FORMATS, format_at, read_exported
from tsuiseki.tracking.formats.measurement_tables import (
    read_point_tracks,
    read_points,
    write_point_tracks,
    write_points,
)
from tsuiseki.tracking.formats.mot import (
    read_detections,
    read_ground_truth,
    read_tracks,
    write_detections,
    write_ground_truth,
    write_tracks,
)
from tsuiseki.tracking.formats.mot_sequence import read_sequence, write_sequence_info
from tsuiseki.tracking.formats.okutama import LABEL_SIZE, read_okutama, write_okutama
from tsuiseki.tracking.formats.rotated import RotatedBoxes, read_rotated_detections, write_rotated_detections
from tsuiseki.tracking.formats.single import read_boxes, write_boxes
from tsuiseki.tracking.formats.tracked_video import TrackedVideo, boxes_of_tracks
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import Detections, Track
from tsuiseki.tracking.types.labels import ActionLabels, GroundTruth
from tsuiseki.tracking.types.tracks import ActingTrack

LENGTH = 8
SIZE = (320, 240)
# Those that hold more than rows: the size and the length of the video, and names of any letters.
READ = [name for name, form in FORMATS.items() if form.read and name != "kitti"]
counts = st.integers(1, 4)


def with_classes(tracks: Sequence[Track], rng: np.random.Generator) -> list[Track]:
    """Tracks of which each is a person or a car, some of whose boxes no detection supports."""
    kinds = [(number, ("person", "car")[number]) for number in rng.integers(0, 2, len(tracks)).tolist()]
    origins = [
        np.column_stack([rng.integers(-1, 5, len(t)), np.full(len(t), n)])
        for t, (n, _) in zip(tracks, kinds, strict=True)
    ]
    return [
        replace(track, origin=origin, observed=origin[:, 0] >= 0, names={number: name})
        for track, origin, (number, name) in zip(tracks, origins, kinds, strict=True)
    ]


def assert_same_places(tracks: Sequence[Track], expected: Sequence[Track], pixels: float) -> None:
    """The same ids and frames, and boxes as near as a format has digits."""
    assert [track.id for track in tracks] == [track.id for track in expected]
    for track, other in zip(tracks, expected, strict=True):
        np.testing.assert_array_equal(track.frames, other.frames)
        np.testing.assert_allclose(track.boxes, other.boxes, atol=pixels)


@given(seed=seeds, count=st.integers(0, 4))
def test_motchallenge_results_come_back(seed: int, count: int) -> None:
    """Ids, frames, boxes, scores and classes of tracks are those that were written."""
    rng = np.random.default_rng(seed)
    tracks = with_classes(tracks_of(rng, count), rng)
    with new_folder() as folder:
        write_tracks(folder / "tracks.txt", tracks)
        back = read_tracks(folder / "tracks.txt")
    assert_same_places(back, tracks, 1e-3)
    for track, other in zip(back, tracks, strict=True):
        np.testing.assert_allclose(track.scores, other.scores, atol=1e-4)
        assert track.class_id == other.class_id


@given(seed=seeds, count=counts, visibility=st.lists(st.floats(-1, 2), min_size=4 * LENGTH, max_size=4 * LENGTH))
def test_motchallenge_labels_come_back(seed: int, count: int, visibility: list[float]) -> None:
    """Labels are those that were written; a visibility below 0 is not known, and one above 1 is the whole."""
    rows = boxes_of_tracks(tracks_of(np.random.default_rng(seed), count))
    evaluated = np.random.default_rng(seed).random(len(rows.ids)) < 0.7
    evaluated[0] = True
    visible = np.array(visibility[: len(rows.ids)])
    truth = GroundTruth(rows.frames, rows.ids, rows.boxes, evaluated, ~evaluated, visible)
    with new_folder() as folder:
        write_ground_truth(folder / "gt.txt", truth)
        back = read_ground_truth(folder / "gt.txt")
    for name in ("frames", "ids", "evaluated", "ignored"):
        np.testing.assert_array_equal(getattr(back, name), getattr(truth, name))
    np.testing.assert_allclose(back.boxes, truth.boxes, atol=1e-3)
    expected = [1.0 if value < 0 else min(value, 1.0) for value in visible.round(4)]
    np.testing.assert_allclose(back.visibility, expected, atol=1e-3)


@given(seed=seeds, frames=st.integers(1, 6), classes=st.booleans())
def test_motchallenge_detections_come_back(seed: int, frames: int, classes: bool) -> None:
    """Boxes, scores and classes of each frame are those that were written, empty frames among them."""
    rng, detections = np.random.default_rng(seed), []
    for number in rng.integers(0, 4, frames).tolist():
        kinds = rng.integers(0, 5, number) if classes else None
        detections.append(Detections(boxes_of(rng, number).round(2), rng.normal(size=number).round(4), classes=kinds))
    detections.append(Detections(boxes_of(rng, 1).round(2), np.ones(1), classes=np.ones(1) if classes else None))
    with new_folder() as folder:
        write_detections(folder / "det.txt", detections)
        back = read_detections(folder / "det.txt", len(detections))
    assert [len(frame) for frame in back] == [len(frame) for frame in detections]
    for frame, expected in zip(back, detections, strict=True):
        np.testing.assert_allclose(frame.boxes, expected.boxes, atol=1e-3)
        np.testing.assert_allclose(frame.scores, expected.scores, atol=1e-6)
        np.testing.assert_array_equal(frame.origin, expected.origin)


@pytest.mark.parametrize("name", READ)
@given(seed=seeds, count=counts)
def test_files_of_annotation_tools_come_back(name: str, seed: int, count: int) -> None:
    """Ids, frames, boxes and classes, the size and the length are those that were written."""
    rng = np.random.default_rng(seed)
    tracks = with_classes(tracks_of(rng, count, LENGTH), rng)
    with new_folder() as folder:
        path = folder / f"annotations{FORMATS[name].suffix}"
        if not FORMATS[name].suffix:
            path.mkdir()
        FORMATS[name].write(path, TrackedVideo(tracks, "street.mp4", 25.0, SIZE, LENGTH + 2))
        assert format_at(path) == name
        back = read_exported(path)
    assert (back.size, back.length) == (SIZE, LENGTH + 2)
    # YOLO has a millionth of the width.
    assert_same_places(back.tracks, tracks, 2e-3)
    assert back.kind == {track.id: track.class_name for track in tracks}
    for track, other in zip(back.tracks, tracks, strict=True):
        expected = np.full(len(other), other.scores.mean()) if name == "label-studio" else other.scores
        np.testing.assert_allclose(track.scores, expected, atol=1e-3)
        if name in ("coco", "cvat"):
            np.testing.assert_array_equal(track.observed, other.observed)


# Letters of any script, signs and spaces within; no control characters.
words = st.text(st.characters(categories=("L", "N", "P", "S")), min_size=1, max_size=8)
names = st.lists(words, min_size=1, max_size=3).map(" ".join)


@pytest.mark.parametrize("ending", [*READ, ".csv", ".json"])
@given(kind=names, video=names)
def test_names_come_back_in_any_script(ending: str, kind: str, video: str) -> None:
    """The name of a class is the one that was written, whatever signs are in it."""
    (track,) = tracks_of(np.random.default_rng(0), 1)
    track = replace(track, origin=np.tile([-1, 4], (len(track), 1)), names={4: kind})
    with new_folder() as folder:
        if ending.startswith("."):
            back = Result.load(Result([track], video).save(folder / f"result{ending}")).tracks
        else:
            path = folder / f"annotations{FORMATS[ending].suffix}"
            if not FORMATS[ending].suffix:
                path.mkdir()
            FORMATS[ending].write(path, TrackedVideo([track], video.replace("/", "-"), 25.0, SIZE, LENGTH))
            back = read_exported(path).tracks
    assert [other.class_name for other in back] == [kind]


@pytest.mark.parametrize("ending", [".csv", ".json", ".parquet", ""])
@given(seed=seeds, count=counts)
def test_results_come_back_to_the_last_bit(ending: str, seed: int, count: int) -> None:
    """A result saved and loaded has the same tracks; text has thousandths, the others all digits and the source."""
    pytest.importorskip("pyarrow" if ending == ".parquet" else "numpy")
    rng = np.random.default_rng(seed)
    tracks = with_classes(tracks_of(rng, count, digits=3), rng)
    result = Result(tracks, "street.mp4", 12.5, SIZE, {"fps": 2}, {"found": 3}, frames={"frame": list(range(LENGTH))})
    with new_folder() as folder:
        back = Result.load(result.save(folder / f"result{ending}"))
    assert_same_places(back.tracks, tracks, 0.0 if ending else 1e-3)
    if ending:
        assert back.tracks == tracks
    if ending in (".json", ".parquet"):
        kept = ("source", "frame_rate", "size", "settings", "facts")
        assert [getattr(back, name) for name in kept] == [getattr(result, name) for name in kept]
        assert list(back.frames["frame"]) == list(range(LENGTH))


@given(seed=seeds, count=counts)
def test_kittis_labels_come_back(seed: int, count: int) -> None:
    """People of tracks written for KITTI are read as labels that count, in the same places."""
    tracks = tracks_of(np.random.default_rng(seed), count)
    video = TrackedVideo(tracks, size=SIZE, length=LENGTH)
    with new_folder() as folder:
        write_kitti(folder / "0000.txt", video)
        back = read_kitti(folder / "0000.txt", LENGTH)
    np.testing.assert_array_equal(back.frames, video.boxes.frames)
    np.testing.assert_array_equal(back.ids, video.boxes.ids)
    np.testing.assert_allclose(back.boxes, video.boxes.boxes, atol=0.01)
    assert back.evaluated.all()


@given(seed=seeds, count=counts, size=st.sampled_from([(1280, 720), (3840, 2160), (640, 360)]))
def test_okutamas_labels_come_back(seed: int, count: int, size: tuple[int, int]) -> None:
    """Names, flags and actions are those that were written; boxes are rounded outwards to pixels of the large video."""
    rng = np.random.default_rng(seed)
    rows = boxes_of_tracks(tracks_of(rng, count))
    flags, actions = rng.random((3, len(rows.ids))) < 0.3, rng.random((len(rows.ids), len(OKUTAMA_ACTIONS))) < 0.2
    labels = ActionLabels(rows.frames, rows.ids, rows.boxes, *flags, actions, OKUTAMA_ACTIONS)
    with new_folder() as folder:
        write_okutama(folder / "labels.txt", labels, size)
        back = read_okutama(folder / "labels.txt", size)
    for name in ("frames", "ids", "lost", "occluded", "generated", "actions"):
        np.testing.assert_array_equal(getattr(back, name), getattr(labels, name))
    pixel = size[0] / LABEL_SIZE[0] + 1e-9
    grown = (back.boxes - labels.boxes)[~flags[0]] * [-1, -1, 1, 1]
    assert ((grown >= -1e-9) & (grown <= pixel)).all()


@given(seed=seeds, count=counts)
def test_what_people_do_comes_back(seed: int, count: int) -> None:
    """Tracks with probabilities of actions are those that were written."""
    rng = np.random.default_rng(seed)
    people = [ActingTrack(track, *rng.random((2, len(track), 3)).round(4)) for track in tracks_of(rng, count)]
    with new_folder() as folder:
        write_acting_tracks(folder / "actions.json", people, ("Walking", "Sitting", "Running"))
        back, names = read_acting_tracks(folder / "actions.json")
    assert names == ("Walking", "Sitting", "Running")
    assert_same_places([person.track for person in back], [person.track for person in people], 0.01)
    for person, expected in zip(back, people, strict=True):
        np.testing.assert_allclose(person.single, expected.single, atol=1e-3)
        np.testing.assert_allclose(person.multi, expected.multi, atol=1e-3)


@given(seed=seeds, frames=st.integers(1, 8))
def test_boxes_of_one_target_come_back(seed: int, frames: int) -> None:
    """OTB's text has each box; frames without one stay without."""
    rng = np.random.default_rng(seed)
    boxes = boxes_of(rng, frames)
    boxes[1:][rng.random(frames - 1) < 0.3] = np.nan
    with new_folder() as folder:
        write_boxes(folder / "boxes.txt", boxes)
        np.testing.assert_allclose(read_boxes(folder / "boxes.txt"), boxes, atol=1e-4)


@given(seed=seeds, images=st.integers(1, 3))
def test_turned_boxes_come_back(seed: int, images: int) -> None:
    """Boxes and scores of each image are those that were written, and angles the same but for half a turn."""
    rng, written = np.random.default_rng(seed), {}
    for k in range(images):
        boxes = np.column_stack([rng.uniform(10, 90, (3, 4)), rng.uniform(-4, 4, 3)])
        written[f"image{k}"] = RotatedBoxes(boxes, np.full(3, -1), rng.random(3))
    with new_folder() as folder:
        write_rotated_detections(folder / "boxes.json", written)
        back = read_rotated_detections(folder / "boxes.json")
    assert [*back] == [*written]
    for name, image in written.items():
        np.testing.assert_allclose(back[name].boxes[:, :4], image.boxes[:, :4], atol=1e-3)
        np.testing.assert_allclose(back[name].scores, image.scores, atol=1e-5)
        np.testing.assert_allclose(np.exp(2j * back[name].boxes[:, 4]), np.exp(2j * image.boxes[:, 4]), atol=1e-5)
        assert (np.abs(back[name].boxes[:, 4]) <= np.pi / 2).all()


@given(seed=seeds, count=counts)
def test_points_and_their_tracks_come_back(seed: int, count: int) -> None:
    """Centres of boxes are read as points of the same frames, and those of tracks with the same ids."""
    rng = np.random.default_rng(seed)
    tracks, detections = tracks_of(rng, count), [Detections(boxes_of(rng, n), np.ones(n)) for n in (2, 0, 3)]
    with new_folder() as folder:
        write_point_tracks(folder / "tracks.csv", tracks)
        write_points(folder / "points.csv", detections)
        frames, ids, places = read_point_tracks(folder / "tracks.csv")
        points = read_points(folder / "points.csv", 3)
    rows = boxes_of_tracks(tracks)
    np.testing.assert_array_equal(frames, rows.frames)
    np.testing.assert_array_equal(ids, rows.ids)
    np.testing.assert_allclose(places, centres(rows.boxes), atol=1e-3)
    for found, expected in zip(points, detections, strict=True):
        np.testing.assert_allclose(found, centres(expected.boxes), atol=1e-3)


@given(
    rate=st.floats(0.5, 240), length=st.integers(0, 9999), size=st.tuples(st.integers(1, 9999), st.integers(1, 9999))
)
def test_what_a_sequence_says_of_itself_comes_back(rate: float, length: int, size: tuple[int, int]) -> None:
    """Name, rate, length and size of a sequence without images are those that were written."""
    with new_folder() as folder:
        write_sequence_info(folder, "street-01", rate, length, *size)
        sequence = read_sequence(folder)
    assert (sequence.name, sequence.length, sequence.width, sequence.height) == ("street-01", length, *size)
    assert sequence.frame_rate == pytest.approx(rate, rel=1e-4)


def correction_of(rng: np.random.Generator) -> Correction:
    """Any correction but several at once."""
    kind = list(KINDS)[rng.integers(0, len(KINDS) - 1)]
    low, high, _ = KINDS[kind]
    count = int(rng.integers(low, min(high, 4) + 1))
    corners = np.column_stack([rng.uniform(0, 90, (count, 2)), rng.uniform(1, 50, (count, 2))]).round(2).tolist()
    frames = np.sort(rng.permutation(50)[:count]).tolist()
    return Correction(kind, tuple(Box(f, *box) for f, box in zip(frames, corners, strict=True)), str(rng.integers(9)))


@given(seed=seeds, actions=st.lists(st.sampled_from(["correct", "correct", "undo", "redo"]), max_size=8))
def test_corrections_come_back_in_any_portions(seed: int, actions: list[str]) -> None:
    """The log read from a file is that of all corrections, undone and repeated, in how many goes they were written."""
    rng, of = np.random.default_rng(seed), CorrectedVideo("street.mp4", SIZE, 50)
    done, undone = list[Correction](), list[Correction]()
    rows = [correction_of(rng) if action == "correct" else action for action in actions]
    with new_folder() as folder:
        path = folder / "corrections.jsonl"
        append(path, [], of)
        for row in rows:
            append(path, [row], of)
            if isinstance(row, Correction):
                done, undone = [*done, row], []
            elif row == "undo":
                undone += [done.pop()] if done else []
            else:
                done += [undone.pop()] if undone else []
        log = CorrectionLog(tuple(done), tuple(undone))
        assert read_corrections(path, of) == log
        append(folder / "at_once.jsonl", rows, of)
        assert read_corrections(folder / "at_once.jsonl", of) == log
