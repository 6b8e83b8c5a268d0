"""The experiment of chapter 3 on tiny clips: passes, and settings chosen on other sequences."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.datamodules.scenes.single_clip import SingleClipSettings, draw_single_clip
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.evaluation.single import evaluate_boxes
from tsuiseki.tracking.formats.single import SingleSequence
from tsuiseki.tracking.single.combined import CombinedSettings
from tsuiseki.tracking.single.kcf import KcfSettings
from tsuiseki.tracking.single.kcf_particle import PRINTED
from tsuiseki.tracking.single.regularised import RegularisedSettings
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments import single_target as single
from tsuiseki.trainers.experiments.peers import Peer, find_peer
from tsuiseki.trainers.experiments.single_target import (
    CSRT,
    Csrt,
    TargetClip,
    area,
    follow,
    follow_with_csrt,
    leave_one_out,
    scored,
)
from tsuiseki.trainers.experiments.store import Store
from tsuiseki.trainers.experiments.study import Bench

ALWAYS = replace(PRINTED, response_share=1.0, switch=10.0, plain_frames=3, hypotheses=3, particles=30, convergence=1e9)
SMALL = CombinedSettings(filter=RegularisedSettings(sizes=1))


def clip(seed: int = 1, frames: int = 14) -> TargetClip:
    settings = SingleClipSettings(frames=frames, width=120, height=90, person_height=(30, 31), passers=0, obstacles=0)
    made = draw_single_clip(np.random.default_rng(seed), settings)
    return TargetClip(SingleSequence(f"tiny-{seed}", (), made.boxes, frozenset({"OCC"})), list(made.images))


def test_seeds_are_averaged_and_nothing_is_run_again(tmp_path: Path) -> None:
    def kept() -> dict[Path, int]:
        return {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.pickle")}

    bench, tiny = Bench(Store(tmp_path)), clip()
    found = scored(bench, [tiny], {"combined": ALWAYS}, 2, "passes")
    passes = [follow(tiny, ALWAYS, seed) for seed in (0, 1)]
    assert all(drew for _, drew in passes)
    areas = [evaluate_boxes(tiny.sequence.boxes, boxes).auc for boxes, _ in passes]
    assert found["combined"] == pytest.approx([100 * np.mean(areas)])
    before = kept()
    assert len(before) == 1
    scored(bench, [tiny], {"combined": ALWAYS}, 2, "passes")
    assert kept() == before
    scored(bench, [tiny], {"combined": replace(ALWAYS, particles=31)}, 1, "passes")
    assert len(kept()) == 2


def test_a_tracker_without_random_numbers_passes_once(monkeypatch: pytest.MonkeyPatch) -> None:
    seeds: list[int] = []

    def still(clip: TargetClip, _: KcfSettings, seed: int) -> tuple[FloatArray, bool]:
        seeds.append(seed)
        return clip.sequence.boxes, False

    monkeypatch.setattr(single, "follow", still)
    # The last of 21 thresholds is an overlap above 1.
    assert area((KcfSettings(), 3), clip()) == pytest.approx(100 * 20 / 21)
    assert seeds == [0]


def test_a_sequence_has_no_say_in_its_own_settings() -> None:
    # "a" owes its mean to the first sequence alone, so that the first is scored with "b"
    chosen = leave_one_out({"a": np.array([90.0, 10, 10]), "b": np.array([20.0, 30, 30])})
    assert chosen == ["b", "a", "a"]


def test_of_equal_candidates_the_first_is_taken() -> None:
    chosen = leave_one_out({"a": np.array([1.0, 1.0]), "b": np.array([1.0, 1.0])})
    assert chosen == ["a", "a"]


def test_the_chosen_candidate_is_scored_beside_the_others(tmp_path: Path) -> None:
    group = single.ClipGroup(KcfSettings(scale_step=1.0), {"alone": RegularisedSettings(sizes=1)}, {"one": SMALL})
    found, chosen = single.compared(Bench(Store(tmp_path)), [clip(1, 8), clip(2, 8)], "small", group, 1)
    assert list(found) == ["KCF", "alone", single.OURS]
    assert chosen == ["one", "one"]
    assert found[single.OURS] == pytest.approx(np.array([area((SMALL, 1), clip(seed, 8)) for seed in (1, 2)]))


def test_a_python_without_csrt_is_refused(tmp_path: Path) -> None:
    for python in (sys.executable, str(tmp_path / "python")):
        with pytest.raises(RequestError, match="opencv-contrib-python-headless"):
            find_peer(python, CSRT, "opencv-contrib-python-headless")


def csrt(folder: Path, script: str) -> Csrt:
    """CSRT whose environment's python reads the job and runs a script instead."""
    (folder / "stand_in.py").write_text(f"import json, sys\nimport numpy as np\njob = json.load(sys.stdin)\n{script}\n")
    (folder / "python").write_text(f"#!/bin/sh\nexec {sys.executable} {folder}/stand_in.py\n")
    (folder / "python").chmod(0o755)
    return Csrt(Peer(str(folder / "python"), "5"), 33)


def test_all_images_are_sent_to_csrt_and_the_boxes_come_back(tmp_path: Path) -> None:
    # Each box moves right by the blue of its image, which is the first channel.
    moved = "[[x + int(image[0, 0, 0]), y, w, h] for image in np.load(job['images'])[1:]]"
    script = f"x, y, w, h = job['box']\nprint(json.dumps({moved}))"
    images = [np.full((4, 6, 3), (1, 2, k), np.uint8) for k in range(3)]
    found: FloatArray = follow_with_csrt(csrt(tmp_path, script), images, np.array([3.0, 4, 13, 24]))
    assert found.tolist() == [[3, 4, 13, 24], [4, 4, 14, 24], [5, 4, 15, 24]]


def test_where_csrt_breaks_off_the_user_hears_of_it(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"single_csrt\.py: expected an answer from .*, it broke off: no camera"):
        follow_with_csrt(csrt(tmp_path, "sys.exit('no camera')"), [np.zeros((4, 6, 3), np.uint8)] * 3, np.arange(4.0))
