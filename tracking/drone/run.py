"""`tsuiseki track drone`: people in video from a drone, and what they do. The demo of a drone shares its parts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from tsuiseki.tracking.cli.options import SeededOutput, Video
from tsuiseki.tracking.cli.run import Run, count, frames_expected
from tsuiseki.tracking.drone.models import DroneMethod, DroneModels
from tsuiseki.tracking.drone.observations import Observation, observe, video_observations
from tsuiseki.tracking.drone.settings import DroneSettings
from tsuiseki.tracking.drone.tracking import NAMED, DronePreset, link, link_costs
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.people.settings import FindingOptions
from tsuiseki.tracking.video.source import Source

DRONE = DroneSettings()


def drone(
    video: Video,
    output: SeededOutput,
    finding: FindingOptions,
    method: DroneMethod = "flow-maf",
    actions: list[Path] | None = None,
    tracks: Path | None = None,
    affinity: Path | None = None,
    preset: DronePreset = "default",
    keep_camera_motion: bool = False,
    threshold: float = NAMED,
    cache: Path | None = None,
    drone: DroneSettings = DRONE,
) -> int:
    """Track the people in a video from a drone, and name what each is doing.

    People are found, described and their actions recognised by the models that ship with the toolkit; a minimum-cost
    flow links them. DIR gets tracks.txt (MOTChallenge text), tracks.json (with actions), report.html with its
    plots and numbers in report/, run.json and, with --overlay, overlay.webm.

    Args:
        method: flow links by place, motion and appearance; flow-saf also by actions of single frames; flow-maf averages
            actions along the tracks, links again and repeats.
        detector: detector as ONNX, or the name of a shipped one; by default drone_larger. One of other projects is
            recognised as by track people.
        actions: exported action streams, separated by commas; by default the four shipped ones. Not used by
            method flow, which names no actions but along given --tracks.
        tracks: MOTChallenge tracks (gt.txt, tracks.txt) or an Okutama-Action label file that are right already; only
            actions are named.
        affinity: costs learnt on whole tracks as ONNX (train association with --data.tracker drone); by default those
            of --drone. With --preset printed, costs learnt on pairs (train affinity --features thesis_action).
        preset: printed links as the thesis prints it, by the overlap, appearance and actions of pairs: flow is MCF,
            flow-saf MHT-SAF and flow-maf MHT-MAF.
        keep_camera_motion: compare places as they are in the pictures, not as if the camera had stood still.
        threshold: an action is named where its probability is above, from 0 to 1.
        cache: folder that keeps what the networks say; a second run on the same video with other settings of method
            or --drone takes seconds.
        seed: of random numbers; kept in run.json, for the methods here draw none.
        drone: settings of the flow and of what is reported.
    """
    from tsuiseki.tracking.cli.detector_lines import tell_blank, tell_models
    from tsuiseki.tracking.drone.models import DroneModels
    from tsuiseki.tracking.features.camera_path import line_on_camera

    if not 0 <= threshold <= 1:
        raise RequestError(f"`threshold`: expected a number from 0 to 1, got {threshold:g}")
    costs = link_costs(affinity, preset, method, finding.threads)
    source = video.open(images=True, replayable=True)
    moving = not keep_camera_motion and preset == "default"
    models = DroneModels.choose(source, method, finding, finding.appearance, actions, tracks, camera_motion=moving)
    with output.run() as run:
        tell_models(run, models.observers.detect, models.observers.describe, models.observers.recognise)
        kept = None if cache is None else (video.source, cache)
        steps = run.steps(observations(run, source, models, kept), total=frames_expected(source))
        made = output.settings
        result = link(steps, source, models, method, drone, run.times, made, costs, threshold)
        if unknown := result.facts.get("flow", {}).get("camera_unknown"):
            print(line_on_camera(unknown))
        tell_blank(models.observers.detect)
        run.save(result, lambda: video.draw(run, source, result))
        run.done(f"{count(len(result), 'person', 'people')} in {run.count} frames: {output.out / 'tracks.txt'}")
    return run.status


def observations(
    run: Run, source: Source, models: DroneModels, cache: tuple[str, Path] | None
) -> Iterator[Observation]:
    """What the models say of each frame; ``cache`` is the name of the source, and the folder that keeps it."""
    if cache is None:
        return observe(run.frames(source), models.observers, run.times)
    name, folder = cache
    wanted = source.frames_wanted
    return video_observations(name, models.observers, models.key, folder, wanted, run.times, models.superset_key)
