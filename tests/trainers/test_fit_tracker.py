"""Training a Siamese tracker by its commands, exporting it, and going on from the exported file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.onnx import OnnxModel
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.exporting.export import load_module
from tsuiseki.trainers.tracker import Tracker


def words(folder: Path, *more: str) -> list[str]:
    """A training of two steps on small pictures."""
    data = ["batch_size=2", "batches=2", "validation=4", "search_side=127"]
    trainer = ["accelerator=cpu", "max_epochs=1", "num_sanity_val_steps=0"]
    groups = {"data": data, "trainer": trainer}
    return [f"--{g}.{word}" for g, values in groups.items() for word in values] + [f"--out={folder}", *more]


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished training, and of its exported files."""
    folder = tmp_path_factory.mktemp("tracker")
    assert main(["train", "tracker", *words(folder / "out", "--model.channels=16")]) == 0
    checkpoint = folder / "out" / "checkpoints" / "last.ckpt"
    assert main(["export", "tracker", "--checkpoint", str(checkpoint), "--out", str(folder / "tracker.onnx")]) == 0
    return folder


def heads(module: Tracker, template: np.ndarray, search: np.ndarray) -> list[np.ndarray]:
    """Scores and distances of uint8 pictures."""
    with torch.no_grad():
        logits, distances = module.eval()(torch.from_numpy(template), torch.from_numpy(search))
    return [logits.sigmoid().numpy(), distances.numpy()]


@pytest.fixture(scope="module")
def pictures() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return tuple(rng.integers(0, 256, (1, side, side, 3), dtype=np.uint8) for side in (127, 255))  # type: ignore[return-value]


@pytest.mark.slow
def test_the_files_give_what_was_trained(exported: Path, pictures: tuple[np.ndarray, np.ndarray]) -> None:
    files = [OnnxModel(exported / f"tracker_{part}.onnx", "tracker") for part in ("template", "search")]
    assert [file.card.settings["part"] for file in files] == ["template", "search"]
    assert [file.card.input_width for file in files] == [127, 255]
    assert [file.input_names for file in files] == [["template"], ["features", "search"]]
    assert files[1].output_names == ["scores", "boxes"]
    template, search = (
        np.moveaxis((images / 255 - file.card.mean) / file.card.std, -1, 1).astype(np.float32)
        for images, file in zip(pictures, files, strict=True)
    )
    (features,) = files[0].run(template)
    got = files[1].run(features, search)
    module = load_module(Tracker, exported / "out" / "checkpoints" / "last.ckpt")
    for expected, output in zip(heads(module, *pictures), got, strict=True):
        np.testing.assert_allclose(output, expected, rtol=1e-3, atol=1e-3)


@pytest.mark.slow
def test_a_training_goes_on_from_the_exported_file(
    exported: Path, pictures: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    """It begins as what was exported, normalisations included."""
    last = load_module(Tracker, exported / "out" / "checkpoints" / "last.ckpt")
    again = Tracker(start=exported / "tracker_search.onnx")
    assert again.network.channels == 16
    for expected, output in zip(heads(last, *pictures), heads(again, *pictures), strict=True):
        np.testing.assert_allclose(output, expected, rtol=1e-3, atol=1e-3)
    start = f"--model.start={exported / 'tracker_search.onnx'}"
    assert main(["train", "tracker", *words(tmp_path / "more", start, "--model.learning_rate=1e-9")]) == 0
    more = load_module(Tracker, tmp_path / "more" / "checkpoints" / "last.ckpt")
    # The statistics of the normalisations move with the pictures.
    assert all(np.isfinite(output).all() for output in heads(more, *pictures))


def test_the_trunk_of_an_appearance_network_is_taken_over() -> None:
    from tsuiseki.trainers.appearance import Appearance

    appearance, tracker = Appearance(start="people"), Tracker(start=shipped("appearance_people"))
    images = torch.rand(1, 3, 64, 64)
    with torch.no_grad():
        expected = appearance.eval().network.trunk(images)[1]
        got = tracker.eval().network.trunk[1](tracker.network.trunk[0](images))
    torch.testing.assert_close(got, expected, rtol=1e-3, atol=1e-3)


def test_refused_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RequestError, match=r"expected the …_search.onnx of a tracker.*got kind 'detector'"):
        Tracker(start=shipped("detector_street"))
    with pytest.raises(RequestError, match=r"`trunk`: expected that of the `start`"):
        Tracker(start=shipped("appearance_people"), trunk="resnet18")
    with pytest.raises(RequestError, match=r"expected an exported network at .*none\.onnx"):
        Tracker(start=tmp_path / "none.onnx")
    assert main(["train", "tracker", *words(tmp_path / "out", "--data.search_side=130")]) == 2
    message = capsys.readouterr().err.strip()
    assert "expected 16 k - 1 pixels" in message
    assert "\n" not in message
