"""The action term of the drone tracker's links, fitted to labelled clips.

    python -m benchmarks.drone.action_cost_fit FOLDER... --out FILE [--cache DIR]

The flow without actions is solved over each clip, and every link between labelled people that it considered is one
sample: what it cost, how far the actions at its ends differ, of single detections and of means along the tracks found,
and whether both ends show one person. Costs of a clip's tracks are never learnt from that clip. Logistic regression
says what a difference of actions is worth in the unit of the flow's costs:

    −logit P(same) = a · cost + b · d + c,   weight = b / a,

and the distance that speaks neither way is where d alone, with both kinds of links weighing the same, is undecided.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path

import numpy as np
import yaml
from scipy.optimize import minimize
from scipy.special import expit

from tsuiseki.tracking.association.costs import ActionCost, action_distances
from tsuiseki.tracking.association.flow_window import FlowWindow
from tsuiseki.tracking.association.inference_times import InferenceTimes
from tsuiseki.tracking.drone.observations import Observation, Observers, file_digest, video_observations
from tsuiseki.tracking.drone.settings import DroneSettings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.coverage import UNMATCHED
from tsuiseki.tracking.features.action import STREAMS, ActionRecogniser, averaged
from tsuiseki.tracking.features.camera_motion import STANDS_STILL, CameraStep
from tsuiseki.tracking.features.camera_path import CameraPath
from tsuiseki.tracking.features.exported import Appearance, Detector
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.formats.mot_sequence import find_sequences
from tsuiseki.tracking.output import check_output_file, output_file
from tsuiseki.tracking.people.flow_input import FlowInput, solve_window
from tsuiseki.tracking.types import BoolArray, Columns, FloatArray, IntArray
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.video.source import open_source
from tsuiseki.tracking.weights import DRONE_DETECTOR, shipped
from tsuiseki.trainers.flow.videos import match_boxes


@dataclass(frozen=True)
class LinkSamples(Columns):
    """Links that a flow considered.

    Attributes:
        cost: ``(P,)`` of each, without actions.
        single: ``(P,)`` distance of the actions of its detections.
        means: ``(P,)`` distance of the means along the tracks found, one-sided.
        same: ``(P,)`` whether both ends show the same person.
    """

    cost: FloatArray
    single: FloatArray
    means: FloatArray
    same: BoolArray


def link_samples(
    observations: Sequence[Observation],
    truth: GroundTruth,
    frame_rate: float,
    size: tuple[int, int],
    settings: DroneSettings | None = None,
) -> LinkSamples:
    """The links of a labelled clip.

    Args:
        observations: of its frames, with actions.
        truth: its labels.
        frame_rate: frames a second.
        size: width and height of the image.
        settings: of the tracker.

    Raises:
        RequestError: there are no actions.
    """
    if any(observation.actions is None for observation in observations):
        raise RequestError("expected what people do in every frame, got observations without actions")
    flow = (settings or DroneSettings()).flow
    costs = replace(flow.costs, link=replace(flow.costs.link, action=None))
    path = CameraPath()
    for observation in observations:
        path.follow(observation.motion or CameraStep(STANDS_STILL))
    flow_input = FlowInput(flow.input, InferenceTimes(frame_rate), size, path)
    detections = [replace(o.detections, actions=averaged(o.actions)) for o in observations if o.actions is not None]
    table, scores, _ = flow_input.rows(detections)
    assert table.actions is not None
    window = FlowWindow(costs, frame_rate, size)
    window.add(table)
    solve_window(window, flow_input, scores)
    who = _people(table.frames, table.image, truth)
    i, j = (np.searchsorted(table.numbers, numbers) for numbers in (window.links.tail, window.links.head))
    labelled = (who[i] != UNMATCHED) & (who[j] != UNMATCHED)
    i, j = i[labelled], j[labelled]
    means = ActionCost("one-sided").means(table.frames, window.labels(), table.actions, frame_rate)
    return LinkSamples(
        window.links.cost[labelled],
        action_distances(table.actions, table.actions, i, j),
        action_distances(*means, i, j),
        who[i] == who[j],
    )


def _people(frames: IntArray, boxes: FloatArray, truth: GroundTruth) -> IntArray:
    """``(N,)`` whom each box shows."""
    who = np.full(len(frames), UNMATCHED)
    for frame in np.unique(frames).tolist():
        rows, labelled = np.flatnonzero(frames == frame), truth.select((truth.frames == frame) & truth.evaluated)
        person, _ = match_boxes(boxes[rows], labelled.boxes)
        who[rows] = np.append(labelled.ids, UNMATCHED)[person]
    return who


def fit_action_cost(samples: Sequence[LinkSamples]) -> ActionCost:
    """The weights and neutral distances that links of several clips ask for.

    Raises:
        RequestError: there are no links of both kinds.
    """
    pooled = reduce(LinkSamples.and_then, samples)
    same = pooled.same
    if same.all() or not same.any():
        raise RequestError("expected links between the same person and between two, got one kind only; give more clips")
    weights, neutral = [], []
    for distance in (pooled.single, pooled.means):
        a, b, _ = _logistic(np.column_stack([pooled.cost, distance]), same, np.ones(len(same)))
        slope, offset = _logistic(distance[:, None], same, np.where(same, 1 / same.sum(), 1 / (~same).sum()))
        weights.append(max(b / a, 0.0))
        neutral.append(-offset / slope)
    return ActionCost(weight=(weights[0], weights[1]), neutral=(neutral[0], neutral[1]))


def _logistic(columns: FloatArray, same: BoolArray, weight: FloatArray) -> FloatArray:
    """``(F + 1,)`` coefficients and offset of -logit P(same), by maximum likelihood."""
    rows = np.column_stack([columns, np.ones(len(columns))])
    sign = np.where(same, 1.0, -1.0)
    share = weight / weight.sum()

    def loss(theta: FloatArray) -> tuple[float, FloatArray]:
        score = sign * (rows @ theta)
        return float(share @ np.logaddexp(0, score)), rows.T @ (share * sign * expit(score))

    return np.asarray(minimize(loss, np.zeros(rows.shape[1]), jac=True, method="L-BFGS-B").x)


def fit_action_costs(
    folders: Sequence[Path],
    out: Path,
    cache: Path | None = None,
    overwrite: bool = False,
) -> None:
    """Fit what a difference of actions costs in `track drone` to labelled clips, seen by the shipped networks.

    OUT becomes a file that `track drone --config` takes. The clips must be others than those that the action streams
    learnt from, which know the actions there better than elsewhere. What each clip would ask for without the others is
    printed, so that one sees how sure the numbers are.

    Args:
        folders: MOTChallenge sequences with gt/gt.txt, or folders of them.
        out: YAML file to write.
        cache: folder that keeps what the networks say.
        overwrite: replace an existing file.

    Raises:
        RequestError: unusable folders or models, no links of both kinds, or the file exists.
    """
    check_output_file(out, overwrite)
    sequences = [s for folder in folders for s in find_sequences(folder)]
    streams = [shipped(f"action_drone_{name}") for name in STREAMS]
    appearance, detector = shipped("appearance_people"), shipped(DRONE_DETECTOR)
    observers = Observers(Detector(detector), Appearance(appearance), ActionRecogniser(streams), camera=True)
    key = {str(n): file_digest(path) for n, path in enumerate([*streams, appearance, detector])} | {
        "camera": "estimated"
    }
    samples = []
    for sequence in sequences:
        table = list(video_observations(open_source(sequence.folder), observers, [key], cache))
        truth, size = read_ground_truth(sequence.ground_truth_path), (sequence.width, sequence.height)
        samples.append(link_samples(table, truth, sequence.frame_rate, size))
        print(f"{sequence.folder.name}: {len(samples[-1].same)} links, {_summary(fit_action_cost(samples[-1:]))}")
    cost = fit_action_cost(samples)
    term = {"weight": [*map(float, cost.weight)], "neutral": [*map(float, cost.neutral)]}
    content = {"drone": {"flow": {"costs": {"link": {"action": term}}}}}
    with output_file(out, overwrite=overwrite) as work:
        work.write_text(yaml.safe_dump(content), encoding="utf-8")
    print(f"{out}: {_summary(cost)}")


def _summary(cost: ActionCost) -> str:
    weights, neutral = ([f"{value:.2f}" for value in values] for values in (cost.weight, cost.neutral))
    return f"weight {', '.join(weights)}, neutral {', '.join(neutral)} (single detections, means along tracks)"


def main() -> None:
    """Fit the term as the words say."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+", help="sequences with gt/gt.txt, or folders of them")
    parser.add_argument("--out", type=Path, required=True, help="YAML file to write")
    parser.add_argument("--cache", type=Path, help="folder that keeps what the networks say")
    parser.add_argument("--overwrite", action="store_true", help="replace an existing file")
    words = parser.parse_args()
    fit_action_costs(words.folders, words.out, words.cache, words.overwrite)


if __name__ == "__main__":
    main()
