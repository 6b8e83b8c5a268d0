"""`tsuiseki track drone`: follow people in video from a drone, and say what they do."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking.cli.options import SeededOutput, Video
from tsuiseki.tracking.drone.models import DroneMethod
from tsuiseki.tracking.drone.tracker import DroneSettings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.people.bridging import BridgingSettings
from tsuiseki.tracking.people.finding_options import FindingOptions

DRONE = DroneSettings()


def drone(
    video: Video,
    output: SeededOutput,
    finding: FindingOptions,
    method: DroneMethod = "flow-maf",
    actions: list[Path] | None = None,
    tracks: Path | None = None,
    affinity: Path | None = None,
    keep_camera_motion: bool = False,
    threshold: float = 0.4,
    cache: Path | None = None,
    drone: DroneSettings = DRONE,
    bridging: BridgingSettings | None = None,
) -> int:
    """Track the people in a video from a drone, and name what each is doing.

    People are found, described and their actions recognised by the models that ship with the toolkit; a minimum-cost
    flow links them. DIR gets tracks.txt (MOTChallenge text), tracks.json (with actions), report.html, run.json and,
    with --overlay, overlay.webm.

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
            of --drone.
        keep_camera_motion: compare places as they are in the pictures, not as if the camera had stood still.
        threshold: an action is named where its probability is above, from 0 to 1.
        cache: folder that keeps what the networks say; a second run on the same video with other settings of method
            or --drone takes seconds.
        seed: of random numbers; kept in run.json, for the methods here draw none.
        drone: settings of the flow and of what is reported.
        bridging: correlation filters follow people whom the detector misses for a few frames where an option of it is
            given, such as --bridging.most_frames 5: more people are found, and more of nobody.
    """
    from tsuiseki.tracking.association.flow.cost_network import CostNetwork
    from tsuiseki.tracking.cli.detector_lines import tell_blank, tell_reading
    from tsuiseki.tracking.drone.models import DroneModels
    from tsuiseki.tracking.drone.writing import follow, write_result
    from tsuiseki.tracking.features.motion.camera_trajectory import said_of_camera

    if not 0 <= threshold <= 1:
        raise RequestError(f"`threshold`: expected a number from 0 to 1, got {threshold:g}")
    changes = None if affinity is None else CostNetwork(affinity, finding.threads)
    source = video.open(images=True, replayable=True)
    models = DroneModels.choose(
        source,
        method,
        finding,
        finding.appearance,
        actions,
        tracks,
        camera_motion=not keep_camera_motion,
        bridging=bridging,
    )
    with output.run() as run:
        kept = None if cache is None else (video.source, cache)
        tell_reading(run, models.observers.detect)
        found = follow(run, source, models, method, drone, kept, changes)
        if found.facts:
            run.facts["flow"] = dict(found.facts)
            if unknown := found.facts["camera_unknown"]:
                print(said_of_camera(unknown))
        tell_blank(models.observers.detect)
        write_result(run, found, source, threshold, video=video)
        who = "person" if len(found.people) == 1 else "people"
        run.done(f"{len(found.people)} {who} in {run.count} frames: {output.out / 'tracks.txt'}")
    return run.status
