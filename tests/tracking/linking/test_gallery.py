"""People of a gallery: added, recognised over results and frames, remembered and removed."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

import tsuiseki
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.features.gallery import read_gallery
from tsuiseki.tracking.linking.gallery import add_person
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import Detections, Track

# Colours of six people, RGB; each stands on a spot of their own.
COLOURS = np.array([[200, 40, 40], [40, 200, 40], [40, 40, 200], [200, 200, 40], [200, 40, 200], [40, 200, 200]])


def boxes(x: float) -> np.ndarray:
    """Boxes of the six, ``x`` pixels further to the right."""
    left = 10.0 + 50 * np.arange(6) + x
    return np.column_stack([left, np.full(6, 20.0), left + 20, np.full(6, 60.0)])


def images(order: list[int], count: int = 8) -> list[np.ndarray]:
    """Frames in which the six stand in this order and walk a little."""
    rng, frames = np.random.default_rng(order), []
    for number in range(count):
        image = np.full((90, 330, 3), 120, np.uint8)
        for box, colour in zip(boxes(number).astype(int), COLOURS[order], strict=True):
            image[box[1] : box[3], box[0] : box[2]] = np.clip(colour + rng.normal(0, 6, 3), 0, 255)
        frames.append(image)
    return frames


def visit(folder: Path, order: list[int], first: int = 1) -> Path:
    """A result with its video: the six in this order, with ids from ``first``."""
    video = folder / "video"
    video.mkdir(parents=True)
    frames = images(order)
    for number, image in enumerate(frames):
        cv2.imwrite(str(video / f"{number:04d}.png"), image[..., ::-1])
    tracks = [Track(first + k, np.arange(8), np.array([boxes(n)[k] for n in range(8)]), np.ones(8)) for k in range(6)]
    Result(tracks, str(video), 10.0, (330, 90)).save(folder / "result")
    return folder / "result"


def colours(crops: list[np.ndarray]) -> np.ndarray:
    """An appearance model that knows colours alone."""
    return np.array([crop.reshape(-1, 3).mean(axis=0) - 120 for crop in crops])


def test_66_3_people_are_recognised_in_another_result(tmp_path: Path) -> None:
    monday, tuesday = (
        visit(tmp_path / "monday", [0, 1, 2, 3, 4, 5]),
        visit(tmp_path / "tuesday", [3, 2, 5, 4, 0, 1], 21),
    )
    gallery = add_person(None, "anna", [f"{monday}:1"], colours)
    gallery = add_person(gallery, "ben", [f"{monday}:3"], colours)
    linked = tsuiseki.link([tuesday], appearance=colours, gallery=gallery)
    names = {number: name for number, name, _ in linked.people if name}
    tracks = {track.id: track for track in linked.results[0]}
    spots = {name: round((float(tracks[number].boxes[0, 0]) - 10) / 50) for number, name in names.items()}
    assert spots == {"anna": 4, "ben": 1}
    assert all(0 <= probability <= 1 for _, _, probability in linked.people)


def test_strangers_keep_their_names_over_days_when_they_are_remembered(tmp_path: Path) -> None:
    days = [visit(tmp_path / f"day{k}", order) for k, order in enumerate(([0, 1, 2, 3, 4, 5], [5, 4, 3, 2, 1, 0]))]
    gallery = add_person(None, "anna", [f"{days[0]}:1"], colours)
    first = tsuiseki.link([days[0]], appearance=colours, gallery=gallery, remember=30)
    assert sorted(name for _, name, _ in first.people) == ["anna", *(f"unknown-{k}" for k in range(1, 6))]
    assert first.gallery is not None
    assert {p.retention for name, p in first.gallery.people.items() if name != "anna"} == {30}
    second = tsuiseki.link([days[1]], appearance=colours, gallery=first.gallery)
    by_spot = {round((float(t.boxes[0, 0]) - 10) / 50): t.id for t in second.results[0]}
    before = {round((float(t.boxes[0, 0]) - 10) / 50): t.id for t in first.results[0]}
    names = [{number: name for number, name, _ in day.people} for day in (first, second)]
    assert [names[0][before[k]] for k in range(6)] == [names[1][by_spot[5 - k]] for k in range(6)]


def test_whoever_is_followed_has_an_identity(tmp_path: Path) -> None:
    monday = visit(tmp_path / "monday", [0, 1, 2, 3, 4, 5])
    gallery = add_person(None, "anna", [f"{monday}:1"], colours)
    gallery.write(tmp_path / "gallery")

    def detect(image: np.ndarray) -> Detections:
        left = int(np.flatnonzero((image[40] != 120).any(axis=1))[0])
        return Detections(boxes(left - 10), np.ones(6))

    frames = images([4, 3, 0, 1, 5, 2])
    steps = list(
        tsuiseki.follow_people(
            frames, detector=detect, appearance=colours, gallery=tmp_path / "gallery", frame_rate=10.0
        )
    )
    last = {round((float(target.box[0]) - 17) / 50): target.identity for target in steps[-1][1]}
    assert last[2] is not None
    assert last[2].name == "anna"
    assert [identity.name for spot, identity in last.items() if spot != 2 and identity is not None] == [""] * 5
    plain = list(tsuiseki.follow_people(frames, detector=detect, frame_rate=10.0))
    assert all(target.identity is None for target in plain[-1][1])


def test_the_commands_add_list_recognise_and_remove(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    monday, gallery = visit(tmp_path / "monday", [0, 1, 2, 3, 4, 5]), tmp_path / "gallery"
    picture = tmp_path / "anna.png"
    cv2.imwrite(str(picture), images([0, 1, 2, 3, 4, 5])[0][20:60, 10:30, ::-1])
    words = ["gallery", "add", "anna", str(picture), f"{monday}:1", "--gallery", str(gallery)]
    assert main([*words, "--consent", "signed on paper", "--retention", "30"]) == 0
    assert f"anna: 7 pictures; 1 in the gallery: {gallery}" in capsys.readouterr().out
    assert main(["gallery", "list", "--gallery", str(gallery)]) == 0
    listed = capsys.readouterr().out.splitlines()
    assert listed[0].split() == ["name", "looks", "pictures", "added", "until", "consent"]
    assert listed[1].split()[:3] == ["anna", "2", "7"]
    assert listed[1].endswith("signed on paper")
    out = tmp_path / "out"
    assert main(["link", str(monday), "--gallery", str(gallery), "--remember", "7", "--out", str(out)]) == 0
    rows = list(csv.reader((out / "people.csv").read_text().splitlines()))
    assert rows[0] == ["id", "name", "probability"]
    assert len(rows) == 7
    assert len(read_gallery(gallery).people) > 1
    assert main(["gallery", "remove", "anna", "--gallery", str(gallery)]) == 0
    assert "anna" not in (gallery / "gallery.json").read_text()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["add"], "expected whom to add: tsuiseki gallery add NAME"),
        (["add", "anna"], "expected pictures of anna, or RESULT:ID"),
        (["add", "anna", "missing.png"], "missing.png"),
        (["add", "anna", "missing:7"], "missing"),
        (["remove", "anna"], "found no gallery.json"),
        (["list"], "found no gallery.json"),
        (["keep", "anna"], "keep"),
    ],
)
def test_what_cannot_be_done_is_one_line(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["gallery", *words, "--gallery", str(tmp_path / "gallery")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_track_that_is_not_there_is_said(tmp_path: Path) -> None:
    monday = visit(tmp_path / "monday", [0, 1, 2, 3, 4, 5])
    with pytest.raises(RequestError, match="expected the id of a track, one of 1, 2, 3, 4, 5, 6, got 9"):
        add_person(None, "anna", [f"{monday}:9"], colours)
    for path in (tmp_path / "monday" / "video").iterdir():
        path.unlink()
    (tmp_path / "monday" / "video").rmdir()
    with pytest.raises(RequestError, match="its video is not there"):
        add_person(None, "anna", [f"{monday}:1"], colours)


def test_another_network_is_refused(tmp_path: Path) -> None:
    monday = visit(tmp_path / "monday", [0, 1, 2, 3, 4, 5])
    gallery = add_person(None, "anna", [f"{monday}:1"], colours)
    with pytest.raises(RequestError, match="described by network FunctionApp"):
        tsuiseki.link([monday], gallery=gallery)
    with pytest.raises(RequestError, match="needs an appearance network"):
        tsuiseki.link([monday], appearance="none", gallery=gallery)


def test_two_people_under_one_name_are_said(tmp_path: Path) -> None:
    monday = visit(tmp_path / "monday", [0, 1, 2, 3, 4, 5])
    with pytest.warns(InputWarning, match="6 of 12 pictures of 'anna' look like somebody else: "):
        add_person(None, "anna", [f"{monday}:1", f"{monday}:3"], colours)
