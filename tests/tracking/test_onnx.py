"""Models whose weights lie in files beside them, as `torch.onnx.export` writes them."""

import os
import shutil

import numpy as np
import onnx
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.drone.observations import file_digest
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import as_describer, open_detector
from tsuiseki.tracking.onnx import OnnxModel, open_session, weight_files
from tsuiseki.tracking.weights import shipped


def apart(path, folder, **how):
    """A copy of the model at ``path`` in ``folder`` with its weights beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    out = folder / path.name
    how = {"location": f"{path.name}.data", "size_threshold": 1024, **how}
    onnx.save_model(onnx.load(path), out, save_as_external_data=True, **how)
    assert weight_files(out)
    return out


def rows(model):
    shape = [n if isinstance(n, int) else 2 for n in model.session.get_inputs()[0].shape]
    return np.random.default_rng(0).random(shape, dtype=np.float32)


@pytest.mark.parametrize(
    ("kind", "name"),
    [("detector", "detector_street"), ("appearance", "appearance_people"), ("action", "action_drone_rgb_local")],
)
def test_every_kind_of_model_runs_with_weights_apart(tmp_path, kind, name):
    path = shipped(name)
    whole, parted = OnnxModel(path, kind), OnnxModel(apart(path, tmp_path), kind)
    given = rows(whole)
    for expected, got in zip(whole.run(given), parted.run(given), strict=True):
        np.testing.assert_array_equal(expected, got)


@pytest.mark.slow
def test_a_command_takes_models_with_weights_apart(street, tmp_path):
    parts = tmp_path / "models"
    for name, folder in {"whole": None, "parts": parts}.items():
        networks = [shipped("detector_street"), shipped("appearance_people")]
        detector, appearance = networks if folder is None else [apart(one, folder) for one in networks]
        given = ["--detector", str(detector), "--appearance", str(appearance), "--frames", "1-2"]
        assert main(["track", "people", str(street), *given, "--out", str(tmp_path / name)]) == 0
    assert (tmp_path / "whole/tracks.txt").read_bytes() == (tmp_path / "parts/tracks.txt").read_bytes()


@pytest.mark.parametrize("how", [{}, {"location": "weights/w.bin"}, {"all_tensors_to_one_file": False}])
def test_missing_and_short_weights_are_named_and_nothing_else_is_said(tmp_path, capfd, how):
    (tmp_path / "weights").mkdir()
    path = apart(shipped("appearance_people"), tmp_path, **how)
    files = weight_files(path)
    assert files
    assert all(file.is_file() for file in files)
    files[0].write_bytes(b"")
    with pytest.raises(RequestError, match=r"appearance_people.onnx is not a readable ONNX model; .*"):
        open_session(path)
    files[0].unlink()
    with pytest.raises(RequestError, match=f"appearance_people.onnx: expected its weights in {files[0]}, found none"):
        open_session(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("place", ["../secret.data", "/etc/passwd"])
def test_weights_outside_the_folder_are_refused(tmp_path, place):
    path = apart(shipped("appearance_people"), tmp_path / "m")
    model = onnx.load(path, load_external_data=False)
    for tensor in model.graph.initializer:
        for entry in tensor.external_data:
            entry.value = place if entry.key == "location" else entry.value
    path.write_bytes(model.SerializeToString())
    with pytest.raises(RequestError, match=f"expected its weights in its own folder, got {place}"):
        open_session(path)


def test_other_weights_are_another_model_for_the_cache(tmp_path):
    path = apart(shipped("appearance_people"), tmp_path)
    before = file_digest(path)
    assert file_digest(path) == before
    (file,) = weight_files(path)
    file.write_bytes(file.read_bytes()[::-1])
    assert file_digest(path) != before


def test_exports_of_others_with_weights_apart(data_folder, tmp_path):
    cases = data_folder / "cases" / "onnx"
    image = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    assert len(open_detector(cases / "ext_ok" / "v8.onnx").detect([image])) == 1
    features = as_describer(cases / "torchexp" / "reid.onnx").describe(image, np.array([[0, 0, 50, 99.0]]))
    assert features.shape == (1, 16)
    shutil.copy(cases / "ext_ok" / "v8.onnx", tmp_path)
    with pytest.raises(RequestError, match=r"v8.onnx: expected its weights in .*v8.onnx.data"):
        open_detector(tmp_path / "v8.onnx")


@pytest.mark.parametrize("how", [None, {}, {"location": "weights/w.bin"}])
def test_models_of_names_that_are_not_utf8_run(tmp_path, how):
    path, folder = shipped("appearance_people"), tmp_path / os.fsdecode(b"caf\xe9")
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("this file system takes names of UTF-8 only")
    if how is None:
        strange = shutil.copyfile(path, folder / os.fsdecode(b"m\xe9.onnx"))
    else:
        (tmp_path / "plain" / "weights").mkdir(parents=True)
        apart(path, tmp_path / "plain", **how)
        strange = shutil.copytree(tmp_path / "plain", folder / "copy") / path.name
    whole, other = OnnxModel(path, "appearance"), OnnxModel(strange, "appearance")
    crops = rows(whole)
    for expected, got in zip(whole.run(crops), other.run(crops), strict=True):
        np.testing.assert_array_equal(got, expected)
