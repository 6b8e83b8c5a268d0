"""A detector with 8-bit numbers: smaller, nearly the same boxes, its cost in the card."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.datamodules.generated_pictures import write_scene_images
from tsuiseki.datamodules.scenes.training_pictures import TrainingSettings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.networks.exported import Detector
from tsuiseki.tracking.video.image_folder import read_image
from tsuiseki.trainers.exporting.export_int8 import quantise_detector

SHIPPED = Path(str(resources.files("tsuiseki.tracking") / "weights" / "detector_street.onnx"))


@pytest.mark.thesis_size
def test_8_bit_weights_keep_the_boxes_and_say_what_they_cost(tmp_path):
    pictures = tmp_path / "pictures"
    write_scene_images(pictures, 4, TrainingSettings(320, 240, people=(4, 8), person_height=(30, 120)), 5)
    before, after = quantise_detector(SHIPPED, tmp_path / "int8.onnx", pictures)
    card = Detector(tmp_path / "int8.onnx").model.card
    assert card.settings["int8"] is True
    assert (card.settings["ap50_float"], card.settings["ap50_int8"]) == (round(before, 4), round(after, 4))
    assert before > 0.3
    assert after > before - 0.1
    assert (tmp_path / "int8.onnx").stat().st_size < 0.8 * SHIPPED.stat().st_size
    image = read_image(pictures / "img1" / "000001.jpg")
    found = [Detector(path, 0.5).detect([image])[0] for path in (SHIPPED, tmp_path / "int8.onnx")]
    assert abs(len(found[0]) - len(found[1])) <= 2
    assert np.isfinite(found[1].boxes).all()
    with pytest.raises(RequestError, match="overwrite"):
        quantise_detector(SHIPPED, tmp_path / "int8.onnx", pictures)
