"""How the peers' thresholds are chosen, with a filter whose error is known; and what the program of peers takes."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tsuiseki.tracking.evaluation.points import PointScores
from tsuiseki.trainers.experiments.experiment import Bench
from tsuiseki.trainers.experiments.finite_sets import peer_choice
from tsuiseki.trainers.experiments.finite_sets.unseen_scenarios import UnseenSettings
from tsuiseki.trainers.experiments.finite_sets.unseen_scores import UnseenRun
from tsuiseki.trainers.experiments.peers import Peer
from tsuiseki.trainers.experiments.store import Store

LMB = "multisensor-lmb-filters-rs LMB"


def pretended(
    peer: Peer, name: str, chosen: peer_choice.PeerSettings, settings: UnseenSettings, seeds: tuple[int, ...]
) -> list[UnseenRun]:
    """Least wrong at a shown of 0.55 and, there only, at 100 components."""
    del peer, name, settings
    error = 100 * abs(chosen["shown"] - 0.55) + abs(chosen.get("components", 0.0) - 100) / 100
    zeros = dict.fromkeys(PointScores.__dataclass_fields__, 0)
    return [UnseenRun(PointScores(**{**zeros, "ospa1": error}), 1.0, 10) for _ in seeds]


def test_each_setting_takes_the_value_of_the_least_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peer_choice, "run_peer", pretended)
    chosen = peer_choice.choose(Bench(Store(tmp_path)), Peer("python", "1"))
    settings, usual, best = chosen[LMB]
    assert settings["shown"] == 0.55
    assert settings["components"] == 100
    assert best == pytest.approx(0)
    assert usual == pytest.approx(55 + 0.8)
    # Nothing to choose.
    assert chosen["Stone Soup JPDA"][0] == {}


def test_the_program_takes_the_settings_that_are_chosen() -> None:
    tree = ast.parse(peer_choice.PROGRAM.read_text())
    takes = {f.name: {a.arg for a in f.args.args} - {"model"} for f in tree.body if isinstance(f, ast.FunctionDef)}
    assert takes["gm_phd"] == set(peer_choice.GRIDS["Stone Soup GM-PHD"])
    assert takes["lmb"] == set(peer_choice.GRIDS[LMB])
