"""`tsuiseki track deformable`: bodies that bend, such as fish seen from above."""

from __future__ import annotations

from tsuiseki.tracking.bodies.tracking import BodyChoice
from tsuiseki.tracking.cli.options import SeededOutput, Video


def deformable(video: Video, output: SeededOutput, choice: BodyChoice) -> int:
    """Track bodies that bend, such as fish seen from above: place, heading and bend of each in every frame.

    DIR gets states.csv (frame, id, the body's state, score, status), states.png (the states over time), run.json and,
    with --overlay, overlay.webm with the contours drawn in.

    Args:
        seed: of the particles.
    """
    from tsuiseki.tracking.bodies.page import write_contours
    from tsuiseki.tracking.bodies.state_plots import plot_states
    from tsuiseki.tracking.bodies.tracking import CONTRASTS, columns_of
    from tsuiseki.tracking.cli.run import count, frames_expected
    from tsuiseki.tracking.formats.body_states import write_states

    source = video.open(images=True)
    tracker = choice.tracker(source, output.seed)
    body, frames = tracker.body, list[int]()
    with output.run() as run:
        run.facts["frame_rate"] = source.frame_rate
        for frame in run.steps(run.frames(source, record=video.overlay), total=frames_expected(source)):
            with run.times.measure("edges"):
                edges = tracker.edges(frame)
            with run.times.measure("particles"):
                tracker.update_edges(frame.index, edges)
            frames.append(frame.index)
        tracks = tracker.tracks()
        run.columns = columns_of(tracks, frames)
        run.write("states.csv", lambda path: write_states(path, tracks, body.fields))
        run.write("states.png", lambda path: plot_states(path, body, tracks))
        video.draw(run, source, lambda path, again: write_contours(path, again, body, tracks, source.frame_rate))
        seen = sum(int(track.tracking.sum()) for track in tracks)
        bodies, place = count(len(tracks), "body", "bodies"), output.out / "states.csv"
        share = f"seen {100 * seen / max(sum(map(len, tracks)), 1):.0f} %"
        what = "that stands out" if choice.colour in CONTRASTS else f"of the colour {choice.colour}"
        hint = f"; nothing {what} fits a body, give another --colour, or --init"
        run.done(f"{bodies} in {run.count} frames, {share}: {place}{'' if seen else hint}")
    return run.status
