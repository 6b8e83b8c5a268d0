"""`tsuiseki track people`: everyone in view, each with an id."""

from __future__ import annotations

from tsuiseki.tracking.cli.options import SeededOutput, Video
from tsuiseki.tracking.people.settings import Linking, PeopleFinding


def people(video: Video, output: SeededOutput, finding: PeopleFinding, linking: Linking) -> int:
    """Track the people in a video: each gets a number that stays.

    Without further options the people are found, described and linked by the models that ship with the toolkit.
    DIR gets tracks.txt (MOTChallenge text), report.html, run.json and, with --overlay, overlay.webm.

    Args:
        seed: of random numbers; kept in run.json, for the methods here draw none.
    """
    from tsuiseki.tracking.cli.detector_lines import tell_blank, tell_models
    from tsuiseki.tracking.cli.run import count, frames_expected
    from tsuiseki.tracking.people.page import counted
    from tsuiseki.tracking.people.tracking import open_people, people_result

    source = video.open(timed=True)
    opened = open_people(source, finding, linking, output.seed)
    with output.run() as run:
        tell_models(run, opened.inputs.detect, opened.inputs.describe)
        found = opened.inputs.found(run.frames(source, record=video.overlay), run.times)
        steps = run.steps(found, total=frames_expected(source))
        result, lines = people_result(opened, steps, run.times, {"method": linking.method, "source": video.source})
        for line in lines:
            print(line)
        tell_blank(opened.inputs.detect)
        run.save(result, lambda: video.draw(run, source, result))
        run.done(f"{counted(result)} in {count(run.count, 'frame', 'frames')}: {output.out / 'tracks.txt'}")
    return run.status
