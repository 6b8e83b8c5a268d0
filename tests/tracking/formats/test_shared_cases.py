"""Inputs that public reports say went wrong, in `cases` and `cases/round2` of the shared data, by their commands.

Each row of their tables has its id here, but for those that have a test of their own:

- ``calib``: ``test_lens_models.py::test_the_shared_cases``;
- ``onnx/ext_ok``, ``onnx/torchexp``: ``test_onnx.py``; ``onnx/nms_norm.onnx``: ``test_odd_boxes.py``;
- ``mot/nth/nNN``: ``test_inference_times.py``;
- ``video/drop.avi``: ``test_frame_source.py``; the pictures of ``01-video``: ``test_hard_files.py``;
- tracks and animals of ``03-count`` and ``animals``: ``test_changed_ids.py``, ``test_narrow_places.py``,
  ``test_sleap_hdf5.py``;
- ``06-training``: ``tests/trainers/test_fit_refusals.py``.
"""

from __future__ import annotations

import re
import shutil
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.formats.result_folder import read_folder
from tsuiseki.tracking.types import Track

pytestmark = pytest.mark.integration
# Where the square of the clips ends: x, y, width, height from 1, pixels.
LAST_BOX = (148, 119, 33, 33)


@pytest.fixture
def cases(data_folder: Path) -> Path:
    folder = data_folder / "cases"
    if not folder.is_dir():
        pytest.skip(f"no cases at {folder}")
    return folder


def said(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str]:
    """The status of a command, and what it prints, without ends of lines."""
    status = main([str(word) for word in words])
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    return status, " ".join((captured.err + captured.out).split())


PERFECT = r"1\.000 1\.000 1\.000 1\.000 1\.000 1\.000 0 0 0 1\.000 1\.000"
# Truth, result, and what is said: scores or one line.
EVALUATED = {
    "03-space-semicolons": ("text/03-space/gt.txt", "text/03-space/res_semi.txt", PERFECT),
    "03-space-tabs": ("text/03-space/gt.txt", "text/03-space/res_tab.txt", PERFECT),
    "03-space-truth": ("text/03-space/gt_space.txt", "text/03-space/res.txt", PERFECT),
    "06-ids-64-bits": ("text/06-ids/gt_big.txt", "text/06-ids/res_big.txt", PERFECT),
    "06-ids-float": ("text/06-ids/gt.txt", "text/06-ids/res_float.txt", PERFECT),
    "06-ids-1e19": ("text/06-ids/gt.txt", "text/06-ids/res_1e19.txt", "txt:1: expected a whole number of 64 bits"),
    "06-ids-fraction": ("text/06-ids/gt.txt", "text/06-ids/res_frac.txt", r"txt:2: expected a whole number .*'1\.4'"),
    "06-ids-fractions": ("text/06-ids/gt.txt", "text/06-ids/res_frac2.txt", r"txt:1: expected a whole number .*'1\.9'"),
    "06-ids-words": ("text/06-ids/gt.txt", "text/06-ids/res_uuid.txt", "txt:1: expected numbers .*'a3f-0'"),
    "06-ids-negative": ("text/06-ids/gt_neg.txt", "text/06-ids/res_big.txt", "expected an id of each box"),
    "07-enc-11-columns": ("text/07-enc/gt.txt", "text/07-enc/res_11col.txt", f"those after column 10 .*{PERFECT}"),
    "07-enc-blank-lines": ("text/07-enc/gt.txt", "text/07-enc/res_blank.txt", PERFECT),
    "07-enc-bom-crlf": ("text/07-enc/gt.txt", "text/07-enc/res_bom_crlf.txt", PERFECT),
    "07-enc-decimal-commas": ("text/07-enc/gt.txt", "text/07-enc/res_comma_dec.txt", f"decimal commas.*{PERFECT}"),
    "07-enc-comment": ("text/07-enc/gt.txt", "text/07-enc/res_comment.txt", PERFECT),
    "07-enc-cr": ("text/07-enc/gt.txt", "text/07-enc/res_cr.txt", PERFECT),
    "07-enc-empty": ("text/07-enc/gt.txt", "text/07-enc/res_empty.txt", "the result has no box; every score is 0"),
    "07-enc-heading": ("text/07-enc/gt.txt", "text/07-enc/res_header.txt", f"is a heading and left out.*{PERFECT}"),
    "07-enc-heading-alone": ("text/07-enc/gt.txt", "text/07-enc/res_onlyheader.txt", "the result has no box"),
    "07-enc-quotes": ("text/07-enc/gt.txt", "text/07-enc/res_quoted.txt", PERFECT),
    "07-enc-trailing": ("text/07-enc/gt.txt", "text/07-enc/res_trailing.txt", PERFECT),
    "07-enc-utf16": ("text/07-enc/gt.txt", "text/07-enc/res_utf16.txt", PERFECT),
    "07-enc-seqinfo-bom": ("text/07-enc/seqinfo_bom", "text/07-enc/res_cr.txt", PERFECT),
    "coco_ok": ("round2/02-labels/coco_ok.json", "round2/02-labels/res.txt", PERFECT),
    "coco_shuffled": ("round2/02-labels/coco_shuffled.json", "round2/02-labels/res.txt", PERFECT),
    "coco_nocat": (
        "round2/02-labels/coco_nocat.json", "round2/02-labels/res.txt",
        r"1 of 90 annotations are left out: 1 of category 7, which is not listed \(annotation 6\)",
    ),
    "coco_negw": (
        "round2/02-labels/coco_negw.json", "round2/02-labels/res.txt",
        r"1 of 90 annotations are left out: 1 without an area \(annotation 6\)",
    ),
    "ls_two": ("round2/02-labels/ls_two.json", "round2/02-labels/res.txt", "expected one annotation .*, got 2"),
    "cvat_rot": (
        "round2/02-labels/cvat_rot.xml", "round2/02-labels/res.txt",
        "90 turned, for which the upright boxes about them are taken",
    ),
    "cvatmot": ("round2/02-labels/cvatmot", "round2/02-labels/res_people.txt", PERFECT),
    "yolo_noid_some": (
        "round2/02-labels/yolo_noid_some", "round2/02-labels/res.txt", "3 of 90 .* left out: 3 without an id",
    ),
}  # fmt: skip
REFUSED = ("06-ids-1e19", "06-ids-fraction", "06-ids-fractions", "06-ids-words", "06-ids-negative", "ls_two")


