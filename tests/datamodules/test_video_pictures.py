"""Frames of a labelled video file are read as pictures, in any order, and nothing is written."""

from __future__ import annotations

import multiprocessing
import pickle
from pathlib import Path

import lightning
import numpy as np
import pytest

from tests.trainers.test_lightning import detector, trainer
from tsuiseki.datamodules import training_images, video_pictures
from tsuiseki.datamodules.detector import DetectionData
from tsuiseki.datamodules.labelled_images import labelled_images
from tsuiseki.datamodules.training_images import TrainingImages, TrainingSource
from tsuiseki.datamodules.video_pictures import OpenVideo, VideoPicture, picture_size, read_image
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.people.api import track_people
from tsuiseki.tracking.types import ImageArray
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.source import SeekableVideo, UnfitIndexError, open_source
from tsuiseki.tracking.video.webm import VideoWriter

FRAMES = 60
SIZE = (128, 96)


@pytest.fixture(scope="module")
def labelled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result of a video file: somebody who walks, and somebody who stands."""
    folder = tmp_path_factory.mktemp("filmed")
    with VideoWriter(folder / "clip.webm", 12.0) as writer:
        for number in range(FRAMES):
            image = np.full((SIZE[1], SIZE[0], 3), 60, np.uint8)
            image[30:70, 4 + number : 20 + number] = 200
            image[20:44, 108:118] = 230
            writer.write(image)
    boxes = [np.array([[4 + n, 30, 20 + n, 70, 0.9], [108, 20, 118, 44, 0.9]]) for n in range(FRAMES)]
    track_people(folder / "clip.webm", detections=boxes, appearance="none").save(folder / "result")
    # Somebody has reviewed it, so that it is labels.
    (folder / "result" / "corrections.jsonl").write_text("")
    return folder


@pytest.fixture(scope="module")
def images(labelled: Path) -> list[ImageArray]:
    return [frame.image for frame in open_source(labelled / "clip.webm").frames()]


def opened(labelled: Path, last: int = FRAMES - 1) -> OpenVideo:
    return OpenVideo(labelled / "clip.webm", FrameRange(0, last))


ORDERS = {"rising": range(FRAMES), "falling": range(59, 0, -7), "at random": [3, 58, 4, 4, 40, 59, 0, 33]}


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("how", ["entered anywhere", "from the beginning", "by wrong packets"])
def test_each_frame_is_that_of_the_whole_file(
    order: str, how: str, labelled: Path, images: list[ImageArray], monkeypatch: pytest.MonkeyPatch
) -> None:
    def unfit(*_: object) -> None:
        raise UnfitIndexError("no")

    if how == "from the beginning":
        monkeypatch.setattr(SeekableVideo, "of", lambda _: None)
    video = opened(labelled)
    assert video.seekable == (how != "from the beginning")
    if how == "by wrong packets":
        monkeypatch.setattr(SeekableVideo, "frames", lambda *_: (unfit() for _ in range(1)))
    for number in ORDERS[order]:
        np.testing.assert_array_equal(read_image(VideoPicture(video, number)), images[number])
    assert picture_size(VideoPicture(video, 0)) == SIZE


def test_rising_frames_are_decoded_once(labelled: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entered = []
    frames = SeekableVideo.frames
    monkeypatch.setattr(SeekableVideo, "frames", lambda self, *span: entered.append(span) or frames(self, *span))
    video = opened(labelled)
    for number in range(0, FRAMES, 3):
        video.read(number)
    assert entered == [(0, FRAMES - 1)]


def _read(video: OpenVideo, number: int, queue: multiprocessing.Queue[ImageArray]) -> None:
    queue.put(video.read(number))


def test_other_processes_have_their_own_place_in_the_file(labelled: Path, images: list[ImageArray]) -> None:
    video = opened(labelled)
    video.read(10)
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    process = context.Process(target=_read, args=(video, 30, queue))
    process.start()
    np.testing.assert_array_equal(queue.get(timeout=60), images[30])
    process.join(60)
    np.testing.assert_array_equal(video.read(11), images[11])
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(video)).read(12), images[12])


def test_training_on_a_video_file_writes_no_file(
    labelled: Path, images: list[ImageArray], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    before = sorted(labelled.rglob("*"))
    samples = labelled_images(labelled / "result")
    assert len(samples) == FRAMES
    np.testing.assert_array_equal(read_image(samples[7].picture), images[7])
    assert str(samples[7].picture).endswith("clip.webm, frame 8")
    training: lightning.Trainer = trainer(tmp_path, fast_dev_run=True)
    training.fit(detector(), DetectionData(labelled / "result", batch_size=2, batches=1, workers=0))
    assert list(tmp_path.iterdir()) == []
    assert sorted(labelled.rglob("*")) == before


def test_what_does_not_fit_into_memory_is_decoded_as_it_is_asked_for(
    labelled: Path, images: list[ImageArray], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training_images, "_MEMORY", 1000)
    source = TrainingSource(str(labelled / "result"))
    kept = TrainingImages(source)
    for number in (50, 3):
        np.testing.assert_array_equal(kept.example(number).image, images[number])
    monkeypatch.setattr(video_pictures.SeekableVideo, "of", lambda _: None)
    with pytest.raises(
        RequestError, match=r"clip\.webm: expected a video that can be entered anywhere, .* as MP4, say"
    ):
        TrainingImages(source)


def test_a_video_that_is_shorter_than_its_labels_is_refused(labelled: Path) -> None:
    with pytest.raises(RequestError, match=r"expected .*frames"):
        opened(labelled, last=200)


def test_a_folder_is_no_video_file(labelled: Path) -> None:
    (labelled / "empty").mkdir(exist_ok=True)
    with pytest.raises(RequestError):
        OpenVideo(labelled / "empty", FrameRange(0, 3))
