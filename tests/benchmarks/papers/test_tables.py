"""Tables of a linear measurement: its means, intervals and gains have a closed form."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.papers.plots import Curve, curves
from benchmarks.papers.tables import (
    Column,
    Name,
    bootstrap,
    interval,
    tabulated,
    values_of,
    with_bootstrap,
    with_error,
    with_interval,
)


def test_means_gains_and_the_papers_values_stand_side_by_side() -> None:
    measured: dict[Name, list[dict[str, float]]] = {
        name: [{"error": slope * unit, "missed": 1.0} for unit in (1, 2, 4)]
        for name, slope in (("plain", 1.0), ("steep", 3.0))
    }
    columns = (
        Column("error", "error", ".1f", show=with_error, paper={"plain": 2.5}, gain=with_interval),
        Column("missed, %", lambda one: one["missed"], ".0f", 100),
    )
    table = tabulated(measured, columns, ("row",), "Table 1", base="plain")
    assert table.columns == ["row", "error", "paper", "error over plain", "missed, %"]
    # Of 1, 2, 4: mean 7/3, standard error 0.88; the steep row is twice that above it, by Student's t of two degrees.
    half = 4.302653 * np.std([2, 4, 8], ddof=1) / np.sqrt(3)
    gain = f"+4.7 [{14 / 3 - half:+.1f}, {14 / 3 + half:+.1f}]"
    assert table.rows == [["plain", "2.3 ± 0.9", "2.5", "", "100"], ["steep", "7.0 ± 2.6", "", gain, "100"]]
    assert values_of(measured)[1]["runs"][2] == {"error": 12.0, "missed": 1.0}


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
