"""`tsuiseki track people`: everyone in view, each with an id."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.monitor.watching import Watching
from tsuiseki.tracking.people.settings import Linking, PeopleFinding
from tsuiseki.tracking.runs.following import Video, count
from tsuiseki.tracking.runs.options import Output
from tsuiseki.tracking.runs.rolling import LiveOptions

if TYPE_CHECKING:
    from tsuiseki.tracking.counts.scene import Scene
    from tsuiseki.tracking.hiding.run import HideChoice, Hiding
    from tsuiseki.tracking.people.opening import OpenedPeople
    from tsuiseki.tracking.result import Result
    from tsuiseki.tracking.runs.rolling import Watch
    from tsuiseki.tracking.runs.run import Run
    from tsuiseki.tracking.types import Detections, Track
    from tsuiseki.tracking.types.live import CameraState, Observer
    from tsuiseki.tracking.video.source import Source

FINDING, LINKING, LIVE, WATCHING = PeopleFinding(), Linking(), LiveOptions(), Watching()


def people(
    video: Video,
    *,
    output: Output,
    finding: PeopleFinding = FINDING,
    linking: Linking = LINKING,
    live: LiveOptions = LIVE,
    hide: str | None = None,
    corrections: Path | None = None,
    privacy: Path | None = None,
    watching: Watching = WATCHING,
) -> int:
    """Track the people in a video: each gets a number that stays.

    The models that ship with the toolkit detect, describe and link people. DIR gets tracks.txt (MOTChallenge text),
    report.html with its plots and numbers in report/, run.json, with --method flow flow.npz (what tsuiseki review asks
    about) and, with --overlay, overlay.webm.

    Args:
        hide: hide people, heads, or all-but=3,5 in overlay and report.
        corrections: corrections.jsonl of tsuiseki review, to apply to this result.
        privacy: YAML of purpose, area, access and days to keep; see tsuiseki forget.
    """
    return track(video, output, finding, linking, live, hide, corrections, watching, privacy=privacy)


def track(
    video: Video,
    output: Output,
    finding: PeopleFinding,
    linking: Linking,
    live: LiveOptions = LIVE,
    hide: str | None = None,
    corrections: Path | None = None,
    watching: Watching = WATCHING,
    replayed: Callable[[Run, OpenedPeople], tuple[OpenedPeople, Iterator[tuple[int, Detections]]]] | None = None,
    privacy: Path | None = None,
) -> int:
    """`people`, where ``replayed`` may give what runs instead, and each frame's number with its detections."""
    from tsuiseki.tracking.features.view_choice import report_blank, report_models
    from tsuiseki.tracking.formats.mot import detection_lines
    from tsuiseki.tracking.hiding.run import HideChoice
    from tsuiseki.tracking.monitor.recorded import Recorded
    from tsuiseki.tracking.people.following import answers_while_it_runs
    from tsuiseki.tracking.people.opening import open_people
    from tsuiseki.tracking.people.people_result import people_result
    from tsuiseki.tracking.report.track_bars import counted
    from tsuiseki.tracking.result import PageContent, check_corrections

    choice = None if hide is None else HideChoice.parse(hide)
    opening = partial(video.open, images=choice is not None or watching.pictured, timed=True)
    source = live.applied(live.opened(output.out, opening))
    if corrections is not None:
        check_corrections(corrections, source)
    record = _record(privacy)
    opened = open_people(source, finding, linking, 0)
    _check(watching, while_it_runs := answers_while_it_runs(opened.tracker), source, video.overlay)
    if live.roll is not None:
        _check_rolling(video.overlay or bool(corrections) or (bool(hide) and not watching.pictured))
        with watching.own_output():
            return follow(output, opened, live.roll, partial(_watched, output, source, finding, hide, watching), record)
    with watching.own_output(), output.run() as run, _watched(output, source, finding, hide, watching, ()) as observers:
        watched = Recorded(source, observers, while_it_runs)
        run.facts |= report_models(opened.inputs.detect, opened.inputs.describe) | record
        if replayed is None:
            frames = watched.frames(run.frames(source, record=video.overlay or choice is not None))
            detections = opened.inputs.detections(frames, run.times, watching.pictured)
        else:
            opened, detections = replayed(run, opened)
        steps = run.steps(run.kept("detections.txt", detections, None if finding.detections else detection_lines))
        told = {"method": linking.method, "source": video.source, "hide": hide}
        result, lines = people_result(opened, steps, run.times, told, watched.people)
        watched.rest(result.tracks, result.frames["frame"])
        print("".join(f"{line}\n" for line in lines), end="")
        report_blank(opened.inputs.detect)
        if corrections is not None:
            result = result.corrected(corrections)
        result = _with_scene(result, watching.scene_of([source])) if video.overlay else result
        hiding = None if choice is None else _hiding(run, source, result, choice, finding)
        again = None if hiding is None else lambda: hiding.hidden(run.replay(source))
        run.save(
            replace(result, page=PageContent(hide=None if hiding is None else hiding.hidden, quality=True)),
            lambda: video.draw(run, source, result, frames=again) if choice is None or hiding else None,
        )
        run.done(f"{counted(result.tracks)} in {count(run.count, 'frame', 'frames')}: {output.out / 'tracks.txt'}")
    return run.status


