"""`tsuiseki track people`: everyone in view, each with an id."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from tsuiseki.tracking.cli.options import SeededOutput, Video
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.people.settings import Linking, PeopleFinding

if TYPE_CHECKING:
    from tsuiseki.tracking.cli.run import Run
    from tsuiseki.tracking.people.hidden_places import Wanted
    from tsuiseki.tracking.result import Result
    from tsuiseki.tracking.types import Frame, Track
    from tsuiseki.tracking.video.source import Source


def people(
    video: Video, output: SeededOutput, finding: PeopleFinding, linking: Linking, hide: str | None = None
) -> int:
    """Track the people in a video: each gets a number that stays.

    Without further options the people are found, described and linked by the models that ship with the toolkit.
    DIR gets tracks.txt (MOTChallenge text), report.html, run.json and, with --overlay, overlay.webm.

    Args:
        seed: of random numbers; kept in run.json, for the methods here draw none.
        hide: in the overlay hide people, heads, or all-but the tracks with these ids, such as all-but 3,5; see
            tsuiseki hide.
    """
    from tsuiseki.tracking.cli.detector_lines import tell_blank, tell_models
    from tsuiseki.tracking.cli.run import count, frames_expected
    from tsuiseki.tracking.formats.mot import detection_lines
    from tsuiseki.tracking.people.hidden_places import Wanted
    from tsuiseki.tracking.people.page import counted
    from tsuiseki.tracking.people.tracking import open_people, people_result

    wanted = None if hide is None else Wanted.parse(hide)
    if wanted is not None and not video.overlay:
        raise RequestError("expected `hide` with `overlay`, got it without a picture to hide people in")
    source = video.open(timed=True)
    opened = open_people(source, finding, linking, output.seed)
    with output.run() as run:
        tell_models(run, opened.inputs.detect, opened.inputs.describe)
        found = opened.inputs.found(run.frames(source, record=video.overlay), run.times)
        kept = run.kept("detections.txt", found, None if finding.detections else detection_lines)
        steps = run.steps(kept, total=frames_expected(source))
        result, lines = people_result(opened, steps, run.times, {"method": linking.method, "source": video.source})
        for line in lines:
            print(line)
        tell_blank(opened.inputs.detect)
        frames = None if wanted is None else partial(_hidden, run, source, result, wanted, finding)
        run.save(result, lambda: video.draw(run, source, result, frames=frames))
        run.done(f"{counted(result)} in {count(run.count, 'frame', 'frames')}: {output.out / 'tracks.txt'}")
    return run.status


def _hidden(run: Run, source: Source, result: Result[Track], wanted: Wanted, finding: PeopleFinding) -> Iterator[Frame]:
    """The finished frames with people hidden; the places in doubt are listed in ``doubtful.csv``."""
    from tsuiseki.tracking.people.hiding import SENSITIVE, look_again

    score = min(finding.threshold, SENSITIVE)
    second = replace(finding, detections=None, classes=None, score_range=None, score_threshold=score)
    hiding = look_again(source, run.replay(source), list(result), wanted, second)
    run.write("doubtful.csv", hiding.write_doubts)
    print(hiding.summary(run.output.out / "doubtful.csv"))
    yield from hiding.hidden(run.replay(source))
