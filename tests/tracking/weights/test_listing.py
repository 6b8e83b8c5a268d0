"""The table of all networks."""

from __future__ import annotations

import re

import pytest

from tests.tracking.features.test_foreign_appearance import mean_colour
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.onnx import ModelCard, card_of
from tsuiseki.tracking.weights import shipped_names
from tsuiseki.tracking.weights.catalogue import CATALOGUE
from tsuiseki.tracking.weights.listing import HEAD, MEASURED, table


def test_every_network_is_a_line_with_its_licence_in_100_columns(capsys):
    assert main(["models", "list"]) == 0
    printed = capsys.readouterr().out
    assert max(map(len, printed.split("\n"))) <= 100
    head, *rows = (re.split(r"  +", line) for line in printed.partition("\n\n")[0].split("\n"))
    assert tuple(head) == HEAD
    assert len(rows) == len(shipped_names()) + len(CATALOGUE)
    assert all(len(row) == len(HEAD) and row[3] for row in rows)
    assert {row[3] for row in rows[: len(shipped_names())]} == {"Apache-2.0"}
    people = next(row for row in rows if row[:2] == ["people", "detector"])
    assert people[4] == "1.00"
    assert float(people[5]) > 0.9


def test_what_was_measured_is_of_networks_that_there_are():
    assert MEASURED.keys() <= {*shipped_names(), *(each.name for each in CATALOGUE)}
    assert all(0 <= x <= 1 for each in MEASURED.values() for x in each.average_precision)
    assert "nanodet-g" in table()


def test_a_shipped_network_need_not_be_fetched_and_says_what_it_learnt_from(capsys):
    for name in ("people", "detector_people"):
        assert main(["models", "get", name]) == 0
        printed = capsys.readouterr().out
        assert printed.startswith(f"{name} ships with tsuiseki; take it by its name\n")
        assert "detector_people learnt from: rendered people\n" in printed


def test_a_card_keeps_a_licence_and_older_ones_have_none():
    card = ModelCard(kind="detector", name="ours", licence="MIT")
    assert ModelCard.from_json(card.to_json()).licence == "MIT"
    assert ModelCard.from_json(card.to_json().replace('"licence": "MIT", ', "")).licence == ""


def test_a_file_without_a_card_is_said_to_have_none(tmp_path):
    with pytest.raises(RequestError, match="expected the metadata of a network of tsuiseki, got none"):
        card_of(mean_colour(tmp_path / "a.onnx", ("n", 3, 24, 12)))
