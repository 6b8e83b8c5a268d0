"""Where actions can help (`reproduce drone-crowd`): people dressed alike in a crowd, seen three times a second.

They walk about each other and under a roof. A second and more under the roof and a third of a second between two looks
leave place and motion in doubt, and there is no appearance. Only what somebody does is left to tell people apart.
Nothing is drawn: boxes and actions are those of the people of `gathering`, detections err as a detector does, and
actions are the labelled ones, so that the table says what a perfect recognition would bring. The false boxes of a place
act as one of the people did, from some moment on: so they are told from people neither by what they do nor by how often
they begin something else. A second table has no false boxes at all. In a third everybody keeps doing something of their
own, whether they walk, stand or sit.

The flow without actions chooses first, on clips of other seeds than those that are scored: what a detection is worth,
and what a track costs. The cost of actions is then chosen on top, on the same clips.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from tsuiseki.datamodules.scenes.people.gathering import gather
from tsuiseki.datamodules.simulated_detections import DetectorFaults, simulate_detections
from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.association.costs import ActionCost, ActionFeatures
from tsuiseki.tracking.drone.settings import DRONE_FLOW, DroneSettings
from tsuiseki.tracking.drone.tracker import DroneTracker
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.multi import SequencePair
from tsuiseki.tracking.evaluation.resampling import paired_bootstrap, score_sums, scores_of
from tsuiseki.tracking.formats.acting_tracks import LYING, OKUTAMA_ACTIONS, SITTING, WITH_OBJECTS
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import Detections, FloatArray, IntArray
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.experiments.drone.borrowed_actions import borrowed, place_of
from tsuiseki.trainers.experiments.drone.tables import COMPARED, difference_cell
from tsuiseki.trainers.experiments.experiment import Bench, Outcome, Table, at_least_one
from tsuiseki.trainers.experiments.store import Store

STEPS = 30  # of the simulation in a second
SAMPLES = 2000
SAME = 0.3  # overlap from which a detection shows a labelled person
CHOICE_SEED, TEST_SEED = 0, 1000
OFFSETS, ENDS = (1.0, 1.5, 2.0, 2.5, 3.0), (5.0, 7.0, 10.0)
WEIGHTS, NEUTRALS = (1.0, 2.0, 4.0, 8.0), (0.05, 0.1, 0.2, 0.4)
CLEAN = ", no false boxes"
KEPT = ", everybody keeps doing something of their own"
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
        own_actions: each person does one of these all the time instead of what their hands do else, drawn at random;
            with none people do what the scene gives them to do.
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
    own_actions: tuple[str, ...] = ()


@dataclass(frozen=True)
class CrowdFlow:
    """What is chosen of the flow.

    Attributes:
        offset: worth of a detection, see `DetectionCost`.
        ends: what a track costs at each end.
        action: cost of actions; None leaves them out.
    """

    offset: float
    ends: float
    action: ActionCost | None = None


@dataclass(frozen=True)
class CrowdClip:
    """Labels and detections, which carry actions, frame by frame."""

    truth: GroundTruth
    seen: list[Detections]


@lru_cache(maxsize=64)
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
    if scene.own_actions:
        _keep_own(done, table[:, 1].astype(np.int64) - 1, scene.own_actions, np.random.default_rng([seed, 3]))
    order = np.lexsort([table[:, 1], table[:, 0]])
    table, done = table[order], done[order]
    frames, visible = table[:, 0].astype(np.int64), table[:, 6] > 0
    truth = GroundTruth(frames, table[:, 1].astype(np.int64), table[:, 2:6], visible, ~visible, table[:, 6])
    length = scene.seconds * scene.frame_rate
    found = simulate_detections(
        np.random.default_rng([seed, 1]), truth.select(visible), length, *scene.size, scene.faults
    )
    seen = []
    course = borrowed(done.reshape(length, scene.people, -1), np.random.default_rng([seed, 2]))
    for frame, detections in enumerate(found):
        there = np.flatnonzero((frames == frame) & visible)
        of_detection, of_label = assign_overlaps(iou_matrix(detections.boxes, truth.boxes[there]), SAME)
        doing = course[frame, place_of(detections.boxes)]
        doing[of_detection] = done[there[of_label]]
        seen.append(replace(detections, actions=doing))
    return CrowdClip(truth, seen)


def _keep_own(done: FloatArray, who: IntArray, own_actions: Sequence[str], rng: np.random.Generator) -> None:
    """Write into ``done`` ``(N, A)`` that persons ``who`` ``(N,)`` do one thing each, drawn from ``own_actions``."""
    columns = np.array([OKUTAMA_ACTIONS.index(name) for name in own_actions])
    own = rng.choice(columns, size=who.max() + 1)
    done[:, columns] = 0
    done[np.arange(len(done)), own[who]] = 1


def _box(scene: CrowdScene, position: FloatArray, posture: str) -> tuple[float, float, float, float]:
    """A person of 1.75 m and 0.4 m depth, from 60 degrees above."""
    high = (1.75 * 0.5 + 0.4 * 0.87) * {SITTING: 0.75, LYING: 0.6}.get(posture, 1.0) * scene.pixels
    wide = (1.4 if posture == LYING else 0.55) * scene.pixels
    x, y = scene.size[0] / 2 + position[0] * scene.pixels, scene.size[1] / 2 - 0.87 * position[1] * scene.pixels
    return x - wide / 2, y - high, x + wide / 2, y


def follow_crowd(scene: CrowdScene, seed: int, chosen: CrowdFlow) -> list[float]:
    """Sums of scores (see `score_sums`) of the flow."""
    clip = draw_crowd(scene, seed)
    link = replace(DRONE_FLOW.costs.link, action=chosen.action)
    given = replace(DRONE_FLOW.input, detection=replace(DRONE_FLOW.input.detection, offset=chosen.offset))
    costs = replace(DRONE_FLOW.costs, link=link, entry=chosen.ends, exit=chosen.ends)
    tracker = DroneTracker(
        DroneSettings(replace(DRONE_FLOW, input=given, costs=costs)), float(scene.frame_rate), scene.size
    )
    for detections in clip.seen:
        tracker.update(replace(detections, actions=detections.actions if chosen.action else None))
    pair = SequencePair(f"crowd-{seed}", clip.truth, tracker.tracks(), len(clip.seen))
    return [float(value) for value in score_sums(pair)]


def reproduce(bench: Bench, clips: int = 12, frame_rate: int = 3) -> Outcome:
    """The flow without and with labelled actions where place, motion and appearance say little; DIR gets tables.md.

    Args:
        bench: where it works.
        clips: to choose the costs on; three times as many others are scored.
        frame_rate: frames a second, of which 30 is a multiple.

    Raises:
        RequestError: a number below 1, or a frame rate that does not divide 30.
    """
    at_least_one(clips=clips, frame_rate=frame_rate)
    if STEPS % frame_rate:
        raise RequestError(f"`frame_rate`: expected a divisor of {STEPS}, got {frame_rate}")
    scene = CrowdScene(frame_rate=frame_rate)
    clean = replace(scene, faults=replace(scene.faults, false_alarms=0.0))
    kept = replace(scene, own_actions=WITH_OBJECTS)
    found = {name: compare(bench.store, clips, one, name) for name, one in (("", scene), (CLEAN, clean), (KEPT, kept))}
    return Outcome({f"crowd{name}": values for name, (values, _) in found.items()}, [t for _, t in found.values()])


def compare(store: Store, clips: int, scene: CrowdScene, what: str = "") -> tuple[dict[str, Any], Table]:
    """Numbers and a table with a row a method; ``what`` the clips are, for its title. See `reproduce`."""
    choosing = range(CHOICE_SEED, CHOICE_SEED + clips)
    scored = range(TEST_SEED, TEST_SEED + 3 * clips)
    plain = _best(store, scene, choosing, [CrowdFlow(offset, ends) for offset in OFFSETS for ends in ENDS])
    flow = _sums(store, scene, scored, plain)
    about = f"detection {plain.offset:g}, ends {plain.ends:g}"
    rows = [("flow", *_cells(flow), *[""] * len(COMPARED), about)]
    values: dict[str, Any] = {"flow": {**_scores(flow), "chosen": asdict(plain)}}
    for name, features in FEATURES.items():
        tried = [
            ActionCost(features, weight=(weight, weight), neutral=(neutral, neutral))
            for weight in WEIGHTS
            for neutral in NEUTRALS
        ]
        chosen = _best(store, scene, choosing, [replace(plain, action=action) for action in tried])
        assert chosen.action is not None
        found = _sums(store, scene, scored, chosen)
        against = paired_bootstrap(found, flow, SAMPLES, np.random.default_rng(0))
        about = f"weight {chosen.action.weight[0]:g}, neutral {chosen.action.neutral[0]:g}"
        rows.append(
            (name, *_cells(found), *(difference_cell(score, asdict(against[score])) for score in COMPARED), about)
        )
        values[name] = {
            **_scores(found), "chosen": asdict(chosen), "against_flow": {k: asdict(v) for k, v in against.items()}
        }  # fmt: skip
    title = (
        f"People alike in a crowd under a roof{what}, {scene.frame_rate} frames a second, labelled actions: "
        f"{len(scored)} clips, costs chosen on {len(choosing)} others"
    )
    against_flow = [f"{score} against flow" for score in COMPARED.values()]
    return values, Table(title, ("method", "IDs", "MOTA", "IDF1", "HOTA", *against_flow, "chosen"), rows)


def _sums(store: Store, scene: CrowdScene, seeds: Sequence[int], chosen: CrowdFlow) -> FloatArray:
    return np.array([store.recall(follow_crowd, scene, seed, chosen) for seed in seeds])


def _best(store: Store, scene: CrowdScene, seeds: Sequence[int], tried: Sequence[CrowdFlow]) -> CrowdFlow:
    """The costs with the best IDF1; of equal ones the first."""
    return max(tried, key=lambda one: _scores(_sums(store, scene, seeds, one))["idf1"])


def _scores(sums: FloatArray) -> dict[str, float]:
    return {name: float(value) for name, value in scores_of(sums.sum(axis=0)).items()}


def _cells(sums: FloatArray) -> tuple[str, ...]:
    scores = _scores(sums)
    return (f"{scores['id_switches']:.0f}", *(f"{100 * scores[name]:.1f}" for name in ("mota", "idf1", "hota")))
