"""Weights out of an exported detector: the network computes what the file does, and normalises in training."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tsuiseki.models.backbones import build_trunk
from tsuiseki.models.detector import people_detector
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.onnx import OnnxModel
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.detector_network import detector_card, take_over
from tsuiseki.trainers.exporting.export import export_onnx
from tsuiseki.trainers.exporting.exported_weights import exported_weights, layout_of, restore_normalisations
from tsuiseki.trainers.exporting.written_networks import RawHeads

SIZE = (64, 96)
ANCHORS = [[(9.0, 22.0)], [(25.0, 64.0)], [(52.0, 132.0)]]


def network():
    return people_detector(build_trunk("mobilenet_v3_small"), SIZE, ANCHORS, 24)


@pytest.mark.slow
def test_the_network_computes_what_the_file_does_before_and_after_its_normalisations_return(tmp_path):
    torch.manual_seed(0)
    trained = network()
    images = torch.randn(4, 3, *SIZE)
    for _ in range(5):
        trained(images)  # statistics that are not those of a fresh network
    path = tmp_path / "d.onnx"
    card = detector_card("people", SIZE, "letterbox", "imagenet")
    export_onnx(
        RawHeads(trained.eval(), (2.0, 0.5)), card, path, images[:2], ("logits", "offsets", "anchors"), float16=False
    )
    logits, offsets, _ = OnnxModel(path, "detector").run(images.numpy())
    again = network()
    take_over(again, path)
    restore_normalisations(again, images)
    for mode in (again.eval(), again.train()):
        with torch.no_grad():
            found, codes = mode(images)
        # The card of this file does not name the calibration, so only float sums differ; in training the statistics
        # of the batch are those that were stored.
        np.testing.assert_allclose(codes.numpy(), offsets, atol=2e-3)
        expected = (logits - [0, 0.5]) / 2
        np.testing.assert_allclose(np.diff(found.numpy()), np.diff(expected), atol=2e-3)


def test_the_layout_is_read_from_the_file():
    layout = layout_of(shipped("detector_street"))
    assert (layout.trunk, layout.size) == ("mobilenet_v3_small", (480, 640))
    assert [len(level) for level in layout.anchors] == [3, 2, 3]
    assert layout.anchors[0][0] == (9.0, 22.0)


def test_other_files_are_refused(tmp_path):
    with pytest.raises(RequestError, match="expected a detector"):
        layout_of(shipped("appearance_people"))
    (tmp_path / "no.onnx").write_bytes(b"no")
    with pytest.raises(RequestError, match="expected a network of `tsuiseki export`"):
        layout_of(tmp_path / "no.onnx")
    with pytest.raises(RequestError, match="expected a network of `tsuiseki export`"):
        exported_weights(tmp_path / "no.onnx")
