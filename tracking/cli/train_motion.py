"""`tsuiseki train motion`: how a body that bends moves, from its tracks."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking.cli.options import OutputFile
from tsuiseki.tracking.errors import RequestError


def train_motion(
    tracks: list[Path],
    output: OutputFile,
    body: str = "goldfish",
    frame_rate: float | None = None,
) -> None:
    """Learn how a body moves from tracks of it: the principal components of its changes of shape and motion.

    Good tracks come from a slow, wide run (tsuiseki track deformable --deformable.particles 3000) or from labels. Only
    frames with the status tracking count.

    Args:
        tracks: states.csv files, or folders that hold one.
        out: file to write, JSON; tsuiseki track deformable --motion takes it.
        body: the one that was tracked: goldfish, ball, or a file of tsuiseki train body.
        frame_rate: frames per second of the tracks; by default what run.json or seqinfo.ini beside them says.
    """
    from tsuiseki.tracking.bodies.choice import parse_body
    from tsuiseki.tracking.filters.motion.learnt_motion import write_motion
    from tsuiseki.tracking.formats.states import read_states
    from tsuiseki.trainers.bodies.motion import learn_motion

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
        raise RequestError(f"`frame_rate`: expected a number above 0, got {rate:g}")
    learnt = learn_motion(stretches, shape.name, shape.fields, shape.angles, rate)
    with output.writing() as work:
        write_motion(work, learnt)
    print(f"learnt from {learnt.steps} steps at {rate:g} frames/s: {output.out}")


def _frame_rate_beside(path: Path) -> float:
    """What the run or the sequence that a file of states belongs to says of its frame rate."""
    import json

    from tsuiseki.tracking.formats.mot import read_sequence
    from tsuiseki.tracking.output import RUN_FILE

    run = path.parent / RUN_FILE
    try:
        return float(json.loads(run.read_text(encoding="utf-8"))["facts"]["frame_rate"])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    if (path.parent / "seqinfo.ini").is_file():
        return read_sequence(path.parent).frame_rate
    raise RequestError(f"{path}: no run.json or seqinfo.ini beside it says the frame rate; give `frame_rate`")
