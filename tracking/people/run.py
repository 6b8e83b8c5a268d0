"""`tsuiseki track people`: everyone in view, each with an id."""

from __future__ import annotations

from tsuiseki.tracking.cli.options import SeededOutput, Video
from tsuiseki.tracking.people.files import Linking, PeopleFinding


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
    from tsuiseki.tracking.people.files import facts_of, opened
    from tsuiseki.tracking.people.frame_log import FrameLog, shifted
    from tsuiseki.tracking.people.page import PeopleReport, people_page
    from tsuiseki.tracking.report.overlay import write_overlay

    source, method = video.open(timed=True), linking.method
    inputs, tracker, class_of = opened(source, finding, linking, output.seed)
    log = FrameLog()
    with output.run() as run:
        tell_reading(run, inputs.detect)
        frames = run.frames(source, record=video.overlay)
        for index, found in run.steps(inputs.found(frames, run.times), total=frames_expected(source)):
            log.add(index, found)
            with run.times.measure(method):
                tracker.update(found)
        with run.times.measure(method):
            tracks = [shifted(track, log.frames[0]) for track in tracker.tracks()]
        milliseconds = 1000 * run.times.seconds.get("detect", 0.0) / max(len(log.frames), 1)
        facts, lines = facts_of(inputs, tracker, milliseconds)
        run.facts |= facts
        for line in lines:
            print(line)
        tell_blank(inputs.detect)
        run.columns = log.columns(tracks)
        run.write("tracks.txt", lambda path: write_tracks(path, tracks, class_of))
        drawn = video.draw(run, source, lambda path, again: write_overlay(path, again, tracks, source.frame_rate))
        seconds, made = run.times.seconds, {"method": method, "source": video.source}
        page = people_page(PeopleReport(source.name, tracks, log.frames, source.frame_rate, drawn, seconds, made))
        run.write("report.html", lambda path: path.write_text(page, encoding="utf-8"))
        who, length = count(len(tracks), "person", "people"), count(run.count, "frame", "frames")
        run.done(f"{who} in {length}: {output.out / 'tracks.txt'}")
    return run.status
