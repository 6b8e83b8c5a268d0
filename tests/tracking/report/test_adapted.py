"""The page of an adapted camera: every round in the table, what changed in a new colour."""

from __future__ import annotations

import base64
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.report.adapted import HEADINGS, AdaptedReport, BeforeAndAfter, adapted_page
from tsuiseki.tracking.types import Detections

BOTH, LOST, NEW = [10.0, 10.0, 40.0, 90.0], [60.0, 10.0, 90.0, 90.0], [110.0, 10.0, 140.0, 90.0]


@pytest.fixture
def report() -> AdaptedReport:
    before, after = (Detections(np.array(boxes), np.full(2, 0.9)) for boxes in ([BOTH, LOST], [BOTH, NEW]))
    picture = BeforeAndAfter("frame 7 of a<b", np.full((100, 160, 3), 128, np.uint8), before, after)
    rounds = [dict.fromkeys(HEADINGS, 0.25), dict.fromkeys(HEADINGS, 0.75)]
    return AdaptedReport(["a<b"], rounds, 1, [picture], {"taken": [picture.image]}, 1, ["a note"])


def test_the_table_holds_every_round(report: AdaptedReport) -> None:
    page = adapted_page(report)
    tables = re.findall(r"<table.*?</table>", page, re.DOTALL)
    assert [table.count("<tr") for table in tables] == [3]
    assert tables[0].count("0.250") == tables[0].count("0.750") == len(HEADINGS)
    assert 'class="best">0.750</td>' in tables[0]
    assert "a<b" not in page


def test_what_only_one_finds_has_another_colour(report: AdaptedReport) -> None:
    """The left side of each box, in the pictures before and after: in both, lost, new."""
    pictures = [base64.b64decode(data) for data in re.findall(r'base64,([^"]+)', adapted_page(report))[:2]]
    drawn = [cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1] for data in pictures]
    before, after = ([image[50, int(box[0])].astype(int) for box in (BOTH, LOST, NEW)] for image in drawn)
    # JPEG keeps a line of two pixels to some 60 grey levels.
    for image in (before, after):
        np.testing.assert_allclose(image[0], (255, 196, 0), atol=60)
    np.testing.assert_allclose(before[1], (40, 110, 255), atol=60)
    np.testing.assert_allclose(after[2], (40, 110, 255), atol=60)
    np.testing.assert_allclose(before[2], 128, atol=20)
    np.testing.assert_allclose(after[1], 128, atol=20)


def test_pictures_say_of_which_round_they_are(report: AdaptedReport) -> None:
    kept, given_up = adapted_page(report), adapted_page(replace(report, best=0))
    assert "start: 2 detected" in kept
    assert "round 1: 2 detected" in kept
    assert "1 round; round 1 is kept" in kept
    assert "round 1, not kept: 2 detected" in given_up
