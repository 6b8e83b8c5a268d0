"""`tsuiseki count`: answers about the people in a finished result; `tsuiseki scene`: what to count, drawn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tsuiseki.tracking.answers.settings import CountSettings
from tsuiseki.tracking.cli.run import Output
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.options import OutputFile

SCENE_FILE = OutputFile(out=Path("scene.yaml"))


def count(result: Path, /, scene: Path, how: CountSettings, output: Output, fps: float | None = None) -> int:
    """Count the people of a result: crossings of lines, people in zones, and how long they stay.

    DIR gets answers.json, a CSV for each table, plots, report.html and run.json.

    Args:
        result: folder of a result, or a file of tracks.
        scene: YAML of lines and zones; tsuiseki scene draws it.
        fps: frames a second, where the result does not say.
    """
    from tsuiseki.tracking.answers import counting
    from tsuiseki.tracking.answers.page import TrackedPage, summary
    from tsuiseki.tracking.result import Result

    found: Result[Any] = Result.load(result)
    with output.run() as run:
        with run.times.measure("count"):
            answers = counting.count(found, str(scene), how, frame_rate=fps)
        for name, write in TrackedPage(found, answers=answers).files().items():
            run.write(name, write, result if result.is_dir() else run.work)
        run.done("\n".join([*summary(answers), f"answers: {output.out}"]))
    return run.status


def scene(video: Path, /, output: OutputFile = SCENE_FILE) -> None:
    """Draw lines and zones on the first frame of a video, on a page in the browser, for tsuiseki count.

    Args:
        video: a video file, a folder of images, or a sequence folder.
        out: the scene file to write.
    """
    from tsuiseki.tracking.answers.drawing_page import draw_scene
    from tsuiseki.tracking.answers.scene import scene_text
    from tsuiseki.tracking.video.source import open_source

    opened = open_source(video)
    if not opened.has_images:
        raise RequestError(f"{opened.name} has no images to draw on; expected them in its folder img1/")
    drawn = draw_scene(next(iter(opened.frames())).image)
    output.write(output.out, lambda path: path.write_text(scene_text(drawn), encoding="utf-8"))
    print(f"{len(drawn.lines)} lines, {len(drawn.zones)} zones: {output.out}")