def _with_scene(result: Result[Track], scene: Scene | None) -> Result[Track]:
    """The result, whose overlay shows the scene, where there is one, with its counts so far."""
    if scene is None:
        return result
    from tsuiseki.tracking.counts import counting
    from tsuiseki.tracking.counts.scene_drawing import with_scene

    return with_scene(result, counting.count(result, scene))


def _check(watching: Watching, while_it_runs: bool, source: Source, overlay: bool) -> None:
    """Refuse to show what comes at the end only, or what cannot be shown here; and a scene that does not fit."""
    watching.check()
    watching.check_scene(overlay)
    watching.scene_of([source])
    if watching.pictured and not while_it_runs:
        raise RequestError("`page` and `show` need a method that answers while it runs: give `delay`, or `method` sort")


def _check_rolling(whole: bool) -> None:
    if whole:
        raise RequestError("expected `roll` without `overlay`, `hide` and `corrections`, which need it whole")


def _record(privacy: Path | None) -> dict[str, object]:
    """What ``run.json`` says of privacy."""
    from tsuiseki.tracking.privacy import PRIVACY, read_privacy, today

    return {} if privacy is None else {PRIVACY: read_privacy(privacy).facts(today())}


def _watched(
    output: Output,
    source: Source,
    finding: PeopleFinding,
    hide: str | None,
    watching: Watching,
    states: Sequence[CameraState],
) -> AbstractContextManager[list[Observer]]:
    """What watches the run; ``states`` say what the camera has given, where the run counts it."""
    return watching.observers(output.out, [source], states, hide, finding)


def follow(output: Output, opened: OpenedPeople, hours: float, watch: Watch, facts: Mapping[str, object]) -> int:
    """`people`, written while the cameras run."""
    from tsuiseki.tracking.people.live_run import people_live

    number = people_live(output, opened, hours, watch, facts)
    print(f"{count(number, 'person', 'people')}: {output.out}")
    return 0


def _hiding(
    run: Run, source: Source, result: Result[Track], choice: HideChoice, finding: PeopleFinding
) -> Hiding | None:
    """What to hide, whose places in doubt are listed in ``doubtful.csv``; None where that was not finished."""
    from tsuiseki.tracking.hiding.run import SENSITIVE, Hiding, find_missed

    score, written = min(finding.threshold, SENSITIVE), list[Hiding]()
    second = replace(finding, detections=None, classes=None, score_range=None, score_threshold=score)

    def write(path: Path) -> None:
        hiding = find_missed(source, run.replay(source), list(result), choice, second)
        hiding.write_doubts(path)
        written.append(hiding)

    run.draw("doubtful.csv", write)
    for hiding in written:
        print(hiding.summary(run.out / "doubtful.csv"))
    return written[0] if written else None
