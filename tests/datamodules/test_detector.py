"""From MOTChallenge folders to batches: sources, generated pictures, padding, epochs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from tsuiseki.datamodules import training_images
from tsuiseki.datamodules.augmentation import Example
from tsuiseki.datamodules.detector import (
    IGNORED,
    PADDING,
    PERSON,
    Composition,
    DetectionData,
    EpochSampler,
    collate,
)
from tsuiseki.datamodules.training_images import TrainingImages, TrainingSource, write_pictures
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.formats.mot_sequence import read_sequence


@pytest.fixture
def walker(tmp_path: Path) -> Path:
    """Ten frames of 160x120 with one person walking and one who counts for nothing."""
    folder = tmp_path / "walker"
    (folder / "img1").mkdir(parents=True)
    (folder / "gt").mkdir()
    rows = []
    for n in range(10):
        image = np.full((120, 160, 3), 110, dtype=np.uint8)
        x = 10 + 12 * n
        image[42:98, x + 3 : x + 17] = (40, 40, 160)
        cv2.imwrite(str(folder / "img1" / f"{n + 1:06d}.png"), image)
        rows += [f"{n + 1},1,{x + 1},41,20,60,1,1,1", f"{n + 1},2,101,1,10,30,0,8,1"]
    (folder / "gt" / "gt.txt").write_text("\n".join(rows) + "\n")
    return folder


def data(folder: Path, **changes: object) -> DetectionData:
    settings: dict[str, object] = {"height": 96, "width": 128, "batch_size": 4, "batches": 2, "workers": 0}
    train = [TrainingSource(str(folder), (1, 7), fixed_camera=True)]
    module = DetectionData(train, [TrainingSource(str(folder), (8, 10))], **(settings | changes))  # type: ignore[arg-type]
    module.setup("fit")
    return module


def test_videos_keep_frame_ranges_as_files_count_them(walker: Path) -> None:
    footage = TrainingImages(TrainingSource(str(walker), (8, 10)))
    assert len(footage) == 3
    assert footage.example(0).boxes[0].tolist() == [94.0, 40.0, 114.0, 100.0]
    assert footage.example(0).ignored.tolist() == [False, True]


def test_a_fixed_camera_gives_its_people_and_its_empty_view(walker: Path) -> None:
    footage = TrainingImages(TrainingSource(str(walker), fixed_camera=True))
    view = footage.views[0]
    assert sum(person is not None for people in footage.cutouts for person in people) == 10
    assert np.abs(view.background.image[60].astype(int) - 110).max() <= 2


def test_batches_have_the_promised_shapes(walker: Path) -> None:
    module = data(walker, composition=Composition(generated_people=3, most_people=4))
    batch = next(iter(module.train_dataloader()))
    assert batch.images.shape == (4, 96, 128, 3)
    assert batch.images.dtype == torch.uint8
    assert batch.boxes.shape == (*batch.labels.shape, 4)
    assert set(batch.labels.unique().tolist()) <= {PERSON, IGNORED, PADDING}
    real = batch.boxes[batch.labels != PADDING]
    assert (real[:, 2:] > real[:, :2]).all()
    assert real.min() >= 0
    assert (real <= torch.tensor([128, 96, 128, 96])).all()


def test_validation_images_are_fitted_as_for_the_exported_model(walker: Path) -> None:
    batch = next(iter(data(walker).val_dataloader()))
    assert batch.images.shape == (3, 96, 128, 3)
    # 160x120 into 128x96: everything by 0.8.
    assert batch.boxes[0, 0].tolist() == pytest.approx([75.2, 32.0, 91.2, 80.0])
    assert batch.labels[0].tolist() == [PERSON, IGNORED]


def test_padding_is_no_person() -> None:
    image = np.zeros((4, 4, 3), dtype=np.uint8)
    one = Example(image, np.array([[0.0, 0, 2, 2]]), np.array([False]))
    two = Example(image, np.array([[0.0, 0, 2, 2], [1, 1, 3, 3]]), np.array([True, False]))
    assert collate([one, two]).labels.tolist() == [[PERSON, PADDING], [IGNORED, PERSON]]


def test_same_seed_same_examples_and_no_example_twice(walker: Path) -> None:
    first, second, other = (data(walker, seed=s, composition=Composition(2)).training for s in (1, 1, 2))
    assert np.array_equal(first[3].image, second[3].image)
    assert not np.array_equal(first[3].image, other[3].image)
    assert not np.array_equal(first[3].image, first[11].image)


def test_epochs_go_on_where_the_last_one_ended() -> None:
    samplers = [EpochSampler(range(8), 2, rank, shuffle=False, drop_last=True) for rank in range(2)]
    seen = []
    for epoch in range(3):
        for sampler in samplers:
            sampler.set_epoch(epoch)
            seen += list(sampler)
    assert sorted(seen) == list(range(24))


def test_shares_say_where_examples_come_from(walker: Path) -> None:
    module = data(walker)
    module.sources["train"] = [
        TrainingSource(str(walker), (1, 3), share=3.0),
        TrainingSource(str(walker), (4, 7), share=1.0),
    ]
    module.setup("fit")
    assert module.training.shares.tolist() == [0.75, 0.25]


@pytest.mark.parametrize(
    ("scene", "given"),
    [
        ("street", {"things": True}),
        ("drone", {"town": True}),
        ("ceiling", {"photographs": "views"}),
        ("street", {"sprites": "people"}),
        ("drone", {"boxes": "steady"}),
    ],
)
def test_what_a_scene_does_not_show_is_refused(tmp_path: Path, scene: Any, given: dict[str, Any]) -> None:
    source = TrainingSource(str(tmp_path / "generated"), generate=1, scene=scene, **given)
    (name,) = given
    with pytest.raises(RequestError, match=f"expected `{name}` with a scene of people .*, got {scene}"):
        DetectionData([source], [source], height=48, width=64)


@pytest.mark.parametrize("scene", ["street", "ceiling"])
def test_no_sun_shines_where_the_scene_has_none(tmp_path: Path, scene: Any) -> None:
    source = TrainingSource(str(tmp_path / "generated"), generate=1, scene=scene, sun=0.5)
    with pytest.raises(RequestError, match=f"expected `sun` with a varied, .* or drone scene, got {scene}"):
        DetectionData([source], [source], height=48, width=64)


def test_shares_of_pictures_are_shares(tmp_path: Path) -> None:
    source = TrainingSource(str(tmp_path / "generated"), generate=1, scene="varied", sun=1.5)
    with pytest.raises(RequestError, match=r"expected `sun` as a share in \[0, 1\], got 1.5"):
        DetectionData([source], [source], height=48, width=64)


def test_steady_boxes_are_of_rendered_people(tmp_path: Path) -> None:
    source = TrainingSource(str(tmp_path / "generated"), generate=1, scene="varied", boxes="steady")
    with pytest.raises(RequestError, match="expected `sprites` with steady `boxes`, which are theirs, got none"):
        DetectionData([source], [source], height=48, width=64)


def test_a_source_without_people_is_refused_before_it_is_drawn(tmp_path: Path) -> None:
    source = TrainingSource(str(tmp_path / "generated"), generate=1, scene="lifeless")
    with pytest.raises(RequestError, match="expected a scene with people, such as everyday"):
        DetectionData([source], [source], height=48, width=64)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["varied", "drone"])
def test_pictures_in_the_sun_are_other_pictures_of_the_same_people(tmp_path: Path, scene: Any) -> None:
    for name, share in (("without", 0.0), ("with", 1.0)):
        source = TrainingSource(str(tmp_path / name), generate=1, scene=scene, size=(96, 64), seed=2, sun=share)
        DetectionData([source], [source], height=64, width=96).prepare_data()
    without, changed = (read_ground_truth(tmp_path / name / "gt" / "gt.txt") for name in ("without", "with"))
    np.testing.assert_array_equal(without.boxes, changed.boxes)
    pictures = [(tmp_path / name / "img1/000001.jpg").read_bytes() for name in ("without", "with")]
    assert pictures[0] != pictures[1]


@pytest.mark.slow
def test_pictures_are_generated_once_and_read_as_any_sequence(tmp_path: Path) -> None:
    folder = tmp_path / "generated"
    source = TrainingSource(str(folder), generate=3, seed=5)
    module = DetectionData([source], [source], height=48, width=64, batches=2, batch_size=1, workers=0)
    module.prepare_data()
    before = {p: p.stat().st_mtime_ns for p in folder.rglob("*")}
    module.prepare_data()
    assert before == {p: p.stat().st_mtime_ns for p in folder.rglob("*")}
    sequence = read_sequence(folder)
    assert (sequence.length, sequence.width, sequence.height) == (3, 64, 48)
    truth = read_ground_truth(sequence.ground_truth_path)
    assert len(np.unique(truth.ids)) == len(truth)
    module.setup("fit")
    assert next(iter(module.train_dataloader())).images.shape == (1, 48, 64, 3)


@pytest.mark.slow
def test_hidden_people_are_ignored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training_images, "LEAST_VISIBLE", 0.9)
    folder = tmp_path / "generated"
    write_pictures(TrainingSource(str(folder), generate=4, seed=1), (96, 72))
    truth = read_ground_truth(folder / "gt" / "gt.txt")
    footage = TrainingImages(TrainingSource(str(folder)))
    ignored = np.concatenate([footage.example(i).ignored for i in range(4)])
    assert ignored.sum() == (truth.visibility < 0.9).sum() > 0


def test_missing_sources_are_said(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="`train`: expected at least one folder of labelled video, got none"):
        DetectionData([], [TrainingSource("somewhere")])
    with pytest.raises(RequestError, match="expected a ground truth, a sequence folder"):
        TrainingImages(TrainingSource(str(tmp_path / "nothing")))


def test_an_image_that_is_none(walker: Path) -> None:
    (walker / "img1" / "000002.png").write_bytes(b"not an image")
    with pytest.raises(RequestError, match=r"000002.png.*cannot be decoded"):
        TrainingImages(TrainingSource(str(walker)))
