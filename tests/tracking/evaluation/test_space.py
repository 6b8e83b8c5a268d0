"""Distances in space against closed forms, and the files they are read from."""

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.space import (
    distance_to_path,
    distance_to_position,
)
from tsuiseki.tracking.formats.world_tables import read_path3d, write_track3d
from tsuiseki.tracking.types import Position
from tsuiseki.tracking.types.tracks import Path3D


def test_distance_to_the_path_forgives_being_late_and_distance_to_the_position_does_not():
    truth = Path3D(np.arange(5.0), np.arange(5.0)[:, None] * [1, 0, 0])
    late = Path3D(np.arange(1.0, 5.0), np.arange(4.0)[:, None] * [1, 0, 0] + [0, 0.3, 0.4])
    np.testing.assert_allclose(distance_to_path(late.points, truth.points), 0.5)
    np.testing.assert_allclose(distance_to_position(late, truth), np.sqrt(1.25))


def test_beyond_the_ends_the_path_is_its_end_and_the_position_unknown():
    truth = Path3D(np.array([0.0, 1.0]), np.array([[0.0, 0, 0], [1, 0, 0]]))
    assert distance_to_path(np.array([[4.0, 4.0, 0.0]]), truth.points)[0] == pytest.approx(5.0)
    assert np.isnan(distance_to_position(Path3D(np.array([1.5]), np.zeros((1, 3))), truth)).all()


def test_a_track_is_read_back(tmp_path):
    positions = [Position(0.1 * k, np.array([k, 0.5, -1.0]), np.eye(3) * 1e-4, 0.9, "tracking") for k in range(3)]
    write_track3d(tmp_path / "track3d.csv", positions)
    found = read_path3d(tmp_path / "track3d.csv")
    np.testing.assert_allclose(found.points, [[k, 0.5, -1.0] for k in range(3)])
    header, first, *_ = (tmp_path / "track3d.csv").read_text().splitlines()
    assert header == "time,x,y,z,xx,xy,xz,yy,yz,zz,score,status"
    assert first == "0,0,0.5,-1,0.0001,0,0,0.0001,0,0.0001,0.9,tracking"


@pytest.mark.parametrize("text", ["", "time,x,y\n0,1,2\n", "time,x,y,z\n0,1,2,far\n", "time,x,y,z\n0,1,2,nan\n"])
def test_wrong_tracks_are_refused(tmp_path, text):
    (tmp_path / "truth.csv").write_text(text)
    with pytest.raises(RequestError, match="expected"):
        read_path3d(tmp_path / "truth.csv")
