"""Identity crops, their augmentation and the P x K batches."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from tsuiseki.datamodules import appearance
from tsuiseki.datamodules.appearance import (
    AppearanceData,
    IdentityBatches,
    RenderedPeople,
    augment_crop,
    draw_camera,
)
from tsuiseki.datamodules.identity_crops import (
    IdentityCrops,
    crops_from_folder,
    cut_with_margin,
    join_crops,
    put_on_ground,
    read_crops,
    render_people,
    uncovered,
    write_crops,
)
from tsuiseki.datamodules.labelled_images import LabelledPart
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import crop_boxes
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.tracking.types.labels import GroundTruth


@pytest.fixture(scope="module")
def people() -> IdentityCrops:
    """Six rendered people, four views each."""
    return render_people(0, 6, 4, height=40)


@pytest.fixture
def sequence(tmp_path: Path) -> Path:
    """Two people of different grey who walk for ten frames; the second is half hidden in the last one."""
    folder, frames = tmp_path / "walk", 10
    boxes, visibility = np.empty((frames, 2, 4)), np.ones((frames, 2))
    visibility[-1, 1] = 0.5
    (folder / "img1").mkdir(parents=True)
    for t in range(frames):
        boxes[t] = [[5 + t, 10, 15 + t, 40], [60 - t, 12, 70 - t, 42]]
        image = np.full((60, 80, 3), 200, dtype=np.uint8)
        for box, grey in zip(boxes[t].astype(int), (50, 120), strict=True):
            image[box[1] : box[3], box[0] : box[2]] = grey
        cv2.imwrite(str(folder / "img1" / f"{t + 1:06d}.png"), image)
    yes = np.ones(2 * frames, dtype=np.bool_)
    ids = np.tile([3, 8], frames)
    truth = GroundTruth(np.repeat(np.arange(frames), 2), ids, boxes.reshape(-1, 4), yes, ~yes, visibility.ravel())
    write_ground_truth(folder / "gt" / "gt.txt", truth)
    write_sequence_info(folder, "walk", 10, frames, 80, 60)
    return folder


def test_crops_are_those_of_the_frame(sequence: Path) -> None:
    crops = crops_from_folder(sequence, (3, 5))
    assert len(crops) == 6
    assert sorted(set(crops.frames.tolist())) == [2, 3, 4], "frames of the request count from 1, of the crops from 0"
    image = np.asarray(cv2.imread(str(sequence / "img1" / "000003.png")))
    direct = crop_boxes(image, np.array([[7, 10, 17, 40.0]]), 64, 32)[0]
    np.testing.assert_array_equal(crop_boxes(crops.images[0], crops.boxes[:1], 64, 32)[0], direct)


def test_hidden_people_are_left_out(sequence: Path) -> None:
    assert len(crops_from_folder(sequence, None, least_visible=0.3)) == 20
    assert len(crops_from_folder(sequence, None, least_visible=0.6)) == 19


def test_share_that_nearer_people_leave_free() -> None:
    boxes = np.array([[0, 0, 10, 20], [5, 0, 15, 22], [100, 0, 110, 20.0]])
    np.testing.assert_allclose(uncovered(boxes), [0.5, 1, 1])


def test_margin_stops_at_the_border() -> None:
    image = np.zeros((50, 50, 3), dtype=np.uint8)
    cut, inner = cut_with_margin(image, np.array([0, 10, 10, 30.0]))
    assert cut.shape == (28, 12, 3)
    assert inner.tolist() == [0, 4, 10, 24]


def test_written_crops_come_back(people: IdentityCrops, tmp_path: Path) -> None:
    write_crops(tmp_path / "crops.npz", people)
    back = read_crops(tmp_path / "crops.npz")
    for image, again in zip(people.images, back.images, strict=True):
        np.testing.assert_array_equal(image, again)
    np.testing.assert_array_equal(people.ids, back.ids)
    assert list(tmp_path.iterdir()) == [tmp_path / "crops.npz"]


def test_foreign_cache(tmp_path: Path) -> None:
    (tmp_path / "crops.npz").write_text("nothing of the kind")
    with pytest.raises(RequestError, match="expected a cache of identity crops"):
        read_crops(tmp_path / "crops.npz")


def test_joined_people_stay_apart(people: IdentityCrops) -> None:
    both = join_crops([people, people])
    assert len(both) == 2 * len(people)
    assert len(np.unique(both.ids)) == 12


def test_rendered_people_are_cut_out(people: IdentityCrops) -> None:
    assert np.bincount(people.ids).tolist() == [4] * 6
    for image in people.images:
        assert image.shape[2] == 4
        assert 0.1 < (image[..., 3] > 128).mean() < 0.95
    again = render_people(0, 6, 4, height=40)
    assert all(np.array_equal(a, b) for a, b in zip(people.images, again.images, strict=True))


def test_ground_shows_around_the_person(people: IdentityCrops) -> None:
    cut_out = people.images[0]
    image, box = put_on_ground(np.random.default_rng(0), cut_out, None)
    x, y = box[:2].astype(int)
    inside = image[y : y + cut_out.shape[0], x : x + cut_out.shape[1]]
    solid = cut_out[..., 3] == 255
    np.testing.assert_allclose(inside[solid], cut_out[solid][:, :3], atol=1)


def test_no_augmentation_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    strengths = ("FLIP", "SHIFT", "STRETCH", "CAMERA_COLOUR", "VIEW_COLOUR", "BLUR", "JPEG", "OCCLUDE", "NOISE")
    for name, value in {**dict.fromkeys(strengths, 0.0), "LOWEST_HEIGHT": 64}.items():
        monkeypatch.setattr(appearance, name, value)
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (90, 50, 3)).astype(np.uint8)
    box = np.array([5, 9, 45, 81.0])
    camera = draw_camera(rng, 64)
    crop = augment_crop(rng, camera, image, box, image, (64, 32))
    # Sharpness, gamma and contrast are off at strength 0; levels may round down by one.
    np.testing.assert_allclose(crop.astype(int), crop_boxes(image, box[None], 64, 32)[0].astype(int), atol=1)


@pytest.mark.parametrize("kind", ["rendered", "video"])
def test_augmented_crops_keep_size_and_vary(people: IdentityCrops, kind: str) -> None:
    image, box = people.images[0], people.boxes[0]
    if kind == "video":
        image, box = put_on_ground(np.random.default_rng(0), image, None)
    crops = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        camera = draw_camera(rng, 64)
        crops.append(augment_crop(rng, camera, image, box, people.images[-1], (64, 32)))
    assert {crop.shape for crop in crops} == {(64, 32, 3)}
    assert {crop.dtype for crop in crops} == {np.dtype(np.uint8)}
    assert np.stack(crops).astype(float).std(axis=0).mean() > 10


def test_batches_hold_k_views_of_p_people(people: IdentityCrops) -> None:
    batches = list(IdentityBatches(people, 3, 4, 5, 0.5, lambda: (7,)))
    assert len(batches) == 5
    for batch in batches:
        ids = people.ids[[draw.view for draw in batch]]
        assert np.unique(ids, return_counts=True)[1].tolist() == [4, 4, 4]
        assert len({draw.view for draw in batch}) == 12, "no view twice where there are enough"


def test_batches_follow_the_seed(people: IdentityCrops) -> None:
    seeds = iter(3 * [(0, 0)] + 3 * [(0, 0)] + 3 * [(0, 1)])
    sampler = IdentityBatches(people, 2, 2, 3, 0.5, lambda: next(seeds))
    first, again, other = list(sampler), list(sampler), list(sampler)
    assert first == again
    assert first != other


def test_both_kinds_get_their_share(people: IdentityCrops) -> None:
    many = join_crops([people] * 5)
    video = IdentityCrops(people.images, people.boxes, people.ids, people.frames, np.ones(len(people), dtype=np.bool_))
    mixed = join_crops([many, video])
    batches = list(IdentityBatches(mixed, 4, 2, 200, 0.5, lambda: (0,)))
    share = np.mean([mixed.from_video[draw.view] for batch in batches for draw in batch])
    # 800 draws of 36 people, without replacement within a batch.
    assert share == pytest.approx(0.5, abs=0.08)


def test_module_mixes_video_and_rendered(sequence: Path, tmp_path: Path) -> None:
    data = AppearanceData(
        train=[LabelledPart(str(sequence), (1, 8))],
        rendered=RenderedPeople(tmp_path / "people.npz", identities=5, views=4, validation=2),
        height=32,
        width=16,
        batch_size=6,
        views=2,
        batches=2,
    )
    data.prepare_data()
    data.setup("fit")
    assert len(np.unique(data.train_crops.ids)) == 2 + 3
    assert data.train_crops.frames[data.train_crops.from_video].max() == 7
    first, again = next(iter(data.train_dataloader())), next(iter(data.train_dataloader()))
    assert first.images.shape == (6, 32, 16, 3)
    assert first.images.dtype == torch.uint8
    assert torch.equal(first.images, again.images)
    validation = next(iter(data.val_dataloader()))
    assert validation.query.tolist() == [True, False, False, False] * 2


def test_bad_requests(sequence: Path) -> None:
    with pytest.raises(RequestError, match="nothing to learn from"):
        AppearanceData()
    with pytest.raises(
        RequestError, match=r"expected at least 4 people, two to learn from and 2 to validate on, got 2"
    ):
        AppearanceData(sequence, height=32, width=16).setup("fit")
    with pytest.raises(RequestError, match=r"no frame lies within \(20, 30\)"):
        crops_from_folder(sequence, (20, 30))
    with pytest.raises(RequestError, match="at least 2 identities"):
        IdentityBatches(render_people(0, 1, 2, 30), 4, 2, 1, 0.5, lambda: (0,))
