"""Windows about false boxes: which boxes are false, what is shown, and how often."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.datamodules import mining
from tsuiseki.datamodules.augmentation import Augmentation
from tsuiseki.datamodules.detection_data import NO_COMPOSITION, DetectionData, TrainingExamples
from tsuiseki.datamodules.footage import Footage, Source
from tsuiseki.datamodules.mining import FalseBoxes, Mining, is_false, mine
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import Detections, ImageArray

SIZE = (48, 64)
PLAIN = Augmentation(aspect=0, rotation=0, shear=0, flip=0, colour=0, grey=0, blur=0, noise=0, compression=0, holes=0)


class Fooled:
    """Takes whatever is green for a person, and is right about red."""

    input_size = (120, 160)

    def detect(self, images: Sequence[ImageArray]) -> list[Detections]:
        return [self._look(image) for image in images]

    def _look(self, image: ImageArray) -> Detections:
        boxes = [[20.0, 40, 40, 100]]
        if image[..., 1].max() > 200:
            rows, columns = np.nonzero(image[..., 1] > 150)
            boxes.append([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
        return Detections(np.array(boxes, dtype=np.float64), np.array([0.9, 0.6])[: len(boxes)])


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """Six frames with a red person at the left; the third also has a green thing at the right."""
    folder = tmp_path / "place"
    (folder / "img1").mkdir(parents=True)
    (folder / "gt").mkdir()
    for n in range(6):
        image = np.full((120, 160, 3), 90, dtype=np.uint8)
        image[40:100, 20:40] = (30, 30, 200)
        if n == 2:
            image[60:80, 130:144] = (30, 220, 30)
        cv2.imwrite(str(folder / "img1" / f"{n + 1:06d}.png"), image)
    (folder / "gt" / "gt.txt").write_text("".join(f"{n + 1},1,21,41,20,60,1,1,1\n" for n in range(6)))
    return folder


@pytest.fixture
def fooled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mining, "open_detector", lambda *_: Fooled())


def examples(place: Path, share: float, length: int = 40, *, as_seen: bool = True) -> TrainingExamples:
    footage = [Footage(Source(str(place))), Footage(Source(str(place), (4, 6)))]
    return TrainingExamples(footage, length, SIZE, PLAIN, NO_COMPOSITION, 3, Mining("any", share, as_seen=as_seen))


def heights_of_green(seen: TrainingExamples) -> list[int]:
    """Rows of each example in which what fooled the detector is seen."""
    images = [seen[n].image for n in range(len(seen))]
    green = [(image[..., 1] > 150) & (image[..., 0] < 90) for image in images]
    return [int(g.any(axis=1).sum()) for g in green]


def test_what_meets_no_label_is_false() -> None:
    labels = np.array([[0.0, 0, 10, 30], [50, 0, 90, 60]])
    found = np.array(
        [
            [0.0, 0, 10, 28],  # who is there
            [6, 0, 16, 30],  # a quarter of him and the ground beside him
            [55, 5, 70, 50],  # within what is ignored
            [86, 5, 100, 50],  # mostly beside it
            [20, 0, 30, 30],
        ]
    )
    wrong = is_false(Detections(found, np.full(5, 0.5)), labels, np.array([False, True]))
    assert wrong.tolist() == [False, True, False, True, True]


@pytest.mark.usefixtures("fooled")
def test_false_boxes_are_found_with_their_scores_and_as_large_as_the_detector_saw_them(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found, nothing = mine([Footage(Source(str(place))), Footage(Source(str(place), (4, 6)))], Mining("any"))
    assert found.images.tolist() == [2]
    assert found.sizes.tolist() == [[120, 160]]
    assert found.middles.tolist() == [[137.0, 70.0]]
    assert found.scores.tolist() == [0.6]
    assert found.scales.tolist() == [1.0]
    assert len(nothing) == 0
    assert capsys.readouterr().out == "mined 1 false boxes of any in 9 training pictures\n"


@pytest.mark.usefixtures("fooled")
def test_windows_lie_about_what_fooled_the_detector(place: Path) -> None:
    tall = heights_of_green(examples(place, 0.99, 30))
    # 20 pixels where the detector saw it, give or take a quarter, less where it reaches beyond the window.
    assert min(tall) > 0
    assert 20 / 1.25 <= np.median(tall) <= max(tall) <= 20 * 1.25 + 1
    # The whole picture fits into the input at 0.4 of that; augmentation enlarges by 0.6 to 1.8.
    free = heights_of_green(examples(place, 0.99, 30, as_seen=False))
    assert min(free) > 0
    assert 20 * 0.4 * 0.6 <= np.median(free) <= 20 * 0.4 * 1.8


@pytest.mark.usefixtures("fooled")
def test_so_many_examples_are_mined_and_the_same_each_time(place: Path) -> None:
    first, second = examples(place, 0.5, 200), examples(place, 0.5, 200)
    green = np.array(heights_of_green(first)) > 0
    # Chance alone shows it in a sixth of half of the others, or fewer.
    assert 0.4 < np.mean(green) < 0.68
    assert all(np.array_equal(first[n].image, second[n].image) for n in range(20))


@pytest.mark.parametrize("mining", [Mining("", 0.5), Mining("any", 0.0)])
def test_without_a_detector_or_a_share_nothing_is_mined_and_examples_are_as_before(place: Path, mining: Mining) -> None:
    plain = TrainingExamples([Footage(Source(str(place)))], 8, SIZE, PLAIN, NO_COMPOSITION, 3)
    unmined = TrainingExamples([Footage(Source(str(place)))], 8, SIZE, PLAIN, NO_COMPOSITION, 3, mining)
    assert all(np.array_equal(plain[n].image, unmined[n].image) for n in range(8))


@pytest.mark.usefixtures("fooled")
def test_what_is_never_shown_is_not_mined(place: Path) -> None:
    footage = [Footage(Source(str(place), share=0.0)), Footage(Source(str(place)))]
    mined = TrainingExamples(footage, 8, SIZE, PLAIN, NO_COMPOSITION, 3, Mining("any", 0.5))
    assert [which for which, _ in mined.mined] == [1]
    assert mined.mined_weights.tolist() == [1.0]


def test_the_surer_a_false_box_the_more_often_it_comes() -> None:
    sizes = np.array([[120, 160]] * 2)
    boxes = FalseBoxes(np.array([0, 5]), sizes, np.zeros((2, 2)), np.ones(2), np.array([0.2, 0.8]))
    rng = np.random.default_rng(0)
    drawn = [boxes.draw(rng, SIZE, PLAIN)[0] for _ in range(400)]
    assert np.mean(np.array(drawn) == 5) == pytest.approx(0.8, abs=0.06)


@pytest.mark.usefixtures("fooled")
def test_a_detector_that_is_never_wrong_is_told(place: Path) -> None:
    with pytest.raises(RequestError, match=r"expected false boxes of any with a score of 0.2 or more .*, got none"):
        mine([Footage(Source(str(place), (4, 6)))], Mining("any"))


@pytest.mark.parametrize("given", [{"share": 1.0}, {"share": -0.1}, {"lowest_score": 0.0}, {"lowest_score": 1.0}])
def test_shares_and_scores_are_such(given: dict[str, float]) -> None:
    with pytest.raises(RequestError, match=r"mining: expected a share in \[0, 1\) and a lowest score in \(0, 1\)"):
        Mining("people", **given)


def test_a_detector_that_is_not_there_is_told_before_the_first_step(place: Path) -> None:
    source = Source(str(place))
    with pytest.raises(RequestError, match=r"nowhere\.onnx"):
        DetectionData([source], [source], height=48, width=64, mining=Mining("nowhere.onnx")).setup("fit")
