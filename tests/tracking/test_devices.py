"""CUDA that works, does not load, fails, or is not there: what runs, and what is said; onnxruntime's GPU is played."""

import json
import warnings

import numpy as np
import onnxruntime
import pytest

import tsuiseki
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.devices import CPU, CUDA
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.features.exported import Appearance, Detector

OFFERED = ["TensorrtExecutionProvider", CUDA, CPU]
IMAGE = np.zeros((48, 64, 3), np.uint8)


@pytest.fixture(params=["works", "does not load", "fails"])
def cuda(request, monkeypatch):
    """How CUDA behaves; and the lists of providers that sessions were asked for."""
    real, asked = onnxruntime.InferenceSession, []

    def create(path, options, providers, enable_fallback):
        asked.append(providers)
        assert not enable_fallback
        if request.param == "fails" and CUDA in providers:
            raise RuntimeError("CUDA failure 100: no CUDA-capable device is detected")
        session = real(path, options, providers=[CPU])
        if request.param == "works":
            session.get_providers = lambda: providers
        return session

    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: OFFERED)
    monkeypatch.setattr(onnxruntime, "InferenceSession", create)
    monkeypatch.setattr(onnxruntime, "preload_dlls", lambda: print("Failed to load libcudart.so"), raising=False)
    return request.param, asked


def test_auto_takes_cuda_where_it_works_and_says_where_it_does_not(inputs, cuda, capfd):
    how, asked = cuda
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        detector = Detector(inputs.detector)
    assert asked[0] == [CUDA, CPU]
    assert detector.device == ("cuda" if how == "works" else "cpu")
    assert len(detector.detect([IMAGE])[0]) == 1
    reason = {"works": [], "does not load": ["CUDA or cuDNN is missing"], "fails": ["no CUDA-capable device"]}[how]
    assert [one.category for one in said] == [InputWarning] * len(reason)
    assert all(
        r in str(one.message) and "run on the CPU" in str(one.message) for r, one in zip(reason, said, strict=True)
    )
    assert capfd.readouterr() == ("", "")


def test_cuda_that_is_asked_for_runs_or_is_refused_in_one_line(inputs, cuda, capsys, tmp_path):
    how, _ = cuda
    status = main([*inputs.words(), "--device", "cuda", "--out", str(tmp_path / "out")])
    out, said = capsys.readouterr()
    if how == "works":
        assert status == 0
        assert "networks run on cuda\n" in out
        assert json.loads((tmp_path / "out" / "run.json").read_text())["facts"]["device"] == "cuda"
    else:
        assert status == 2
        assert said.count("\n") == 1
        assert "--device: onnxruntime" in said
        assert "cannot use the GPU: " in said
        assert "use-a-gpu.md, or take cpu" in said


@pytest.mark.slow
def test_a_run_that_goes_over_to_the_cpu_says_one_line_and_run_json_says_what_ran(inputs, cuda, capsys, tmp_path):
    assert main([*inputs.words(), "--out", str(tmp_path / "out")]) == 0
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    works = cuda[0] == "works"
    assert record["facts"]["device"] == ("cuda" if works else "cpu")
    assert capsys.readouterr().err.count("cannot use the GPU") == (0 if works else 1)


@pytest.mark.slow
def test_cpu_leaves_the_gpu_alone(inputs, cuda):
    result = tsuiseki.track_people(inputs.video, detector=inputs.detector, appearance=inputs.appearance, device="cpu")
    assert result.facts["device"] == "cpu"
    assert cuda[1]
    assert all(providers == [CPU] for providers in cuda[1])


def test_costs_stay_on_the_cpu(inputs, cuda):
    asked = cuda[1]
    tsuiseki.track_people(inputs.video, detections=inputs.detections, appearance="none", affinity=inputs.affinity)
    assert asked
    assert all(providers == [CPU] for providers in asked)


@pytest.mark.parametrize("open_network", [lambda i, d: Detector(i.detector, device=d),
                                          lambda i, d: Appearance(i.appearance, device=d),
                                          lambda i, d: tsuiseki.track_people(i.video, device=d)])  # fmt: skip
def test_devices_that_are_not_there_are_refused(inputs, open_network):
    with pytest.raises(RequestError, match=r"expected an onnxruntime with CUDA, got .*use-a-gpu.md"):
        open_network(inputs, "cuda")
    with pytest.raises(RequestError, match=r"expected '?auto'?(, | or )'?cpu'?,? or '?cuda'?, got 'gpu'"):
        open_network(inputs, "gpu")
