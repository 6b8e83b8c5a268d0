"""The experiment of costs learnt through the flow, on small generated sequences; and its picture."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.trainers.association.fitting import Fit
from tsuiseki.trainers.association.sequence_graphs import sequence_graphs
from tsuiseki.trainers.experiments.association.runs import Result, clip_sums
from tsuiseki.trainers.experiments.association.sequences import DATA_SETS, find_clips
from tsuiseki.trainers.experiments.end_to_end import given
from tsuiseki.trainers.experiments.end_to_end.folds import Learner, learnt_rows
from tsuiseki.trainers.experiments.end_to_end.gradient import crossing, draw_gradient, gradient_of, trained_on_crossings
from tsuiseki.trainers.experiments.end_to_end.pairwise import fit_pairs
from tsuiseki.trainers.experiments.end_to_end.runs import graphs_of_clip, learnt_tables, lost_links
from tsuiseki.trainers.experiments.end_to_end.tables import gain_table
from tsuiseki.trainers.experiments.experiment import Bench
from tsuiseki.trainers.experiments.store import Store

LENGTH = 40


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sequences of MOT15 in which two people meet, and one of MOT17."""
    home = tmp_path_factory.mktemp("data")
    for seed, name in enumerate(("mot15/ONE", "mot15/TWO", "mot17-val-half/THREE")):
        folder, video = home / "mot" / name, crossing(seed, LENGTH)
        rows = [(t, box, s) for t, f in enumerate(video.detections) for box, s in zip(f.boxes, f.scores, strict=True)]
        labels = zip(video.truth.frames, video.truth.ids, video.truth.boxes, strict=True)
        for part, lines in (
            ("gt", [f"{t + 1},{who},{_xywh(box)},1,-1,-1,-1" for t, who, box in labels]),
            ("det", [f"{t + 1},-1,{_xywh(box)},{score:.3f},-1,-1,-1" for t, box, score in rows]),
        ):
            (folder / part).mkdir(parents=True)
            (folder / part / f"{part}.txt").write_text("\n".join(lines) + "\n")
        write_sequence_info(folder, folder.name, 25.0, LENGTH, 640, 480)
    return home


def _xywh(box: np.ndarray) -> str:
    return ",".join(f"{value:.2f}" for value in (box[0] + 1, box[1] + 1, box[2] - box[0], box[3] - box[1]))


@pytest.mark.slow
def test_all_rows_and_again_from_the_store(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(given, "LOOKS", 4)
    monkeypatch.setattr(given, "FIT_OF_POOL", Fit(steps=5))
    monkeypatch.setattr(given, "OTHERS", {"joins as they are": Fit(joins=0.0, steps=5)})
    monkeypatch.setattr(given, "FOR_FEW", {"mean of four fits": Fit(steps=5, broken=2, fits=2, detections=False)})
    words = ["reproduce", "end-to-end", "--data", str(data), "--parts", "given,limits,alternatives", "--sets", "mot15"]
    words += ["--cache", str(tmp_path / "cache"), "--processes", "1"]
    assert main([*words, "--out", str(tmp_path / "one")]) == 0
    found = json.loads((tmp_path / "one" / "results.json").read_text())
    values, others = found["mot15"], found["mot15, alternatives"]
    rows = {
        "default",
        "pairs, logistic",
        "pairs, boosted trees",
        "hinge",
        "Fenchel-Young",
        "both losses",
        "right links",
    }
    assert set(values) == rows
    chosen = {given.MIXED, given.SEARCHED, given.SHARED, given.SURE, given.POOLED}
    assert set(others) == {"default", "both losses", *given.OTHERS, *given.FOR_FEW, *chosen}
    assert others["both losses"] == values["both losses"]
    assert set(found["mot15, limits"]) == {"links of the labels", "mended", "contested, told", "detections"}
    assert all(0 < row["hota"] <= 1 for row in (*values.values(), *others.values()))
    assert values["right links"]["idf1"] >= values["default"]["idf1"]
    entries = sorted(path.name for path in (tmp_path / "cache").rglob("*.json"))
    assert main([*words, "--out", str(tmp_path / "two")]) == 0
    assert sorted(path.name for path in (tmp_path / "cache").rglob("*.json")) == entries
    assert json.loads((tmp_path / "two" / "results.json").read_text()) == found
    words[words.index("given,limits,alternatives")] = "alternatives"
    assert main([*words, "--rows", "direct search,mean of four fits", "--out", str(tmp_path / "some")]) == 0
    some = json.loads((tmp_path / "some" / "results.json").read_text())["mot15, alternatives"]
    assert some == {name: others[name] for name in ("default", "both losses", "mean of four fits", "direct search")}


def test_what_becomes_of_the_links_of_the_labels(data: Path) -> None:
    (clip,) = find_clips(data, next(one for one in DATA_SETS if one.key == "mot17"))
    every, lost, taken, unused, wrong = lost_links(clip)
    assert 0 < taken <= every - lost - unused
    assert min(lost, unused, wrong) >= 0
    graph = graphs_of_clip(clip).detections
    assert every == int(graph.labelled[3 * len(graph) :].sum()) + lost


def test_each_group_is_tracked_by_what_the_others_taught(data: Path, tmp_path: Path) -> None:
    one = next(one for one in DATA_SETS if one.key == "mot15")
    clips, fit = find_clips(data, one), Fit(steps=3, rounds=2)
    (row,) = learnt_rows(Bench(Store(tmp_path)), one, clips, [Learner("short", learnt_tables, fit)], processes=1)
    expected = [clip_sums(a, learnt_tables((b,), (a,), fit)[0]) for a, b in (clips, clips[::-1])]
    np.testing.assert_allclose(row.sums, expected)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--parts", "all"], "parts: expected some of given"),
        (["--rows", "better"], "rows: expected some of all of the change of detections"),
        (["--data", "nowhere"], "data: expected mot/"),
    ],
)
def test_what_is_not_there(words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", "end-to-end", *words, "--out", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err


def test_training_turns_the_gradient_down_on_meetings_not_seen() -> None:
    graph = sequence_graphs(crossing(100)).detections
    changes = trained_on_crossings(range(4), Fit(loss="fenchel_young", steps=100, learning_rate=0.01))
    before, after = (np.abs(gradient_of(graph, known, 1.0)).sum() for known in (None, changes))
    assert before > 5
    assert after < 0.5 * before


def test_the_picture_has_both_panels() -> None:
    axes = draw_gradient(meetings=2, steps=20).axes
    assert [panel.get_title().split()[0] for panel in axes] == ["before", "after"]
    assert all(len(panel.lines) > 20 for panel in axes)


def test_pairs_learn_which_links_are_right() -> None:
    graphs = [sequence_graphs(crossing(seed)) for seed in range(4)]
    changes, graph = fit_pairs(graphs, "logistic"), sequence_graphs(crossing(9)).detections
    logit = changes.link.decision_function(graph.links)
    right = graph.labelled[3 * len(graph) :] > 0
    assert logit[right].mean() > logit[~right].mean() + 3
    assert np.abs(changes.links(graph.links)).max() <= 8
    assert changes.links(graph.links[:0]).shape == (0,)


def test_a_gain_of_nothing_is_nothing() -> None:
    sums = np.random.default_rng(0).uniform(1, 9, (3, 83))
    table = gain_table("set", [Result("a", sums), Result("b", sums)], ("a",))
    assert table.rows[1][7:11] == ["+0.000 [+0.000, +0.000]"] * 3 + ["+0% [+0%, +0%]"]
