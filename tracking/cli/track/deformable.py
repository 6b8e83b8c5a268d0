"""`tsuiseki track deformable`: bodies that bend, such as fish seen from above."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking.cli.options import SeededOutput, Video
from tsuiseki.tracking.pipelines.deformable import MotionPreset
from tsuiseki.tracking.trackers.deformable import DeformableSettings

SETTINGS = DeformableSettings()


def deformable(
    video: Video,
    output: SeededOutput,
    body: str = "goldfish",
    motion: Path | None = None,
    preset: MotionPreset | None = None,
    widen: float = 1.0,
    init: list[list[float]] | None = None,
    colour: str = "orange",
    deformable: DeformableSettings = SETTINGS,
) -> int:
    """Track bodies that bend, such as fish seen from above: place, heading and bend of each in every frame.

    DIR gets states.csv (frame, id, the body's state, score, status), states.png (the states over time), run.json and,
    with --overlay, overlay.webm with the contours drawn in.

    Args:
        body: goldfish or ball, with its sizes in pixels where they differ, such as goldfish,length=40,width=14,tail=20,
            or a file of tsuiseki train body.
        motion: what tsuiseki train motion learnt of this body.
        preset: how the body is expected to move. With --motion: learnt draws from what was learnt of shape and motion
            together (the default), conditional also expects a bent body to turn, paper keeps equation (14) as printed,
            independent leaves out the correlation, velocity keeps the velocity in the image, walk keeps the place.
            Without --motion: wide, a random walk of 30 pixels and 45 degrees a frame, which needs some 3000 particles.
        widen: times the learnt deviations; with few particles wider noise, such as 1.6, loses fewer bodies.
        init: state of a body in the first frame, a,b,theta,phi in pixels and radians (for the ball a,b,theta,squash);
            once for each body. By default the bodies are found.
        colour: red, orange, yellow, green, cyan, blue, magenta, black, white, or H1-H2,S1-S2,V1-V2 with hues in
            degrees.
        seed: of the particles.
        deformable: settings of the tracker.
    """
    from tsuiseki.tracking.bodies.choice import parse_body
    from tsuiseki.tracking.cli.run import count, frames_expected
    from tsuiseki.tracking.formats.bodies.states import write_states
    from tsuiseki.tracking.likelihoods.colour_region import parse_colour
    from tsuiseki.tracking.likelihoods.contour import EdgeImage, Extraction
    from tsuiseki.tracking.pipelines.deformable import chosen_motion, columns_of, starting_states
    from tsuiseki.tracking.report.bodies import write_contours
    from tsuiseki.tracking.report.state_plots import plot_states
    from tsuiseki.tracking.trackers.deformable import DeformableTracker

    shape = parse_body(body)
    source = video.open(images=True)
    moves = chosen_motion(shape, motion, preset, source.frame_rate, widen)
    extraction = Extraction(parse_colour(colour), deformable.smooth)
    tracker = DeformableTracker(shape, moves, extraction, deformable, starting_states(init, shape, source), output.seed)
    frames: list[int] = []
    with output.run() as run:
        run.facts["frame_rate"] = source.frame_rate
        for frame in run.steps(run.frames(source, record=video.overlay), total=frames_expected(source)):
            with run.times.measure("edges"):
                edges = EdgeImage.of(frame.image, extraction)
            with run.times.measure("particles"):
                tracker.update_edges(frame.index, edges)
            frames.append(frame.index)
        tracks = tracker.tracks()
        run.columns = columns_of(tracks, frames)
        run.write("states.csv", lambda path: write_states(path, tracks, shape.fields))
        run.write("states.png", lambda path: plot_states(path, shape, tracks))
        video.draw(run, source, lambda path, again: write_contours(path, again, shape, tracks, source.frame_rate))
        seen = sum(int(track.tracking.sum()) for track in tracks)
        bodies, place = count(len(tracks), "body", "bodies"), output.out / "states.csv"
        share = f"seen {100 * seen / max(sum(map(len, tracks)), 1):.0f} %"
        nothing = "" if seen else f"; nothing of the colour {colour} fits a body, give another --colour, or --init"
        run.done(f"{bodies} in {run.count} frames, {share}: {place}{nothing}")
    return run.status
