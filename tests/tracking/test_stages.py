"""Stages share out the time of a run."""

from __future__ import annotations

import pytest

from tsuiseki.tracking.stages import StageTimes


def test_stages_of_several_threads_take_no_longer_than_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    now, thread, times = [0.0], [1], StageTimes()
    monkeypatch.setattr("time.perf_counter", lambda: now[0])
    monkeypatch.setattr("threading.get_ident", lambda: thread[0])

    def at(second: float, of: int) -> None:
        now[0], thread[0] = second, of

    with times.measure("detect"):
        at(1, 2)
        with times.measure("decode"):
            at(3, 2)
        at(4, 1)
        # What is measured within a stage counts once.
        with times.measure("describe"):
            at(6, 1)
    # What nobody measures is left out.
    at(9, 1)
    with times.measure("link"):
        at(10, 1)
    assert times.seconds == {"detect": 3.0, "decode": 1.0, "describe": 2.0, "link": 1.0}
