"""`tsuiseki count`: answers about the people in a finished result."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tsuiseki.tracking.answers.settings import CountSettings
from tsuiseki.tracking.cli.options import Output


def count(result: Path, /, scene: Path, how: CountSettings, output: Output, fps: float | None = None) -> int:
    """Count the people of a result: crossings of lines, people in zones, and how long they stay.

    DIR gets answers.json, a CSV for each table, plots, report.html and run.json.

    Args:
        result: folder of a result, or a file of tracks.
        scene: YAML of lines and zones; tsuiseki scene draws it.
        fps: frames a second, where the result does not say.
    """
    from tsuiseki.tracking.answers import counting
    from tsuiseki.tracking.answers.page import files_of, summary
    from tsuiseki.tracking.result import Result

    found: Result[Any] = Result.load(result)
    with output.run() as run:
        with run.times.measure("count"):
            answers = counting.count(found, str(scene), how, frame_rate=fps)
        for name, write in files_of(answers, found.name or result.name).items():
            run.write(name, write, run.work)
        run.done("\n".join([*summary(answers), f"answers: {output.out}"]))
    return run.status
