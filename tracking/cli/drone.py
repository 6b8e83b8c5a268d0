"""`tsuiseki track drone`: follow people in video from a drone, and say what they do."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.frame_range import parse_frames
from tsuiseki.tracking.trackers.bridging import BridgingSettings
from tsuiseki.tracking.trackers.drone import DroneSettings

DroneMethod = Literal["flow", "flow-saf", "flow-maf"]
DRONE, BRIDGING = DroneSettings(), BridgingSettings()


def track(
    source: str,
    out: Path,
    method: DroneMethod = "flow-maf",
    detections: Path | None = None,
    detector: Path | None = None,
    appearance: Path | None = None,
    actions: list[Path] | None = None,
    affinity: Path | None = None,
    affinity_multi: Path | None = None,
    tracks: Path | None = None,
    frames: str | None = None,
    keep_camera_motion: bool = False,
    threshold: float = 0.4,
    score_threshold: float = 0.3,
    score_range: tuple[float, float] = (0.0, 1.0),
    cache: Path | None = None,
    batch_size: int = 4,
    threads: int = 0,
    overlay: bool = False,
    overwrite: bool = False,
    seed: int = 0,
    drone: DroneSettings = DRONE,
    bridging: BridgingSettings | None = BRIDGING,
) -> int:
    """Track the people in a video from a drone, and name what each is doing.

    People are found, described and their actions recognised by the models that ship with the toolkit; a minimum-cost
    flow links them. DIR gets tracks.txt (MOTChallenge text), tracks.json (with actions), report.html, run.json and,
    with --overlay, overlay.webm.

    Args:
        source: a video file, a folder of images or a MOTChallenge sequence folder.
        out: folder for the results.
        method: flow links by place and looks; flow-saf also by actions of single frames; flow-maf averages actions
            along the tracks, links again and repeats, up to --drone.refinement.iterations times.
        detections: MOTChallenge detections (det.txt) to use instead of a detector.
        detector: exported detector; by default the shipped detector_drone.onnx.
        appearance: exported appearance network; by default the shipped appearance_people.onnx; none does without.
        actions: exported action streams, separated by commas; by default the four shipped ones. Not used by
            method flow, which names no actions but along given --tracks.
        affinity: exported link costs; by default those shipped for the method, but hand-set ones with --detections,
            whose scores the shipped ones do not know; none always takes hand-set ones.
        affinity_multi: exported link costs of the repetitions of flow-maf; by default those of --affinity, or shipped.
        tracks: MOTChallenge tracks (gt.txt, tracks.txt) or an Okutama-Action label file that are right already; only
            actions are named.
        frames: track this stretch only, counted from 1 with both ends, such as 301-400.
        keep_camera_motion: compare places as they are in the pictures, not as if the camera had stood still.
        threshold: an action is named where its probability is above, from 0 to 1.
        score_threshold: the detector keeps what scores at least this, from 0 to 1.
        score_range: smallest and largest score that the rows of --detections may have.
        cache: folder that keeps what the networks say; a second run on the same video with other settings of method,
            costs or --drone takes seconds.
        batch_size: frames of one call of the detector.
        threads: CPU threads of the networks; 0 takes all.
        overlay: also write a video with the tracks and actions drawn in.
        overwrite: replace an earlier result in the folder.
        seed: of random numbers; kept in run.json, for the methods here draw none.
        drone: settings of flow, alternation and output.
        bridging: how correlation filters follow people whom the detector misses for a few frames; null switches them
            off.
    """
    given = dict(locals())
    from tsuiseki.tracking.cli.drone_models import DroneModels, prices_of
    from tsuiseki.tracking.cli.drone_run import run_drone, write_drone_run
    from tsuiseki.tracking.cli.people_run import plain
    from tsuiseki.tracking.output import RunRecord, check_output_folder, output_folder
    from tsuiseki.tracking.timing import StageTimes
    from tsuiseki.tracking.video import open_source

    settings = {name: plain(value) for name, value in given.items()}
    for name, value in (("threshold", threshold), ("score-threshold", score_threshold)):
        if not 0 <= value <= 1:
            raise RequestError(f"--{name}: expected a number from 0 to 1, got {value:g}")
    if batch_size < 1 or threads < 0:
        raise RequestError(f"expected --batch-size from 1 and --threads from 0 on, got {batch_size} and {threads}")
    check_output_folder(out, overwrite)
    opened = open_source(source, parse_frames(frames))
    models = DroneModels.choose(
        opened, method, detections, detector, appearance, actions, tracks, score_threshold, score_range, threads,
        batch_size, camera_motion=not keep_camera_motion, bridging=bridging,
    )  # fmt: skip
    prices = prices_of(
        method,
        affinity,
        affinity_multi,
        threads,
        scores_known=detections is None and tracks is None,
        windows=drone.refinement.windows,
    )
    times = StageTimes()
    with output_folder(out, overwrite) as work:
        run = run_drone(source, opened, models, method, drone, prices, cache, times)
        record = RunRecord(["tsuiseki", "track", "drone"], settings, seed, times.seconds)
        write_drone_run(work, run, record, opened, threshold, overlay=overlay)
    count, length = len(run.people), len(run.log.frames)
    print(f"{count} {'person' if count == 1 else 'people'} in {length} frames: {out / 'tracks.txt'}")
    return 0
