"""The shipped models are found by name."""

from __future__ import annotations

import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.weights import shipped, shipped_names


def test_every_shipped_model_is_found() -> None:
    assert {"detector_street", "appearance_people", "affinity_people", "objectness_scenes"} <= set(shipped_names())
    for name in shipped_names():
        assert shipped(name).stem == name
        assert shipped(name).is_file()


def test_an_unknown_name_says_which_was_meant() -> None:
    with pytest.raises(RequestError, match="did you mean detector_street"):
        shipped("detector_streets")
    with pytest.raises(RequestError, match="expected one of action_drone"):
        shipped("zebra")
