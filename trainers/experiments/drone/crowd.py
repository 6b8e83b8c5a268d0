"""Where actions can help (`reproduce drone-crowd`): people dressed alike in a crowd, seen three times a second.

They walk about each other and under a roof. A second and more under the roof and a third of a second between two looks
leave place and motion in doubt, and there is no appearance. Only what somebody does is left to tell people apart.
Nothing is drawn: boxes and actions are those of the people of `gathering`, detections err as a detector does, and
actions are the labelled ones, so that the table says what a perfect recognition would bring. False boxes act like
people, each place for half a second.

The cost of actions is chosen on clips of other seeds than those that are scored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from tsuiseki.datamodules.scenes.drone.gathering import gather
from tsuiseki.datamodules.simulated_detections import DetectorFaults, simulate_detections
from tsuiseki.tracking.association.action_cost import ActionCost, ActionFeatures
from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.multi import SequencePair
from tsuiseki.tracking.evaluation.resampling import paired_bootstrap, score_sums, scores_of
from tsuiseki.tracking.formats.drone.actions import LYING, OKUTAMA_ACTIONS, SITTING
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.trackers.drone import DRONE_FLOW, DroneSettings, DroneTracker
from tsuiseki.tracking.types import Detections, FloatArray
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.experiments.experiment import Bench, Outcome, Table, at_least_one
from tsuiseki.trainers.experiments.store import Store

STEPS = 30  # of the simulation in a second
SAMPLES = 2000
SAME = 0.3  # overlap from which a detection shows a labelled person
CHOICE_SEED, TEST_SEED = 0, 1000
WEIGHTS, NEUTRALS = (1.5, 2.5, 4.0), (0.1, 0.25, 0.4)
FEATURES: dict[str, ActionFeatures] = {
    "flow-SAF": "single", "flow-MAF, centred windows": "centred", "flow-MAF, one-sided windows": "one-sided",
}  # fmt: skip


@dataclass(frozen=True)
class CrowdScene:
    """What a clip shows.

    Attributes:
        people: how many, all alike.
        frame_rate: frames a second; a divisor of 30.
        seconds: length.
        half_axes: of the ellipse in which people move, metres.
        roof: width of the strip across the middle under which nobody is seen, metres.
        pixels: of a metre.
        size: of the image, pixels.
        faults: of the detector.
    """

    people: int = 10
    frame_rate: int = 3
    seconds: int = 24
    half_axes: tuple[float, float] = (5.0, 4.0)
    roof: float = 2.7
    pixels: float = 60.0
    size: tuple[int, int] = (1280, 840)
    faults: DetectorFaults = field(
        default_factory=lambda: DetectorFaults(0.05, missed=0.1, hidden=0.95, false_alarms=0.6, persistence=0.7)
    )


@dataclass(frozen=True)
class CrowdClip:
    """Labels and detections, which carry actions, frame by frame."""

    truth: GroundTruth
    seen: list[Detections]


def draw_crowd(scene: CrowdScene, seed: int) -> CrowdClip:
    """A clip without pictures."""
    rng = np.random.default_rng([seed, 0])
    arena = np.array([[0.0, 0.0], scene.half_axes])
    acted = gather(rng, scene.people, scene.seconds * STEPS, float(STEPS), arena, np.zeros((0, 3)))
    rows, actions = [], []
    for number, performer in enumerate(acted.performers, start=1):
        for frame, state in enumerate(performer.states[:: STEPS // scene.frame_rate]):
            box = _box(scene, state.position, state.activity.posture)
            rows.append([frame, number, *box, float(abs(state.position[0]) >= scene.roof / 2)])
            actions.append([name in state.activity.actions for name in OKUTAMA_ACTIONS])
    table, done = np.array(rows), np.array(actions, dtype=np.float64)
    order = np.lexsort([table[:, 1], table[:, 0]])
    table, done = table[order], done[order]
    frames, visible = table[:, 0].astype(np.int64), table[:, 6] > 0
    truth = GroundTruth(frames, table[:, 1].astype(np.int64), table[:, 2:6], visible, ~visible, table[:, 6])
    length = scene.seconds * scene.frame_rate
    found = simulate_detections(
        np.random.default_rng([seed, 1]), truth.select(visible), length, *scene.size, scene.faults
    )
    like = np.random.default_rng([seed, 2]).integers(len(done), size=(2 * scene.seconds, 64))
    seen = []
    for frame, detections in enumerate(found):
        there = np.flatnonzero((frames == frame) & visible)
        of_detection, of_label = assign_overlaps(iou_matrix(detections.boxes, truth.boxes[there]), SAME)
        corner = (detections.boxes[:, :2] // 160).astype(np.int64)
        doing = done[like[2 * frame // scene.frame_rate][(corner[:, 0] + 8 * corner[:, 1]) % 64]]
        doing[of_detection] = done[there[of_label]]
        seen.append(replace(detections, actions=doing))
    return CrowdClip(truth, seen)


def _box(scene: CrowdScene, position: FloatArray, posture: str) -> tuple[float, float, float, float]:
    """A person of 1.75 m and 0.4 m depth, from 60 degrees above."""
    high = (1.75 * 0.5 + 0.4 * 0.87) * {SITTING: 0.75, LYING: 0.6}.get(posture, 1.0) * scene.pixels
    wide = (1.4 if posture == LYING else 0.55) * scene.pixels
    x, y = scene.size[0] / 2 + position[0] * scene.pixels, scene.size[1] / 2 - 0.87 * position[1] * scene.pixels
    return x - wide / 2, y - high, x + wide / 2, y


def follow_crowd(scene: CrowdScene, seed: int, action: ActionCost | None) -> list[float]:
    """Sums of scores (see `score_sums`) of the flow with a cost of actions, or without."""
    clip = draw_crowd(scene, seed)
    costs = replace(DRONE_FLOW.costs, link=replace(DRONE_FLOW.costs.link, action=action))
    tracker = DroneTracker(DroneSettings(replace(DRONE_FLOW, costs=costs)), float(scene.frame_rate), scene.size)
    for detections in clip.seen:
        tracker.update(replace(detections, actions=detections.actions if action else None))
    pair = SequencePair(f"crowd-{seed}", clip.truth, tracker.tracks(), len(clip.seen))
    return [float(value) for value in score_sums(pair)]


def reproduce(bench: Bench, clips: int = 12, frame_rate: int = 3) -> Outcome:
    """The flow without and with labelled actions where place, motion and appearance say little; DIR gets tables.md.

    Args:
        bench: where it works.
        clips: to choose the cost of actions on; three times as many others are scored.
        frame_rate: frames a second, of which 30 is a multiple.

    Raises:
        RequestError: a number below 1, or a frame rate that does not divide 30.
    """
    at_least_one(clips=clips, frame_rate=frame_rate)
    if STEPS % frame_rate:
        raise RequestError(f"`frame_rate`: expected a divisor of {STEPS}, got {frame_rate}")
    return compare(bench, clips, CrowdScene(frame_rate=frame_rate))


def compare(bench: Bench, clips: int, scene: CrowdScene) -> Outcome:
    """A row a method; see `reproduce`."""
    store = bench.store
    choosing = range(CHOICE_SEED, CHOICE_SEED + clips)
    scored = range(TEST_SEED, TEST_SEED + 3 * clips)
    flow = _sums(store, scene, scored, None)
    rows, values = [("flow", *_cells(flow), "", "", "")], dict[str, Any]()
    values["flow"] = _scores(flow)
    for name, features in FEATURES.items():
        action = _chosen(store, scene, choosing, features)
        found = _sums(store, scene, scored, action)
        against = paired_bootstrap(found, flow, SAMPLES, np.random.default_rng(0))
        switches, identity = against["id_switches"], against["idf1"]
        rows.append(
            (name, *_cells(found),
             f"{switches.difference:+.0f} ({switches.low:+.0f} to {switches.high:+.0f})",
             f"{100 * identity.difference:+.1f} ({100 * identity.low:+.1f} to {100 * identity.high:+.1f})",
             f"weight {action.weight[0]:g}, neutral {action.neutral[0]:g}")
        )  # fmt: skip
        chosen = {"weight": action.weight[0], "neutral": action.neutral[0]}
        values[name] = {
            **_scores(found), "chosen": chosen, "against_flow": {k: asdict(v) for k, v in against.items()}
        }  # fmt: skip
    title = (
        f"People alike in a crowd under a roof, {scene.frame_rate} frames a second, labelled actions: "
        f"{len(scored)} clips, the cost of actions chosen on {len(choosing)} others"
    )
    columns = ("method", "IDs", "MOTA", "IDF1", "HOTA", "IDs against flow", "IDF1 against flow", "chosen")
    return Outcome({"crowd": values}, [Table(title, columns, rows)])


def _sums(store: Store, scene: CrowdScene, seeds: Sequence[int], action: ActionCost | None) -> FloatArray:
    return np.array([store.recall(follow_crowd, scene, seed, action) for seed in seeds])


def _chosen(store: Store, scene: CrowdScene, seeds: Sequence[int], features: ActionFeatures) -> ActionCost:
    """The cost with the best IDF1; of equal ones the first."""
    tried = [
        ActionCost(features, weight=(weight, weight), neutral=(neutral, neutral))
        for weight in WEIGHTS
        for neutral in NEUTRALS
    ]
    return max(tried, key=lambda one: _scores(_sums(store, scene, seeds, one))["idf1"])


def _scores(sums: FloatArray) -> dict[str, float]:
    return {name: float(value) for name, value in scores_of(sums.sum(axis=0)).items()}


def _cells(sums: FloatArray) -> tuple[str, ...]:
    scores = _scores(sums)
    return (f"{scores['id_switches']:.0f}", *(f"{100 * scores[name]:.1f}" for name in ("mota", "idf1", "hota")))
