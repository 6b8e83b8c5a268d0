"""Learning for the tracker of drone video: its costs, and what people do, from the data to the tracks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.datamodules.scenes.drone_clip import DroneClip, DroneSceneSettings
from tsuiseki.tracking.association.evidence import JOIN_FEATURES, LINK_FEATURES
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.drone.settings import DRONE_FLOW
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.association import Association
from tsuiseki.trainers.exporting.written_costs import export_association
from tsuiseki.trainers.flow.videos import between, detected_videos, filmed
from tsuiseki.trainers.flow.windows import AssociationData

FRAMES = 10
ACTION = "action_drone_rgb_local"


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    settings = DroneSceneSettings(320, 180, FRAMES, 10.0, people=6, camera="calm", altitude=(10.0, 20.0), samples=1)
    return write_clip(tmp_path_factory.mktemp("drone") / "clip", DroneClip(settings, 3))


@pytest.mark.slow
def test_what_people_do_is_a_feature_of_links_and_joins(clip: Path) -> None:
    graphs = []
    for action in (None, [shipped(ACTION)]):
        data = AssociationData([clip], val_share=0.1, detections="simulated", tracker="drone", action=action)
        data.setup("fit")
        graphs.append(data.learnt[0])
    without, acting = graphs
    column, known = (LINK_FEATURES.index(name) for name in ("action", "action_known"))
    assert not without.detections.links[:, [column, known]].any()
    rows = acting.detections.links
    # Over less time than the cost asks for, place and motion say more; there it is 0, and known all the same.
    assert DRONE_FLOW.costs.link.action is not None
    least = DRONE_FLOW.costs.link.action.least
    far = rows[:, LINK_FEATURES.index("seconds")] >= least
    assert far.any()
    assert (rows[:, known] == 1).all()
    assert np.unique(rows[far, column]).size > 3
    assert not rows[~far, column].any()
    assert (acting.tracklets.links[:, JOIN_FEATURES.index("action_known")] == 1).all()


def test_the_training_prices_as_the_tracker_it_is_for(clip: Path) -> None:
    data, module = AssociationData([clip], detections="simulated", tracker="drone"), Association()
    data.setup("fit")
    assert module.link_cost != data.settings.costs.link == DRONE_FLOW.costs.link
    costs, count = data.learnt[0].detections.costs, len(data.learnt[0].detections)
    assert set(costs[count : 2 * count]) == {DRONE_FLOW.costs.entry}


def test_the_camera_is_followed_in_the_images(clip: Path) -> None:
    (video,) = detected_videos([clip], "simulated")
    with_images = between(filmed(video), 2, 9)
    path = with_images.path()
    assert path is not None
    assert len(path) == 7
    assert len(path.unknown) == 0
    assert video.path() is None
    # The clip's camera hovers: it moves, by little.
    shift = np.linalg.norm(path.transforms[-1][:, 2])
    assert 0 < shift < 60
    with pytest.raises(RequestError, match=r"expected an image a frame in img1/ for the camera's motion, got 0"):
        filmed(replace(video, images=()))


def test_videos_in_the_layout_of_okutama_have_images_and_the_rate_that_is_told(tmp_path: Path) -> None:
    settings = DroneSceneSettings(320, 180, FRAMES, 10.0, people=6, camera="calm", altitude=(10.0, 20.0), samples=1)
    folder = write_clip(tmp_path / "okutama", DroneClip(replace(settings, layout="okutama"), 3))
    (video,) = detected_videos([folder], "simulated", frame_rate=10.0)
    assert len(video.images) == len(video.detections) == FRAMES
    assert video.size == (320, 180)
    assert video.frame_rate == 10.0
    assert len(filmed(video).camera) == FRAMES
    with pytest.raises(RequestError, match="seconds and frame_rate above 0"):
        AssociationData([folder], frame_rate=0.0)


def test_people_have_no_price_of_actions(clip: Path) -> None:
    with pytest.raises(RequestError, match=r"expected --data\.tracker drone with --data\.action"):
        AssociationData([clip], action=[shipped(ACTION)])


@pytest.mark.slow
def test_the_drone_is_tracked_with_what_was_learnt(clip: Path, tmp_path: Path) -> None:
    module = Association(trust=1.0)
    # Nobody is worth a track.
    torch.nn.init.constant_(module.network.detections.linear.bias, 30.0)
    export_association(module.network, tmp_path / "association.onnx")
    words = ["track", "drone", str(clip), "--detections", str(clip / "gt/gt.txt"), "--method", "flow"]
    for name, more in (("default", []), ("learnt", ["--affinity", str(tmp_path / "association.onnx")])):
        assert main([*words, "--out", str(tmp_path / name), *more]) == 0
    assert (tmp_path / "default" / "tracks.txt").read_text()
    assert not (tmp_path / "learnt" / "tracks.txt").read_text()


def test_costs_of_pairs_are_refused(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["track", "drone", str(clip), "--affinity", str(shipped("affinity_people")), "--out", str(tmp_path / "out")]
    assert main(words) == 2
    assert "got costs learnt on pairs; use --preset printed" in capsys.readouterr().err
