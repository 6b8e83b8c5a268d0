"""What bridging of missed detections adds, on the clips of the drone experiment."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from tsuiseki.tracking.drone.observations import Observers, file_digest, video_observations
from tsuiseki.tracking.features.action import ActionRecogniser
from tsuiseki.tracking.features.camera_motion import CameraMotionSettings
from tsuiseki.tracking.features.exported import Appearance
from tsuiseki.tracking.people.bridging import FILTER, BridgingSettings
from tsuiseki.tracking.processes import on_all_cores
from tsuiseki.trainers.experiments.drone.clips import Clip, Networks
from tsuiseki.trainers.experiments.drone.rows import (
    ComparedMethod,
    mean_rows,
    people_row,
    people_scores,
    track_all,
)

METHODS: tuple[ComparedMethod, ...] = ("flow", "flow-maf, one-sided")


def bridging_rows(
    sets: Sequence[Sequence[Clip]], cache: Path, networks: Networks, say: Callable[[str], None]
) -> list[dict[str, Any]]:
    """A row for each method, with and without bridging: means over the sets, switches added up.

    Args:
        sets: of clips, as detector and networks see them.
        cache: folder that keeps observations.
        networks: that look at the bridged boxes.
        say: gets a line of progress.
    """
    rows = []
    with_bridges = bridged(sets, cache, networks, BridgingSettings(), say)
    for bridging, seen in ((False, sets), (True, with_bridges)):
        for method in METHODS:
            found = [people_row(people_scores(clips, track_all(clips, method, compensate=True))) for clips in seen]
            chosen = {"method": method, "bridging": bridging}
            rows.append({**chosen, **mean_rows(found), "by_seed": [row["id_switches"] for row in found]})
    return sorted(rows, key=lambda row: METHODS.index(row["method"]))


def bridged(
    sets: Sequence[Sequence[Clip]],
    cache: Path,
    networks: Networks,
    settings: BridgingSettings,
    say: Callable[[str], None],
) -> list[list[Clip]]:
    """The clips with what correlation filters find of those whom the detector misses.

    Args:
        sets: of clips.
        cache: folder that keeps observations.
        networks: that look at the bridged boxes.
        settings: of the filters.
        say: gets a line for each clip.
    """
    every = [clip for clips in sets for clip in clips]
    seen = on_all_cores(partial(_bridge, cache, networks, settings, CameraMotionSettings()), every)
    found = []
    for clip in seen:
        found.append(clip)
        say(f"{clip.folder.name}: missed people followed, {len(found)} of {len(every)} clips")
    rest = iter(found)
    return [[next(rest) for _ in clips] for clips in sets]


def _bridge(
    cache: Path, networks: Networks, settings: BridgingSettings, camera: CameraMotionSettings, clip: Clip
) -> Clip:
    streams, appearance = ActionRecogniser(networks.actions, threads=1), Appearance(networks.appearance, threads=1)
    found = [one.detections for one in clip.seen]
    key = {f"model {n}": file_digest(path) for n, path in enumerate((*networks.actions, networks.appearance))}
    key |= {"bridging": repr((settings, FILTER)), "camera": repr(camera)}
    content = b"|".join(one.boxes.tobytes() + one.scores.tobytes() for one in found)
    key["found"] = hashlib.sha256(content).hexdigest()
    observers = Observers(found, appearance, streams, camera, bridging=settings)
    return replace(clip, seen=list(video_observations(clip.folder, observers, key, cache)))
