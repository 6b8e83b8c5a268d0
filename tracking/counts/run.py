"""`tsuiseki count`: answers about the people in a finished result; `tsuiseki scene`: what to count, drawn.

The user draws a scene on a picture of the video, on a page in the browser.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.counts.scene import Scene, read_scene, scene_of, scene_text
from tsuiseki.tracking.counts.settings import CountSettings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.fields import FrameRate
from tsuiseki.tracking.privacy import PRIVACY, today
from tsuiseki.tracking.report.drawing import drawn_on
from tsuiseki.tracking.runs.following import count as counted
from tsuiseki.tracking.runs.options import Output, OutputFile


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class SceneFile(OutputFile):
    """The file of lines and zones.

    Attributes:
        out: the scene file to write.
    """

    out: Path = Path("scene.yaml")


COUNTING, SCENE_FILE = CountSettings(), SceneFile()


def count(
    result: Path,
    *,
    scene: Path,
    how: CountSettings = COUNTING,
    output: Output,
    fps: FrameRate | None = None,
    overlay: bool = False,
) -> int:
    """Count the people of a result: crossings of lines, people in zones, and how long they stay.

    DIR gets answers.json, a CSV for each table, plots, report.html, run.json and, with --overlay, overlay.webm.

    Args:
        result: folder of a result, or a file of tracks.
        scene: YAML of lines and zones; tsuiseki scene draws it.
        fps: frames a second, where the result does not say.
        overlay: also write the video with tracks, lines, zones and the counts so far.
    """
    from tsuiseki.tracking.counts import counting
    from tsuiseki.tracking.counts.page import TrackedPage, summary
    from tsuiseki.tracking.counts.scene_drawing import with_scene
    from tsuiseki.tracking.result import Result

    loaded: Result[Any] = Result.load(result)
    privacy = read_scene(scene).privacy
    if overlay and loaded.settings.get("hide"):
        raise RequestError("expected a result without `hide` for `overlay`, which would show everybody; leave it out")
    with output.run() as run:
        record = loaded.facts.get(PRIVACY) if privacy is None else privacy.facts(today())
        if record is not None:
            run.facts.setdefault(PRIVACY, record)
        loaded = replace(loaded, facts={**loaded.facts, **run.facts})
        with run.times.measure("count"):
            answers = counting.count(loaded, str(scene), how, frame_rate=fps)
        if overlay:
            run.draw("overlay.webm", with_scene(loaded, answers).overlay)
        shown = run.work if overlay or not result.is_dir() else result
        for name, write in TrackedPage(loaded, answers=answers).files().items():
            run.write(name, write, shown)
        run.done("\n".join(summary(answers)))
    return run.status


def scene(video: Path, *, output: SceneFile = SCENE_FILE) -> None:
    """Draw lines and zones on the first frame of a video, on a page in the browser, for tsuiseki count.

    Args:
        video: a video file, a folder of images, or a sequence folder.
    """
    from tsuiseki.tracking.video.source import open_source

    opened = open_source(video)
    if not opened.has_images:
        raise RequestError(f"{opened.name} has no images to draw on; expected them in its folder img1/")
    image = next(iter(opened.frames())).image
    size = [image.shape[1], image.shape[0]]

    def taken(answer: Any) -> Scene:
        if not isinstance(answer, dict) or answer.get("size") != size or "camera" in answer:
            raise RequestError(f"scene: expected lines and zones in a picture of {size[0]}x{size[1]}")
        return scene_of(answer, "scene", Path())

    drawn = drawn_on(image, "scene.html", taken, "draw the scene", "write the scene by hand instead")
    output.write(output.out, lambda path: path.write_text(scene_text(drawn), encoding="utf-8"))
    lines, zones = counted(len(drawn.lines), "line", "lines"), counted(len(drawn.zones), "zone", "zones")
    print(f"{lines}, {zones}: {output.out}")
