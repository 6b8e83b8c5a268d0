"""The experiment of chapter 3 on tiny clips: passes, searches, losses, and settings chosen on other sequences."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from benchmarks.papers import single_target as single
from benchmarks.papers.__main__ import main
from benchmarks.papers.peers import Peer, find_peer
from benchmarks.papers.single_target import (
    SWEEPS,
    Csrt,
    TargetClip,
    area,
    by_seed,
    count_losses,
    drawn_clips,
    follow,
    follow_with_csrt,
    leave_one_out,
    loaded,
    scored,
    searches,
)
from benchmarks.papers.store import Store
from tsuiseki.datamodules.scenes.single_clip import SingleClip, SingleClipSettings
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.evaluation.success_curves import evaluate_boxes
from tsuiseki.tracking.single.combined import CombinedSettings
from tsuiseki.tracking.single.kcf import KcfSettings
from tsuiseki.tracking.single.kcf_particle import PRINTED
from tsuiseki.tracking.single.regularised import RegularisedSettings
from tsuiseki.tracking.types import FloatArray, ImageArray

ALWAYS = replace(PRINTED, response_share=1.0, switch=10.0, plain_frames=3, hypotheses=3, particles=30, convergence=1e9)
SMALL = CombinedSettings(filter=RegularisedSettings(sizes=1))


def draw_tiny(seed: int, frames: int) -> tuple[FloatArray, list[ImageArray]]:
    settings = SingleClipSettings(frames=frames, width=120, height=90, person_height=(30, 31), passers=0, obstacles=0)
    drawn = list(SingleClip(settings, seed).frames())
    return np.concatenate([truth.boxes for _, truth in drawn]), [image for (image,), _ in drawn]


def clip(seed: int = 1, frames: int = 14) -> TargetClip:
    return partial(draw_tiny, seed, frames)


def test_sweeps_hold_the_thesis_s_values_and_change_one_parameter() -> None:
    for _, trackers, paper in SWEEPS.values():
        assert set(paper) <= set(trackers)
        assert len(set(trackers.values())) == len(trackers)


def test_searches_compare_three_ways_on_the_same_frames() -> None:
    during, after = searches(clip(), ALWAYS, 0)
    for part in (during, after):
        assert len({len(overlaps) for overlaps in part.values()}) == 1
    assert len(during["Fix"]) == 4  # frames 2, 6, 10 and 14: each search ends at once, then three without
    assert len(after["Fix"]) == 9
    assert 0 <= area(np.array(during["Proposed"])) <= 100
    assert np.isnan(area(np.empty(0)))


def test_a_figure_has_the_frames_during_the_search_and_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(single, "SEARCHES", {"always": ALWAYS})
    outcome = single.intervals(Store(tmp_path), {"tiny": clip()}, [0])
    titles = [axes.get_title(loc="left") for axes in outcome.plots["intervals-always"].axes]
    assert titles == ["(a) during the search", "(b) 10 frames after"]
    assert [row[:2] for row in outcome.tables[0].rows] == [["during the search", "4"], ["10 frames after", "9"]]


def test_results_by_seed_and_nothing_is_run_again(tmp_path: Path) -> None:
    def kept() -> dict[Path, int]:
        return {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.npz")}

    bench, tiny = Store(tmp_path), clip()
    found = scored(bench, {"tiny": tiny}, {"combined": ALWAYS}, [0, 1], "passes")
    areas = [one["auc_11"] for one in by_seed(found["combined"])]
    assert len(areas) == 2
    before = kept()
    assert len(before) == 2
    scored(bench, {"tiny": tiny}, {"combined": ALWAYS}, [0, 1], "passes")
    assert kept() == before
    scored(bench, {"tiny": tiny}, {"combined": replace(ALWAYS, particles=31)}, [0], "passes")
    assert len(kept()) == 3
    # A tracker without random numbers passes once, whatever the seeds.
    assert len(scored(bench, {"tiny": tiny}, {"kcf": KcfSettings()}, [0, 1], "passes")["kcf"][0]["auc_11"]) == 1


def test_a_sequence_has_no_say_in_its_own_settings() -> None:
    # "a" owes its mean to the first sequence alone, so that the first is scored with "b"
    chosen = leave_one_out({"a": np.array([90.0, 10, 10]), "b": np.array([20.0, 30, 30])})
    assert chosen == ["b", "a", "a"]


def test_of_equal_candidates_the_first_is_taken() -> None:
    chosen = leave_one_out({"a": np.array([1.0, 1.0]), "b": np.array([1.0, 1.0])})
    assert chosen == ["a", "a"]


def test_the_table_of_unseen_sequences_has_a_row_a_tracker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    group = 1, {"KCF": KcfSettings(scale_step=1.0), "alone": RegularisedSettings(sizes=1)}, {"one": SMALL}
    monkeypatch.setattr(single, "GROUPS", {"small": group})
    outcome = single.unseen(Store(tmp_path), {"one": clip(1, 8), "two": clip(2, 8)}, [0])
    assert [row[0] for row in outcome.tables[0].rows] == ["KCF", "alone", single.OURS]
    values = outcome.values["unseen"]["small"]
    gain = np.mean(np.array(values[single.OURS]) - values["KCF"])
    assert float(outcome.tables[0].rows[2][2].split()[0]) == pytest.approx(gain, abs=0.06)


def test_one_sequence_is_too_few(tmp_path: Path) -> None:
    outcome = single.unseen(Store(tmp_path), {"tiny": clip()}, [0])
    assert not outcome.tables
    assert "two sequences" in outcome.notes[0]


def test_losses_and_alarms_are_counted() -> None:
    overlaps = np.concatenate([np.full(5, 0.8), np.zeros(9), [0.6], np.zeros(12), [np.nan], np.zeros(10)])
    lost = np.zeros(len(overlaps), dtype=bool)
    lost[2] = True  # followed: an alarm
    lost[8] = True  # nine frames are no loss
    lost[15 + 9] = True  # the tenth frame of the first loss
    assert count_losses(overlaps, lost) == (2, 1, 6, 1)


def test_a_loss_noticed_later_than_ten_frames_is_not_noticed() -> None:
    lost = np.zeros(30, dtype=bool)
    lost[10:] = True
    assert count_losses(np.zeros(30), lost) == (1, 0, 0, 0)


@pytest.mark.slow
def test_the_table_of_the_status_has_given_clips_and_generated_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracker = RegularisedSettings(sizes=1)
    monkeypatch.setattr(single, "GENERATED", ((0, 1), (1, 2), (0, 2)))
    monkeypatch.setattr(single, "STATUS", {"filter": tracker})
    ((name, given),) = drawn_clips(1).items()
    outcome = single.lost_status(Store(tmp_path), {name: given}, [0])
    first, second, third, both = outcome.tables[0].rows
    assert first[2:] == second[2:]
    assert (third[0], both[0]) == ("generated clips 2 to 2", "generated clips 1 to 2")
    auc = evaluate_boxes(loaded(given)[0], follow(given, tracker, 0).boxes).auc
    assert float(first[2]) == pytest.approx(100 * auc, abs=0.06)
    assert outcome.values["status"]["given clips, filter"]["followed"] > 0


def test_a_python_without_csrt_is_refused(tmp_path: Path) -> None:
    for python in (sys.executable, str(tmp_path / "python")):
        with pytest.raises(RequestError, match="opencv-contrib-python-headless"):
            find_peer(python, "csrt")


def csrt(folder: Path, script: str) -> Csrt:
    """CSRT whose environment's python reads the job and runs a script instead."""
    (folder / "stand_in.py").write_text(f"import json, sys\nimport numpy as np\njob = json.load(sys.stdin)\n{script}\n")
    (folder / "python").write_text(f"#!/bin/sh\nexec {sys.executable} {folder}/stand_in.py\n")
    (folder / "python").chmod(0o755)
    return Csrt(Peer("csrt", str(folder / "python"), "5"), 33)


