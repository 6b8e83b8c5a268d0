"""The file of a gallery: what it keeps, forgets and refuses."""

from __future__ import annotations

import json
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.features import gallery as module
from tsuiseki.tracking.features.gallery import (
    FILE,
    Gallery,
    Look,
    check_network,
    network_of,
    opened_gallery,
    read_gallery,
)


def look(seed: int, source: str = "a.png", count: int = 3, centre: bool = False) -> Look:
    """A look of person ``seed``: rows of 16 numbers near each other."""
    base = np.random.default_rng(seed).normal(size=16)
    rows = base + 0.2 * np.random.default_rng(seed + 1000).normal(size=(count, 16))
    return Look(source, rows.tolist(), [0.01] * 16 if centre else None)


def people(count: int = 3) -> Gallery:
    gallery = Gallery("network")
    for number in range(count):
        gallery = gallery.with_look(f"person {number}", look(number), "agreed", 30)
    return gallery


def test_what_is_written_is_read(tmp_path: Path) -> None:
    gallery = people().with_look("person 1", look(1, "door:7", centre=True))
    gallery.write(tmp_path / "new")
    assert read_gallery(tmp_path / "new") == gallery
    assert [len(person.looks) for person in gallery.people.values()] == [1, 2, 1]
    assert gallery.people["person 1"].consent == "agreed"
    assert gallery.people["person 1"].retention == 30


def test_who_is_removed_is_gone_from_the_file(tmp_path: Path) -> None:
    people().write(tmp_path)
    read_gallery(tmp_path).without("person 1").write(tmp_path)
    text = (tmp_path / FILE).read_text()
    assert "person 1" not in text
    assert str(look(1).pictures[0][0]) not in text
    assert [path.name for path in tmp_path.iterdir()] == [FILE]
    with pytest.raises(RequestError, match="expected one of person 0, person 2, got 'person 1'"):
        read_gallery(tmp_path).without("person 1")


def test_who_may_not_be_kept_any_longer_is_not_recognised(monkeypatch: pytest.MonkeyPatch) -> None:
    gallery = people().with_look("person 2", look(2), retention=40)
    later = module.today() + timedelta(days=31)
    monkeypatch.setattr(module, "today", lambda: later)
    with pytest.warns(InputWarning, match="the time of person 0, person 1 in the gallery is over"):
        assert list(gallery.current().people) == ["person 2"]


def test_people_look_like_their_pictures() -> None:
    gallery = people(6)
    rows = gallery.rows()
    assert rows.shape == (6, 16)
    assert np.allclose(np.linalg.norm(rows, axis=1), 1)
    again = [Gallery("network").with_look("x", look(n, count=1)).rows()[0] for n in range(6)]
    assert (rows @ np.array(again).T).argmax(axis=1).tolist() == list(range(6))
    assert Gallery("network").rows().shape == (0, 0)


def test_one_picture_is_enough() -> None:
    gallery = Gallery("network").with_look("anna", look(1, count=1))
    assert gallery.doubts("anna") == []
    assert gallery.rows().shape == (1, 16)


def test_two_people_under_one_name_are_said() -> None:
    gallery = people(6).with_look("anna", look(20, "anna.png", count=4)).with_look("anna", look(21, "ben.png", count=1))
    assert gallery.doubts("anna") == ["1 of 5 pictures of 'anna' look like somebody else: ben.png"]


def test_one_person_under_two_names_is_said() -> None:
    (doubt,) = people(6).with_look("twin", look(3, "again.png")).doubts("twin")
    assert doubt.startswith("'twin' and 'person 3' look alike (cosine 1.00)")


def test_rows_of_another_network_are_refused() -> None:
    with pytest.raises(RequestError, match=r"b\.png: expected rows of 16 numbers, got 2"):
        people().with_look("anna", Look("b.png", [[1.0, 2.0]]))

    class Other:
        def describe(self, _: np.ndarray, boxes: np.ndarray) -> np.ndarray:
            return np.ones((len(boxes), 4))

    assert network_of(Other()) == "Other"
    with pytest.raises(RequestError, match="described by network network, this is Other"):
        check_network(people(), Other(), "staff")
    with pytest.raises(RequestError, match="the gallery needs an appearance network"):
        opened_gallery(people(), None)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("[]", "expected"),
        ("{", "gallery"),
        ('{"network": "a", "people": {"anna": {}}}', "added"),
        ('{"network": "a", "people": {"anna": {"added": "2026-01-01", "looks": []}}}', "looks"),
        ('{"network": "a", "people": {"": {"added": "2026-01-01", "looks": []}}}', "people"),
        ('{"network": "a", "people": {}, "more": 1}', "more"),
    ],
)
def test_a_broken_file_is_one_line(tmp_path: Path, content: str, words: str) -> None:
    (tmp_path / FILE).write_text(content)
    with pytest.raises(RequestError, match=words) as error:
        read_gallery(tmp_path)
    assert "\n" not in str(error.value)
    assert FILE in str(error.value)


def test_a_folder_without_a_gallery_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match=r"found no gallery\.json; make one with `tsuiseki gallery add`"):
        read_gallery(tmp_path)


def test_names_and_days_have_bounds() -> None:
    for name in ("", " ", "a" * 61, "a\nb"):
        with pytest.raises(RequestError):
            people().with_look(name, look(1))
    with pytest.raises(RequestError):
        people().with_look("anna", look(1), retention=-1)


def test_infinite_numbers_are_refused(tmp_path: Path) -> None:
    people(1).write(tmp_path)
    content = json.loads((tmp_path / FILE).read_text())
    content["people"]["person 0"]["looks"][0]["pictures"][0][0] = float("nan")
    (tmp_path / FILE).write_text(json.dumps(content))
    with pytest.raises(RequestError):
        read_gallery(tmp_path)
