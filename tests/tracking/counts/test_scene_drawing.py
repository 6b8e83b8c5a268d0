"""Lines, zones and the counts so far, drawn over pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.tracking.counts.walkers import down, walker
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.counts import scene_drawing
from tsuiseki.tracking.counts.counting import count
from tsuiseki.tracking.counts.scene import Scene, SceneLine, SceneZone
from tsuiseki.tracking.counts.scene_drawing import draw_scene, with_scene
from tsuiseki.tracking.result import Result

SIZE = (640, 480)
LINE = SceneLine("door", np.array([[0.0, 200.0], [600.0, 200.0]]))
ZONE = SceneZone("shop", np.array([[0.0, 200], [600, 200], [600, 470], [0, 470]]))
SCENE = Scene([LINE], [ZONE], SIZE)
TRACKS = [walker(down(60 + 60 * k, range(60 + 5 * k, 350, 10)), k + 1) for k in range(4)]


def test_lines_and_zones_are_drawn_and_an_arrow_shows_the_first_direction() -> None:
    image = np.zeros((480, 640, 3), np.uint8)
    draw_scene(image, Scene([LINE], (), SIZE), {})
    assert image[200, 500].min() > 200
    assert image[230:, :].max() == 0
    below, above = image[204:225, 250:350], image[175:196, 250:350]
    # Who walks to the right of a line that leads to the right walks down.
    assert (below > 200).sum() > 0
    assert (above > 200).sum() == 0
    draw_scene(image, SCENE, {})
    assert image[470, 300].min() > 200


@pytest.mark.parametrize("direction", [1, -1])
def test_the_arrow_is_that_of_the_count(direction: int) -> None:
    scene = Scene([SceneLine("door", LINE.ends[::direction])], (), SIZE)
    image = np.zeros((480, 640, 3), np.uint8)
    draw_scene(image, scene, {})
    counted = count(Result(TRACKS, "", 10.0, SIZE), scene).count("door", "in")[0]
    assert counted == (4 if (image[206:225, 250:350] > 200).any() else 0)
    assert (image[206:225, 250:350] > 200).any() == (direction == 1)


def test_the_last_counts_are_those_of_the_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    texts = list[dict[str, str]]()
    monkeypatch.setattr(scene_drawing, "draw_scene", lambda *values: texts.append(values[2]))
    result, image = Result(TRACKS, "", 10.0, SIZE), np.zeros((480, 640, 3), np.uint8)
    answers = count(result, SCENE)
    drawn = with_scene(result, answers)
    for frame in range(answers.length):
        drawn.draw(image, frame)
    number = answers.count("door", "in")[0]
    assert number == 4
    assert (texts[0]["door"], texts[-1]["door"]) == ("in 0, out 0", f"in {number}, out 0")
    assert [int(text["shop"]) for text in texts] == answers.occupancy["shop"].tolist()
    ins = [int(text["door"].split()[1].strip(",")) for text in texts]
    assert ins == sorted(ins)


@pytest.mark.slow
def test_count_and_track_draw_the_scene(tmp_path: Path, inputs) -> None:  # type: ignore[no-untyped-def]
    scene = tmp_path / "scene.yaml"
    scene.write_text("lines: [{name: d, from: [0, 44], to: [60, 44]}]\n")
    words = ["track", "people", str(inputs.images), "--fps", "4", "--detections", str(inputs.detections), "--overlay"]
    words += ["--method", "sort"]
    frames = {}
    for name, more in (("plain", []), ("drawn", ["--scene", str(scene)])):
        assert main([*words, *more, "--out", str(tmp_path / name)]) == 0
        frames[name] = last_frame(tmp_path / name / "overlay.webm")
    out = tmp_path / "answers"
    assert main(["count", str(tmp_path / "plain"), "--scene", str(scene), "--overlay", "--out", str(out)]) == 0
    frames["counted"] = last_frame(out / "overlay.webm")
    plain, drawn, counted = (frame.astype(float) for frame in frames.values())
    assert np.abs(drawn - plain).mean() > 10
    assert np.abs(drawn - counted).mean() < 1


def last_frame(path: Path) -> np.ndarray:
    from tsuiseki.tracking.video.source import open_source

    return [frame.image for frame in open_source(path).frames()][-1]


def test_a_result_whose_people_are_hidden_is_not_drawn(
    tmp_path: Path,
    inputs,
    capsys: pytest.CaptureFixture[str],  # type: ignore[no-untyped-def]
) -> None:
    scene, run = tmp_path / "scene.yaml", tmp_path / "run"
    scene.write_text("lines: [{name: d, from: [0, 44], to: [60, 44]}]\n")
    words = ["track", "people", str(inputs.images), "--fps", "4", "--detections", str(inputs.detections)]
    assert main([*words, "--method", "sort", "--out", str(run)]) == 0
    record = run / "run.json"
    record.write_text(record.read_text().replace('"hide": null', '"hide": "people"'))
    assert main(["count", str(run), "--scene", str(scene), "--overlay", "--out", str(tmp_path / "o")]) == 2
    assert "expected a result without --hide for --overlay" in capsys.readouterr().err