def test_all_images_are_sent_to_csrt_and_the_boxes_come_back(tmp_path: Path) -> None:
    # Each box moves right by the blue of its image, which is the first channel.
    moved = "[[x + int(image[0, 0, 0]), y, w, h] for image in np.load(job['images'])[1:]]"
    script = f"x, y, w, h = job['box']\nprint(json.dumps({moved}))"
    images = [np.full((4, 6, 3), (1, 2, k), np.uint8) for k in range(3)]
    found: FloatArray = follow_with_csrt(csrt(tmp_path, script), images, np.array([3.0, 4, 13, 24]))
    assert found.tolist() == [[3, 4, 13, 24], [4, 4, 14, 24], [5, 4, 15, 24]]


def test_where_csrt_breaks_off_the_user_hears_of_it(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"csrt: expected an answer from .*, it broke off: no camera"):
        follow_with_csrt(csrt(tmp_path, "sys.exit('no camera')"), [np.zeros((4, 6, 3), np.uint8)] * 3, np.arange(4.0))


@pytest.mark.slow
def test_the_experiment_runs_on_a_folder_and_goes_on_from_its_cache(
    labelled_square: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(single, "GENERATED", ((0, 1),))
    out, cache = tmp_path / "out", tmp_path / "cache"
    words = ["multi-correlation-filter", "--data", str(labelled_square), "--cache", str(cache)]
    words += ["--seeds", "1", "--sweep-seeds", "1"]
    assert main([*words, "--out", str(out)]) == 0
    files = {path.name for path in out.iterdir()}
    assert {"results.json", "sweeps.png", "comparison.png", "intervals-printed.png", "intervals-robust.png"} <= files
    values = json.loads((out / "results.json").read_text())
    assert values["sweeps"]["alpha"]["0.3"]["paper"] == 38.60
    text = capsys.readouterr().out
    assert re.search(r"\n *thesis, printed +\d+\.\d\d +40\.64 +\d+\.\d\d +\d+\.\d +35\.0", text)
    assert {"thesis, printed", "thesis, robust, fixed size", "thesis, robust"} <= set(values["comparison"])
    before = sorted(path.stat().st_mtime_ns for path in cache.rglob("*.npz"))
    assert main([*words, "--out", str(tmp_path / "again")]) == 0
    assert sorted(path.stat().st_mtime_ns for path in cache.rglob("*.npz")) == before
    assert json.loads((tmp_path / "again" / "results.json").read_text()) == values


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--parts", "sweep"], '"sweep" for --parts. Choose from: "unseen", "status"'),
        (["--seeds", "0"], '"0" for --seeds. Must be > 0'),
        (["--data", "nowhere"], "expected a folder of sequences or a label file at nowhere"),
    ],
)
def test_wrong_requests_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], line: str
) -> None:
    assert main(["multi-correlation-filter", "--out", str(tmp_path / "out"), *options]) == 2
    assert line in capsys.readouterr().err
    assert not (tmp_path / "out" / "results.json").exists()
