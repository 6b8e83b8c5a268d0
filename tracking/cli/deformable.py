"""Commands about bodies that bend: `tsuiseki track deformable` and `tsuiseki train motion`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.trackers.deformable import DeformableSettings

if TYPE_CHECKING:
    from collections.abc import Callable

    from tsuiseki.tracking.bodies.body import Body
    from tsuiseki.tracking.filters.body_motion import BodyMotion
    from tsuiseki.tracking.types import FloatArray
    from tsuiseki.tracking.video import Source

Preset = Literal["learnt", "paper", "conditional", "independent", "velocity", "walk", "wide"]
SETTINGS = DeformableSettings()


def track(
    source: str,
    out: Path,
    body: str = "goldfish",
    motion: Path | None = None,
    preset: Preset | None = None,
    widen: float = 1.0,
    init: list[list[float]] | None = None,
    colour: str = "orange",
    frames: str | None = None,
    overlay: bool = False,
    overwrite: bool = False,
    seed: int = 0,
    deformable: DeformableSettings = SETTINGS,
) -> int:
    """Track bodies that bend, such as fish seen from above: place, heading and bend of each in every frame.

    DIR gets states.csv (frame, id, the body's state, score, status), states.png (the states over time), run.json and,
    with --overlay, overlay.webm with the contours drawn in.

    Args:
        source: a video file, a folder of images, a MOTChallenge sequence folder, the number of a webcam or an address.
        out: folder for the results.
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
        frames: track this stretch only, counted from 1 with both ends, such as 301-400.
        overlay: also write a video with the contours drawn in.
        overwrite: replace an earlier result in the folder.
        seed: of the particles.
        deformable: settings of the tracker.
    """
    given = dict(locals())
    from tsuiseki.tracking.bodies.choice import parse_body
    from tsuiseki.tracking.cli.deformable_run import follow, report_end, write_run
    from tsuiseki.tracking.cli.parser import plain
    from tsuiseki.tracking.frame_range import parse_frames
    from tsuiseki.tracking.likelihoods.colour_region import parse_colour
    from tsuiseki.tracking.likelihoods.contour import Extraction
    from tsuiseki.tracking.output import RunRecord, check_output_folder, output_folder
    from tsuiseki.tracking.timing import StageTimes
    from tsuiseki.tracking.trackers.deformable import DeformableTracker
    from tsuiseki.tracking.video import open_source

    check_output_folder(out, overwrite)
    shape = parse_body(body)
    opened = open_source(source, parse_frames(frames))
    if not opened.has_images:
        raise RequestError(f"{opened.name} has no images to look at; expected them in its folder img1/")
    if overlay and opened.live:
        raise RequestError(f"expected a video that can be played again for --overlay, got {opened.name}")
    moves = chosen_motion(shape, motion, preset, opened.frame_rate, widen)
    extraction = Extraction(parse_colour(colour), deformable.smooth)
    tracker = DeformableTracker(shape, moves, extraction, deformable, _starts(init, shape, opened), seed)
    times = StageTimes()
    with output_folder(out, overwrite) as work:
        run = follow(opened, tracker, extraction, times)
        settings = {name: plain(value) for name, value in given.items()} | {"frame_rate": opened.frame_rate}
        record = RunRecord(["tsuiseki", "track", "deformable"], settings, seed, times.seconds)
        write_run(work, run, shape, record, opened, overlay=overlay)
    return report_end(run, out, opened)


def train_motion(
    tracks: list[Path],
    out: Path,
    body: str = "goldfish",
    frame_rate: float | None = None,
    overwrite: bool = False,
) -> None:
    """Learn how a body moves from tracks of it: the principal components of its changes of shape and motion.

    Good tracks come from a slow, wide run (tsuiseki track deformable --deformable.particles 3000) or from labels. Only
    frames with the status tracking count.

    Args:
        tracks: states.csv files, or folders that hold one.
        out: file to write, JSON; tsuiseki track deformable --motion takes it.
        body: the one that was tracked: goldfish, ball, or a file of tsuiseki train body.
        frame_rate: frames per second of the tracks; by default what run.json or seqinfo.ini beside them says.
        overwrite: replace an existing file.
    """
    from tsuiseki.tracking.bodies.choice import parse_body
    from tsuiseki.tracking.filters.learnt_motion import write_motion
    from tsuiseki.tracking.formats.states import read_states
    from tsuiseki.tracking.output import check_output_file, output_file
    from tsuiseki.trainers.motion import learn_motion

    check_output_file(out, overwrite)
    shape = parse_body(body)
    files = [path / "states.csv" if path.is_dir() else path for path in tracks]
    found = [track for path in files for track in read_states(path, shape.fields)]
    stretches = [stretch for track in found for stretch in track.stretches()]
    rates = {frame_rate} if frame_rate is not None else {_frame_rate_beside(path) for path in files}
    if len(rates) != 1:
        several = " and ".join(f"{rate:g}" for rate in sorted(rates))
        raise RequestError(f"expected tracks of one frame rate, got {several}; learn from one at a time")
    rate = float(rates.pop())
    if not 0 < rate < float("inf"):
        raise RequestError(f"--frame-rate: expected a number above 0, got {rate:g}")
    learnt = learn_motion(stretches, shape.name, shape.fields, shape.angles, rate)
    with output_file(out, overwrite) as work:
        write_motion(work, learnt)
    print(f"learnt from {learnt.steps} steps at {rate:g} frames/s: {out}")


def chosen_motion(body: Body, path: Path | None, preset: Preset | None, frame_rate: float, widen: float) -> BodyMotion:
    """The motion that a preset names, at the frame rate of the video, its deviations ``widen`` times as large."""
    from tsuiseki.tracking.filters.body_motion import RandomWalk
    from tsuiseki.tracking.filters.learnt_motion import read_motion
    from tsuiseki.tracking.trackers.body_starts import wide_noise

    if not 0 < widen < float("inf"):
        raise RequestError(f"--widen: expected a number above 0, got {widen:g}")
    if path is None:
        if preset not in (None, "wide"):
            raise RequestError(f"--preset {preset} needs --motion, a file of tsuiseki train motion")
        return RandomWalk(wide_noise(body).widened(widen))
    learnt = read_motion(path, body.name, len(body.fields)).at(frame_rate).widened(widen)
    presets: dict[Preset | None, Callable[[], BodyMotion]] = {
        None: learnt.proposal,
        "learnt": learnt.proposal,
        "paper": learnt.printed_proposal,
        "conditional": learnt.conditional,
        "independent": learnt.independent,
        "velocity": learnt.constant_velocity,
        "walk": learnt.random_walk,
    }
    if preset not in presets:
        raise RequestError("--preset wide uses no --motion; leave one out")
    return presets[preset]()


def _starts(init: list[list[float]] | None, body: Body, source: Source) -> FloatArray | None:
    """The states of --init, checked against the body and the image."""
    import numpy as np

    if init is None:
        return None
    names = ",".join(body.fields)
    height, width = next(iter(source.frames())).image.shape[:2]
    for state in init:
        if len(state) != len(body.fields) or not np.isfinite(state).all():
            raise RequestError(f"--init: expected {names} as {len(body.fields)} finite numbers, got {state}")
        if not (0 <= state[0] < width and 0 <= state[1] < height):
            raise RequestError(
                f"--init: expected a place in the image of {width}x{height}, got {state[0]:g},{state[1]:g}"
            )
        for name, value, (low, high) in zip(body.fields, state, body.limits, strict=True):
            if not low <= value <= high:
                raise RequestError(f"--init: expected {name} from {low:.3g} to {high:.3g}, got {value:g}")
    return np.array(init, dtype=np.float64)


def _frame_rate_beside(path: Path) -> float:
    """What the run or the sequence that a file of states belongs to says of its frame rate."""
    import json

    from tsuiseki.tracking.formats.mot import read_sequence
    from tsuiseki.tracking.output import RUN_FILE

    run = path.parent / RUN_FILE
    try:
        return float(json.loads(run.read_text(encoding="utf-8"))["settings"]["frame_rate"])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    if (path.parent / "seqinfo.ini").is_file():
        return read_sequence(path.parent).frame_rate
    raise RequestError(f"{path}: no run.json or seqinfo.ini beside it says the frame rate; give --frame-rate")
