"""Scene files: what is read, written again, and refused in one line."""

import numpy as np
import pytest
import yaml

from tsuiseki.tracking.cameras.camera_files import Placed, write_cameras
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.counts.scene import read_scene, scene_text
from tsuiseki.tracking.errors import RequestError

LINE = {"name": "door", "from": [10, 20], "to": [30, 20]}
SHOP = {"name": "shop", "corners": [[0, 0], [40, 0], [40, 40], [0, 40]]}
GOOD = {"size": [64, 48], "lines": [LINE], "zones": [SHOP]}


def read(folder, content):
    path = folder / "scene.yaml"
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return read_scene(path)


def test_a_scene_is_read_and_written_and_read_again(tmp_path):
    scene = read(tmp_path, {**GOOD, "scale": 0.1, "region": [[0, 0], [64, 0], [64, 48]], "ignored": [SHOP["corners"]]})
    assert (scene.size, scene.unit, scene.scale) == ((64, 48), "pixels", 0.1)
    assert scene.lines[0].directions == ("in", "out")
    again = read(tmp_path, scene_text(scene))
    assert scene_text(again) == scene_text(scene)
    assert np.array_equal(again.zones[0].corners, SHOP["corners"])


def test_a_camera_beside_the_scene_gives_metres_and_moves_the_scene_to_the_floor(tmp_path):
    camera = PinholeCamera.look_at(np.array([0.0, -5, 4]), np.zeros(3), 60.0, 64, 48)
    write_cameras(tmp_path / "cameras.yaml", [Placed("left", camera)])
    scene = read(tmp_path, {**GOOD, "zones": [], "lines": [{**LINE, "from": [10, 40]}], "camera": "cameras.yaml"})
    floor = scene.on_floor()
    back, _ = camera.project(np.insert(floor.lines[0].ends, 2, 0.0, axis=1))
    assert np.allclose(back, scene.lines[0].ends)
    assert floor.right_is == -1
    with pytest.raises(RequestError, match="got 64x48"):
        read(tmp_path, {**GOOD, "size": [32, 32], "lines": [], "camera": "cameras.yaml"})
    with pytest.raises(RequestError, match="one of left, got 'right'"):
        read(tmp_path, {**GOOD, "camera": {"file": "cameras.yaml", "name": "right"}})
    for elsewhere in ("../cameras.yaml", str(tmp_path / "cameras.yaml")):
        with pytest.raises(RequestError, match="beside the scene"):
            read(tmp_path, {**GOOD, "camera": elsewhere})


def changed(**fields):
    return {**GOOD, **fields}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (": [", "expected YAML"),
        ("- 1", "expected the fields size"),
        (changed(line=[]), "expected the fields .* got 'line'"),
        ({"size": [64, 48]}, "at least one entry"),
        (changed(unit="feet"), "pixels or metres"),
        (changed(unit="metres"), "need a scale or a camera"),
        (changed(scale=0), "above 0"),
        (changed(scale=float("nan")), "above 0"),
        (changed(size=[64.5, 48]), "width, height"),
        (changed(lines={}), "a list of"),
        (changed(lines=[{"name": "a", "from": [1, 2]}]), "found no to"),
        (changed(lines=[{**LINE, "to": [10, 20]}]), "one point"),
        (changed(lines=[{**LINE, "to": [10]}]), "points such as"),
        (changed(lines=[{**LINE, "to": [10, float("inf")]}]), "points such as"),
        (changed(lines=[{**LINE, "to": [10, "a"]}]), "points such as"),
        (changed(lines=[{**LINE, "to": [640, 20]}]), "places in the picture"),
        (changed(lines=[{**LINE, "directions": ["in"]}]), "two names"),
        (changed(lines=[{**LINE, "directions": ["in", "in"]}]), "different names"),
        (changed(lines=[LINE, LINE]), "door twice"),
        (changed(zones=[{**SHOP, "name": "door"}]), "door twice"),
        (changed(lines=[{**LINE, "name": "<b>door</b>"}]), "leave markup out"),
        (changed(lines=[{**LINE, "name": "=1+1"}]), "leave markup out"),
        (changed(lines=[{**LINE, "name": True}]), "put it into quotes"),
        (changed(lines=[{**LINE, "name": "  "}]), "put it into quotes"),
        (changed(lines=[{**LINE, "name": "x" * 61}]), "up to 60"),
        (changed(zones=[{**SHOP, "corners": [[0, 0], [4, 4]]}]), "3 to 1000 corners"),
        (changed(zones=[{**SHOP, "corners": [[0, 0], [4, 4], [8, 8]]}]), "cross itself"),
        (changed(zones=[{**SHOP, "corners": [[0, 0], [9, 9], [9, 0], [0, 9]]}]), "cross itself"),
        (changed(zones=[{**SHOP, "corners": [[0, 0], [0, 0], [9, 0], [0, 9]]}]), "apart from each other"),
        (changed(zones=[SHOP, {"name": "b", "corners": [[20, 20], [60, 20], [60, 30]]}]), "shop and b cross"),
        (changed(ignored=[[1, 2]]), "points such as"),
    ],
)  # fmt: skip
def test_what_is_no_scene_is_refused_in_one_line(tmp_path, content, said):
    with pytest.raises(RequestError, match=said) as refused:
        read(tmp_path, content)
    assert "\n" not in str(refused.value)
    assert "scene.yaml" in str(refused.value)


def test_zones_may_lie_inside_each_other(tmp_path):
    inner = {"name": "till", "corners": [[10, 10], [20, 10], [20, 20]]}
    assert len(read(tmp_path, changed(zones=[SHOP, inner])).zones) == 2


def test_a_video_of_another_size_is_refused(tmp_path):
    scene = read(tmp_path, GOOD)
    scene.check_video((64, 48))
    with pytest.raises(RequestError, match="got 64x48, and the video has 1920x1080; draw"):
        scene.check_video((1920, 1080))
    sizeless = read(tmp_path, {key: value for key, value in GOOD.items() if key != "size"})
    with pytest.raises(RequestError, match="the video has 20x20"):
        sizeless.check_video((20, 20))
