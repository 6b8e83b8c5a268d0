"""Charts: the same marks as SVG and as PNG."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from tsuiseki.tracking.report.chart import Chart, steps_chart, table_chart, ticks
from tsuiseki.tracking.video.image_folder import read_image

TIMES = np.arange(5.0)


def test_a_step_holds_its_value_until_the_next():
    chart = steps_chart("seconds", "in view", [("", TIMES, np.array([0.0, 2, 2, 1, 1]), "#0072b2", False)])
    lines = ET.fromstring(chart.svg("counts")).findall("{*}polyline")
    points = np.array([pair.split(",") for pair in lines[-1].get("points").split()], dtype=float)
    assert len(points) == 9
    assert (np.diff(points[:, 0]) * np.diff(points[:, 1]) == 0).all()
    assert points[:, 1].argmin() == 2


def test_names_are_escaped_and_shown_beside_their_lines():
    chart = steps_chart(
        "seconds", "people", [("a <b>", TIMES, TIMES, "#e69f00", True), ("c", TIMES, TIMES, "red", False)]
    )
    page = chart.svg("crossings & more")
    assert [one.text for one in ET.fromstring(page).findall("{*}text")][-2:] == ["a <b>", "c"]
    assert page.count("stroke-dasharray") == 2


@pytest.mark.parametrize(
    "chart",
    [
        steps_chart("seconds", "people", [("in", TIMES, TIMES, "#ff0000", True)]),
        steps_chart("seconds", "people", [("", np.zeros(1), np.zeros(1), "#ff0000", False)]),
        steps_chart("seconds", "people", []),
        table_chart(["left", "Straße"], ["top"], np.array([[3], [0]])),
        table_chart([], [], np.zeros((0, 0))),
    ],
)
def test_a_picture_has_the_size_and_the_ink_of_the_chart(tmp_path, chart):
    chart.save(tmp_path / "chart.png")
    image = read_image(tmp_path / "chart.png")
    assert image.shape[:2] == (round(2 * chart.height), round(2 * chart.width))
    assert image.min() < 100


def test_dashes_leave_a_third_of_a_line_out(tmp_path):
    shares = []
    for dashed in (False, True):
        chart = Chart(100, 10)
        chart.line(np.array([[0.0, 5], [45, 5], [90, 5]]), "#000000", 2, dashed)
        chart.save(tmp_path / "line.png")
        shares.append((read_image(tmp_path / "line.png") < 128).mean())
    assert 0.6 < shares[1] / shares[0] < 0.8


@pytest.mark.parametrize(
    ("end", "whole", "step"), [(1.0, False, 0.1), (16, False, 2), (395 / 7, False, 10), (2.1, True, 1)]
)
def test_ticks_are_round(end, whole, step):
    found = ticks(end, 10, whole)
    assert found[0] == 0
    assert np.diff(found) == pytest.approx(step)
    assert found[-1] <= end + 1e-9