@pytest.mark.parametrize("row", EVALUATED)
def test_labels_and_results(row: str, cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth, result, expected = EVALUATED[row]
    status, text = said(capsys, "evaluate", "people", cases / truth, cases / result)
    assert re.search(expected, text), text
    assert status == (2 if row in REFUSED else 0)


def test_detections_with_spaces(cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = cases / "text" / "03-space"
    status, text = said(capsys, "evaluate", "detection", folder / "gt.txt", folder / "det_space.txt")
    assert (status, re.search(r"det_space 1\.000 1\.000 1\.000 0\.900 20", text) is not None) == (0, True), text


# What the score is, and what is said, of people by boxes in files.
TRACKED = {
    "nth10": ("flow", 0.9, 1.0, "there are detections in 10 of 100 frames, every 10th one"),
    "lowfps2": ("flow", 1.0, 1.0, "2 people in 10 frames"),
    "score0": ("sort", 1.0, 1.0, "2 people in 100 frames"),
    "tiny": ("sort", 0.0, 0.0, "boxes are 0.01 x 0.02 pixels; expected pixels, not shares or metres"),
}


@pytest.mark.slow
@pytest.mark.parametrize("row", TRACKED)
def test_people_of_few_frames_and_odd_detections(
    row: str, cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    method, lowest, highest, expected = TRACKED[row]
    folder = cases / "mot" / row
    words = ["--method", method, "--detections", folder / "det" / "det.txt", "--out", tmp_path / "o"]
    status, text = said(capsys, "track", "people", folder, *words)
    assert (status, expected in text) == (0, True), text
    status, text = said(capsys, "evaluate", "people", folder, tmp_path / "o")
    hota = float(re.findall(rf" {row} o (\d\.\d+)", text)[0])
    assert (status, lowest <= hota <= highest) == (0, True), text


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dlc_unique.csv", "dlc_multi.csv", "an_default.h5", "an_standard.h5"])
def test_animals(name: str, cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = cases / "animals"
    status, text = said(
        capsys, "track", "animals", folder / "v.avi", "--points", folder / name, "--out", tmp_path / "o"
    )
    assert (status, "2 animals in 60 frames" in text) == (0, True), text
    assert ("corner1, corner2 are landmarks, no animal" in text) == (name == "dlc_unique.csv")


def single(source: object, out: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    return said(capsys, "track", "single", source, "--box", "31,41,32,32", "--out", out)


def boxes_in(out: Path) -> list[list[float]]:
    return [[float(value) for value in line.split(",")] for line in (out / "boxes.txt").read_text().splitlines()]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["base.mp4", "interlaced.mpg", "offset10.mkv"])
def test_one_target_in_odd_video(name: str, cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, text = single(cases / "round2" / "01-video" / name, tmp_path / "o", capsys)
    assert (status, "40 frames (40 tracking)" in text) == (0, True), text
    np.testing.assert_allclose(boxes_in(tmp_path / "o")[-1], LAST_BOX, atol=1.5)
    if name == "offset10.mkv":
        # It is base.mp4 with another first time.
        single(cases / "round2" / "01-video" / "base.mp4", tmp_path / "base", capsys)
        np.testing.assert_allclose(boxes_in(tmp_path / "o"), boxes_in(tmp_path / "base"), atol=0.05)


@pytest.mark.slow
def test_one_target_in_a_file_whose_name_is_no_utf8(
    cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "caf\udce9.mp4"
    shutil.copy(cases / "round2" / "01-video" / "base.mp4", path)
    status, text = single(path, tmp_path / "o", capsys)
    assert status == 0, text
    np.testing.assert_allclose(boxes_in(tmp_path / "o")[-1], LAST_BOX, atol=1.5)


@pytest.mark.slow
def test_one_of_two_streams_is_named(cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, text = single(cases / "round2" / "01-video" / "two_streams.mkv", tmp_path / "o", capsys)
    assert (status, "2 video streams, 1 of 160x120, 2 of 320x240 pixels: 1 is read" in text) == (0, True), text


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        """Nothing is printed."""


@pytest.fixture
def served(cases: Path) -> Iterator[str]:
    """The address of the folder of videos, as `python -m http.server` serves it."""
    handler = partial(Quiet, directory=str(cases / "round2" / "01-video"))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()
        thread.join()


@pytest.mark.slow
def test_a_finite_stream_ends(served: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, text = single(f"{served}/base.ts", tmp_path / "o", capsys)
    assert (status, len(boxes_in(tmp_path / "o"))) == (0, 40), text


def test_several_pages_of_an_image_are_refused(cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, text = single(cases / "images" / "multipage", tmp_path / "o", capsys)
    assert (status, "stack.tif: expected one image in a file, got 40" in text) == (2, True), text


def test_images_are_in_the_order_of_decimal_seconds(
    cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, text = single(cases / "round2" / "04-order-of-images" / "unixtime", tmp_path / "o", capsys)
    assert (status, "24 frames (24 tracking)" in text) == (0, True), text
    # The square moves evenly; out of order it would jump back.
    steps = np.diff(np.array(boxes_in(tmp_path / "o"))[:, 0])
    assert (np.abs(steps) < 6).all()


# Folder and scene, and what is said.
COUNTED = {
    "switch": ("switch", "scene.yaml", 0, "door in: 1 door out: 0"),
    "once": ("once", "scene.yaml", 0, "door in: 1 door out: 0"),
    "once-thin": ("once", "thin.yaml", 0, "band: 0.1 people on average .*, 1 at most"),
    "once-dup_line": ("once", "dup_line.yaml", 2, "got lines twice"),
}


@pytest.mark.slow
@pytest.mark.parametrize("row", COUNTED)
def test_counts(row: str, cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, scene, expected, line = COUNTED[row]
    home = cases / "round2" / "03-count"
    words = ["--scene", home / scene, "--fps", "25", "--out", tmp_path / "o"]
    status, text = said(capsys, "count", home / folder, *words)
    assert (status, re.search(line, text) is not None) == (expected, True), text


# Networks, and what names their classes where they do not.
NETWORKS = {
    "dyn_ok": "",
    "dyn_baked": "",
    "rfdetr_1_named": "",
    "rfdetr_3_named": "",
    "rfdetr_1": "person",
    "rfdetr_3": "person,car,dog",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", NETWORKS)
def test_people_of_networks(name: str, cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for number in range(1, 11):
        (tmp_path / "pictures").mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / "pictures" / f"{number:06}.png"), np.full((320, 320, 3), 90, np.uint8))
    network = cases / "round2" / "05-onnx" / f"{name}.onnx"
    words = ["--detector", network, "--method", "sort", "--view", "1", "--out", tmp_path / "o"]
    words += ["--detector-options.classes", NETWORKS[name]] if NETWORKS[name] else []
    status, text = said(capsys, "track", "people", tmp_path / "pictures", *words)
    assert (status, "2 people in 10 frames" in text) == (0, True), text
    tracks: list[Track] = read_folder(tmp_path / "o")[0]
    np.testing.assert_allclose([track.scores.mean() for track in tracks], [0.9, 0.8], atol=0.005)
