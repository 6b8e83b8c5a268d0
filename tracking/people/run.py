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
    from tsuiseki.tracking.cli.detector_lines import tell_blank, tell_reading
    from tsuiseki.tracking.cli.run import count, frames_expected
    from tsuiseki.tracking.formats.mot import write_tracks
    from tsuiseki.tracking.people.page import PeopleReport, people_page
    from tsuiseki.tracking.people.tracker import run_trackers
    from tsuiseki.tracking.people.tracking import facts_of, open_people
    from tsuiseki.tracking.report.overlay import write_overlay

    source, method = video.open(timed=True), linking.method
    opened = open_people(source, finding, linking, output.seed)
    with output.run() as run:
        tell_reading(run, opened.inputs.detect)
        found = opened.inputs.found(run.frames(source, record=video.overlay), run.times)
        steps = run.steps(found, total=frames_expected(source))
        every, log = run_trackers(steps, {method: opened.tracker}, run.times)
        tracks = every[method]
        milliseconds = 1000 * run.times.seconds.get("detect", 0.0) / max(len(log.frames), 1)
        facts, lines = facts_of(opened, milliseconds)
        run.facts |= facts
        for line in lines:
            print(line)
        tell_blank(opened.inputs.detect)
        run.columns = log.columns(tracks)
        run.write("tracks.txt", lambda path: write_tracks(path, tracks, opened.class_of))
        drawn = video.draw(run, source, lambda path, again: write_overlay(path, again, tracks, source.frame_rate))
        seconds, made = run.times.seconds, {"method": method, "source": video.source}
        page = people_page(PeopleReport(source.name, tracks, log.frames, source.frame_rate, drawn, seconds, made))
        run.write("report.html", lambda path: path.write_text(page, encoding="utf-8"))
        who, length = count(len(tracks), "person", "people"), count(run.count, "frame", "frames")
        run.done(f"{who} in {length}: {output.out / 'tracks.txt'}")
    return run.status
