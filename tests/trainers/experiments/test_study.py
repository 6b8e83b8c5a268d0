"""A study of a linear measurement: its means, intervals and gains have a closed form, and nothing computed is lost."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.trainers.experiments.study import (
    Column,
    Curve,
    Name,
    Store,
    bootstrap,
    curves,
    interval,
    tabulated,
    values_of,
    with_bootstrap,
    with_error,
    with_interval,
)

CALLS: list[tuple[float, int]] = []
STOP = {"after": 1000}
"""Runs after which somebody interrupts."""


def measure(slope: float, unit: int) -> dict[str, float]:
    if len(CALLS) == STOP["after"]:
        raise KeyboardInterrupt
    CALLS.append((slope, unit))
    return {"error": slope * unit, "missed": 1.0}


ROWS: dict[Name, float] = {"plain": 1.0, "steep": 3.0}
MEASURED = {name: partial(measure, slope) for name, slope in ROWS.items()}
UNITS = (1, 2, 4)


@pytest.fixture(autouse=True)
def no_calls() -> None:
    CALLS.clear()


def test_means_gains_and_the_papers_values_stand_side_by_side(tmp_path: Path) -> None:
    found = Store(tmp_path).study(MEASURED, UNITS)
    columns = (
        Column("error", "error", ".1f", show=with_error, paper={"plain": 2.5}, gain=with_interval),
        Column("missed, %", lambda one: one["missed"], ".0f", 100),
    )
    table = tabulated(found, columns, ("row",), "Table 1", base="plain")
    assert table.columns == ["row", "error", "paper", "error over plain", "missed, %"]
    # Of 1, 2, 4: mean 7/3, standard error 0.88; the steep row is twice that above it, by Student's t of two degrees.
    half = 4.302653 * np.std([2, 4, 8], ddof=1) / np.sqrt(3)
    gain = f"+4.7 [{14 / 3 - half:+.1f}, {14 / 3 + half:+.1f}]"
    assert table.rows == [["plain", "2.3 ± 0.9", "2.5", "", "100"], ["steep", "7.0 ± 2.6", "", gain, "100"]]
    assert values_of(found)[1]["runs"][2] == {"error": 12.0, "missed": 1.0}


def test_an_interrupted_study_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(STOP, "after", 4)
    with pytest.raises(KeyboardInterrupt):
        Store(tmp_path).study(MEASURED, UNITS)
    assert len(CALLS) == 4
    monkeypatch.undo()
    found = Store(tmp_path).study(MEASURED, UNITS)
    assert len(CALLS) == len(set(CALLS)) == 6
    assert [one["error"] for one in found["steep"]] == [3.0, 6.0, 12.0]
    # One more row or unit costs its own runs alone.
    Store(tmp_path).study({**MEASURED, "flat": partial(measure, 0.0)}, (*UNITS, 8))
    assert len(CALLS) == 6 + 2 + 4


def test_gains_can_be_over_a_row_of_the_same_kind() -> None:
    found: dict[Name, list[float]] = {("a", "x"): [1.0], ("a", "y"): [3.0], ("b", "x"): [10.0], ("b", "y"): [11.0]}
    column = Column("score", form=".0f", gain=with_interval)
    table = tabulated(found, [column], ("kind", "row"), base=lambda name: (name[0], "x"))
    assert [row[-1] for row in table.rows] == ["", "+2", "", "+1"]


def test_arrays_of_all_units_are_put_together() -> None:
    column = Column("", np.asarray)
    assert column.values([np.array([1.0, 2.0]), np.array([3.0])]).tolist() == [1.0, 2.0, 3.0]


def test_intervals_are_students() -> None:
    half = 4.302653 * np.std([1, 2, 4], ddof=1) / np.sqrt(3)
    assert interval(np.array([1.0, 2.0, 4.0])) == pytest.approx((7 / 3, 7 / 3 - half, 7 / 3 + half))
    assert np.isnan(interval(np.array([1.0]))[1])


def test_the_bootstrap_of_equal_values_is_a_point_and_of_others_holds_their_mean() -> None:
    assert bootstrap(np.full(5, 3.0)) == pytest.approx((3.0, 3.0, 3.0))
    mean, low, high = bootstrap(np.array([-4.0, 0.0, 2.0, 10.0]))
    assert -4 <= low < mean == 2.0 < high <= 10
    # Of many normal values it is that of the normal distribution: 1.96 deviations of the mean.
    values = np.random.default_rng(1).standard_normal(400)
    _, low, high = bootstrap(values)
    assert (high - low) / 2 == pytest.approx(1.96 * values.std() / 20, rel=0.05)
    assert with_bootstrap(np.array([1.0]), ".0f") == "1"


def test_a_plot_has_a_panel_for_each_title() -> None:
    lines = [Curve("a", [1, 2], [3, 4]), Curve("b", [1, 2], [4, 3])]
    figure = curves({"first": lines, "second": lines}, ("x", "z"), "y")
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["first", "second"]
    assert [axes.get_xlabel() for axes in figure.axes] == ["x", "z"]


def test_a_seed_below_zero_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", "phd-unseen", "--seed", "-1", "--out", str(tmp_path / "o")]) == 2
    assert "--seed: expected a whole number from 0, got -1" in capsys.readouterr().err
