"""Clips that are scored in chapter 5 are none that something was learnt from."""

from pathlib import Path

import pytest

from benchmarks.papers import drone_actions as drone
from benchmarks.papers.store import Store
from tsuiseki.tracking.errors import RequestError


@pytest.mark.parametrize("size", [(3, 2, 300), (5, 10, 600)])
def test_the_clips_of_the_tables_are_new(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: tuple[int, int, int]
) -> None:
    planned: list[list[object]] = []

    def stop(_: object, every: list[object]) -> None:
        planned.append(every)
        raise InterruptedError

    monkeypatch.setattr(drone, "on_all_cores", stop)
    seeds, clips, frames = size
    with pytest.raises(InterruptedError):
        drone.reproduce(store=Store(tmp_path), seeds=seeds, clips=clips, frames=frames)
    assert len(planned[0]) == seeds * clips + clips


@pytest.mark.parametrize("size", [(171, 1), (1, 11001)])
def test_a_clip_that_something_was_learnt_from_is_refused(tmp_path: Path, size: tuple[int, int]) -> None:
    with pytest.raises(RequestError, match="got seed 20000"):
        drone.reproduce(store=Store(tmp_path), seeds=size[0], clips=size[1], frames=10)
