"""`model.teacher`: a shipped file or a checkpoint teaches, one that does not fit is refused in one line."""

from __future__ import annotations

from pathlib import Path

import lightning
import numpy as np
import pytest
import torch

from tsuiseki.datamodules.detector import DetectionBatch
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.onnx import OnnxModel
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.detector import Detector
from tsuiseki.trainers.detector_network import Teacher
from tsuiseki.trainers.exporting.export import load_module
from tsuiseki.trainers.exporting.exported_weights import layout_of
from tsuiseki.trainers.network_module import normalised

TEACHER = shipped("detector_street")
ANCHORS = layout_of(TEACHER).anchors
SMALL = {"trunk": "mobilenet_v3_small", "channels": 16}


def student(size=(96, 128), anchors=ANCHORS, **changes) -> Detector:
    return Detector(**{**SMALL, "height": size[0], "width": size[1], "anchors": anchors, **changes})


def batch(size=(96, 128)) -> DetectionBatch:
    generator = torch.Generator().manual_seed(0)
    images = torch.randint(0, 256, (2, *size, 3), generator=generator).to(torch.uint8)
    return DetectionBatch(images, torch.tensor([[[20.0, 20.0, 40.0, 70.0]]] * 2), torch.ones(2, 1, dtype=torch.int64))


@pytest.mark.slow
def test_the_teacher_finds_what_its_file_does_before_the_calibration():
    module = student((480, 640), teacher=Teacher(TEACHER))
    images = normalised(torch.randint(0, 256, (1, 480, 640, 3), dtype=torch.uint8), module.card)
    logits, offsets, _ = OnnxModel(TEACHER, "detector").run(images.numpy())
    scale, shift = layout_of(TEACHER).card.settings["score_calibration"]
    found = module.teacher.targets(images)
    margin = (logits[..., 1] - logits[..., 0] - shift) / scale
    # Weights of the file are rounded to 16 bits, sums over a thousand channels differ in the last digits.
    np.testing.assert_allclose(found.scores.numpy(), 1 / (1 + np.exp(-margin)), atol=2e-3)
    np.testing.assert_allclose(found.offsets.numpy(), offsets, atol=2e-2)


def test_the_teacher_is_no_part_of_the_student():
    module = student(teacher=Teacher(Path("street")), start=Path("street"), channels=None)
    alone = student()
    assert module.state_dict().keys() == alone.state_dict().keys()
    assert len(list(module.parameters())) == len(list(alone.parameters()))


def loss_of(module: Detector) -> float:
    module.log_dict = lambda *_, **__: None
    return float(module.eval().training_step(batch(), 0).detach())


@pytest.mark.slow
def test_the_lesson_is_added_to_that_of_the_labels():
    losses = []
    for weight in (None, 0.0, 1.0, 2.0):
        lightning.seed_everything(0, verbose=False)
        taught = {} if weight is None else {"teacher": Teacher(TEACHER, weight)}
        losses.append(loss_of(student(loss="quality", **taught)))
    assert losses[1] == pytest.approx(losses[0], rel=1e-6)
    assert losses[2] > losses[1]
    assert losses[3] - losses[2] == pytest.approx(losses[2] - losses[1], rel=1e-4)


@pytest.mark.slow
def test_a_checkpoint_teaches_and_the_student_loads_without_it(tmp_path):
    teacher, path = student(), tmp_path / "teacher.ckpt"
    save(teacher, path)
    module = student(teacher=Teacher(path), trunk="mobilenet_v3_large")
    images = normalised(batch().images, module.card)
    found = module.teacher.targets(images)
    with torch.no_grad():
        _, offsets = teacher.network.eval()(images)
    assert torch.allclose(found.offsets, offsets, atol=1e-5)
    save(module, tmp_path / "student.ckpt")
    path.unlink()
    assert load_module(Detector, tmp_path / "student.ckpt").teacher is None


def save(module: Detector, path) -> None:
    trainer = lightning.Trainer(logger=False, enable_checkpointing=False, accelerator="cpu")
    trainer.strategy.connect(module)
    trainer.save_checkpoint(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"teacher": Teacher(Path("nowhere.onnx"))}, "expected a detector to teach at nowhere.onnx, found none"),
        ({"teacher": Teacher(shipped("appearance_people"))}, "expected a detector"),
        (
            {"teacher": Teacher(TEACHER), "anchors": [[(12, 28)], [(20, 50)], [(30, 60)]]},
            "with the anchors of the student",
        ),
        ({"teacher": Teacher(TEACHER), "normalisation": "symmetric"}, "normalised as the student"),
    ],
)
def test_a_teacher_that_does_not_fit_is_one_line(changes, message):
    with pytest.raises(RequestError, match=message) as caught:
        student(**changes)
    assert "\n" not in str(caught.value)


def test_a_broken_checkpoint_is_refused(tmp_path):
    path = tmp_path / "no.ckpt"
    path.write_bytes(b"no")
    with pytest.raises(RequestError, match="expected a checkpoint of `tsuiseki train`"):
        student(teacher=Teacher(path))
