"""Networks in formats of OpenVINO: read, run, ended and refused as those in ONNX are."""

from __future__ import annotations

import subprocess
import sys
import threading

import numpy as np
import pytest

from tsuiseki.tracking import openvino_session
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import as_describer, open_detector
from tsuiseki.tracking.features.foreign_options import AppearanceOptions, DetectorOptions
from tsuiseki.tracking.onnx import open_session, run_session
from tsuiseki.tracking.openvino_session import OpenvinoSession

openvino = pytest.importorskip("openvino")


def saved(path, build, shape=(1, 3, 64, 96)):
    """A network in OpenVINO's format whose output is ``build`` of its input."""
    from openvino import opset8 as ops

    image = ops.parameter(shape, np.float32, name="image")
    model = openvino.Model([build(ops, image)], [image], "made")
    openvino.save_model(model, path, compress_to_fp16=False)
    return path


def rows(values):
    """Builds a network that gives these rows (N, 7) for any picture."""

    def build(ops, image):
        nothing = ops.multiply(ops.reduce_mean(image, np.array([1, 2, 3]), keep_dims=True), np.float32(0))
        return ops.add(nothing, np.array(values, np.float32)[None, None])

    return build


def test_rows_of_intels_detectors_are_read(tmp_path):
    found = [[0, 1, 0.9, 0.25, 0.5, 0.5, 1], [0, 2, 0.9, 0, 0, 1, 1], [-1, 0, 0, 0, 0, 0, 0], [0, 1, 0.9, 0, 0, 1, 1]]
    detector = open_detector(saved(tmp_path / "ours.xml", rows(found)), options=DetectorOptions(person=1))
    assert (detector.layout, detector.input.colour, detector.input.pixels) == ("openvino", "BGR", "bytes")
    (detections,) = detector.detect([np.zeros((128, 192, 3), np.uint8)])
    np.testing.assert_allclose(detections.boxes, [[48, 64, 96, 128]], atol=1e-3)
    np.testing.assert_allclose(detections.scores, [0.9])


def test_an_appearance_network_is_read(tmp_path):
    def means(ops, image):
        return ops.reduce_mean(image, np.array([2, 3]), keep_dims=False)

    file = saved(tmp_path / "ours.xml", means, (1, 3, 24, 12))
    describer = as_describer(
        file, options=AppearanceOptions(colour="BGR", pixels="bytes", mean=(0, 0, 0), std=(1, 1, 1))
    )
    image = np.zeros((50, 50, 3), np.uint8)
    image[..., 0] = 200
    np.testing.assert_allclose(describer.describe(image, np.array([[5.0, 5, 20, 40]])), [[0, 0, 1]], atol=1e-6)


def test_pictures_with_channels_last_are_taken_with_channels_first(tmp_path):
    file = saved(tmp_path / "ours.xml", lambda ops, image: ops.relu(image), (1, 8, 8, 3))
    session = open_session(file, threads=1)
    assert session.get_inputs()[0].shape == [1, 3, 8, 8]
    image = np.random.default_rng(0).random((1, 3, 8, 8)).astype(np.float32)
    (output,) = run_session(session, file, {session.get_inputs()[0].name: image})
    np.testing.assert_array_equal(output, image.transpose(0, 2, 3, 1))


def test_calls_at_once_do_not_mix(tmp_path):
    file = saved(tmp_path / "ours.xml", lambda ops, image: ops.relu(image))
    session = open_session(file, threads=1)
    name, outputs = session.get_inputs()[0].name, {}

    def run(n):
        outputs[n] = run_session(session, file, {name: np.full((1, 3, 64, 96), n, np.float32)})[0]

    threads = [threading.Thread(target=run, args=(n,)) for n in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all((outputs[n] == n).all() for n in range(8))


def test_a_call_ends_in_time(tmp_path):
    def slow(ops, image):
        product = image
        for _ in range(200):
            product = ops.matmul(image, product, False, False)
        return product

    file = saved(tmp_path / "ours.xml", slow, (1, 3, 256, 256))
    session = open_session(file, threads=1)
    with pytest.raises(RequestError, match=r"expected the network to end within 0.01 s"):
        run_session(session, file, {session.get_inputs()[0].name: np.zeros((1, 3, 256, 256), np.float32)}, seconds=0.01)


def test_what_cannot_be_read_is_said_in_one_line(tmp_path):
    file = saved(tmp_path / "ours.xml", lambda ops, image: ops.relu(image))
    with pytest.raises(RequestError, match=r"`device`: expected auto or cpu, for .* runs on the CPU only, got cuda"):
        open_session(file, device="cuda")
    with pytest.raises(RequestError, match=r"none.tflite, found no .*none.tflite"):
        open_session(tmp_path / "none.tflite")
    (tmp_path / "ours.bin").unlink()
    with pytest.raises(RequestError, match=r"ours.xml, found no .*ours.bin; keep its files together"):
        open_session(file)
    for name in ("bad.tflite", "bad.pb", "bad.xml"):
        (tmp_path / name).write_bytes(b"nothing" * 9)
        (tmp_path / "bad.bin").write_bytes(b"")
        with pytest.raises(RequestError, match=r"is not a readable network; OpenVINO says: "):
            open_session(tmp_path / name)


def test_a_network_that_refuses_its_input_is_said_in_one_line(tmp_path):
    file = saved(tmp_path / "ours.xml", lambda ops, image: ops.relu(image))
    session = open_session(file, threads=1)
    with pytest.raises(RequestError, match=r"the network refuses its input; OpenVINO says: "):
        run_session(session, file, {session.get_inputs()[0].name: np.zeros((1, 3, 5, 5), np.float32)})


def test_without_openvino_the_extra_is_named(tmp_path, monkeypatch):
    (tmp_path / "ours.tflite").write_bytes(b"x")
    monkeypatch.setitem(sys.modules, "openvino", None)
    monkeypatch.setattr(openvino_session, "_core", openvino_session._core.__wrapped__)
    with pytest.raises(RequestError, match=r"needs openvino, .* pip install 'tsuiseki\[openvino\]'"):
        OpenvinoSession(tmp_path / "ours.tflite", 1)


# A process of its own: where this fails, the process ends.
AFTER_TWO = """
import signal, sys
from pathlib import Path
from tsuiseki.tracking.openvino_session import OpenvinoSession
first, second = (OpenvinoSession(Path(sys.argv[1]), 1) for _ in range(2))
del first
del second
signal.signal(signal.SIGINT, lambda *_: print("heard", flush=True))
signal.raise_signal(signal.SIGINT)
"""


def test_a_signal_is_heard_after_networks_were_opened_and_dropped(tmp_path):
    file = saved(tmp_path / "ours.xml", lambda ops, image: ops.relu(image))
    done = subprocess.run([sys.executable, "-c", AFTER_TWO, str(file)], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, "heard\n")
