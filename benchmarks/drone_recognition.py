"""How much better actions would have to be recognised for the alternation to pay: networks helped by the truth.

    python benchmarks/drone_recognition.py --work out/cache/experiments --fit out/cache/drone/validation \
        [--seeds 2] [--clips 3] [--frames 150] [--shares 0,0.3,1] [--keep-camera-motion]

What the action streams say of a detection is moved towards its label by a share: 0 is the networks alone, 1 the truth.
For every share the costs are fitted anew on the clips of ``--fit`` and all methods are run on the test clips of
`tsuiseki reproduce drone-action-features --simulated-detections`; what that has left in its --cache is used again.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.association.tracklets.action_refinement import Prices, RefinementSettings
from tsuiseki.tracking.evaluation.action.action_pairs import LabelledActions
from tsuiseki.tracking.features.action_inputs import STREAMS
from tsuiseki.tracking.formats.mot import find_sequences
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.pipelines.observations import Observation
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.affinity.affinity_drone import fit_drone_affinity, labelled_clip
from tsuiseki.trainers.experiments.drone.clips import (
    FIRST_SEED,
    TEST_SCENE,
    Clip,
    Networks,
    look_at,
    observations_in,
    prepare_clips,
)
from tsuiseki.trainers.experiments.drone.rows import METHODS, Costs, people_row, people_scores, track_all
from tsuiseki.trainers.experiments.store import Store

SAME = 0.3


def main() -> None:
    """Run and print a row for every share."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--fit", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--clips", type=int, default=3)
    parser.add_argument("--frames", type=int, default=150)
    parser.add_argument("--shares", default="0,0.3,1")
    parser.add_argument("--keep-camera-motion", action="store_true")
    given = parser.parse_args()
    store = Store(given.work)
    networks = Networks(tuple(shipped(f"action_drone_{name}") for name in STREAMS), shipped("appearance_people"))
    scene = replace(TEST_SCENE, frames=given.frames)
    seeds = [FIRST_SEED + 100 * s + k for s in range(given.seeds) for k in range(given.clips)]
    names = [(f"test-{seed}-{given.frames}", scene, seed) for seed in seeds]
    test = prepare_clips(store, names, networks, print)
    fit = look_at([s.folder for s in find_sequences(given.fit)], observations_in(store), networks)
    for share in map(float, given.shares.split(",")):
        with tempfile.TemporaryDirectory() as folder:
            costs = fitted([helped(clip, share) for clip in fit], Path(folder), keep=given.keep_camera_motion)
        better = [helped(clip, share) for clip in test]
        compensate = not given.keep_camera_motion
        for method in METHODS[1:]:
            row = people_row(people_scores(better, track_all(better, method, costs, compensate=compensate)))
            shown = "  ".join(
                f"{name} {row[name]:.2f}" for name in ("id_switches", "recall", "precision", "idf1", "hota")
            )
            print(f"share {share:g}  {method:22s}{shown}", flush=True)


def fitted(clips: Sequence[Clip], folder: Path, *, keep: bool) -> Costs:
    """The costs of all methods from clips."""
    seen = [[replace(one, motion=None if keep else one.motion) for one in clip.seen] for clip in clips]
    learnt = [labelled_clip(one, clip.truth) for one, clip in zip(seen, clips, strict=True)]
    centred = replace(RefinementSettings(), windows="centred")
    plain = fit_drone_affinity(learnt, folder / "plain.onnx", "thesis")
    single = fit_drone_affinity(learnt, folder / "single.onnx")
    first = Prices(single.observation, single)
    multi = fit_drone_affinity(learnt, folder / "multi.onnx", settings=centred, multi=first)
    sided = replace(centred, windows="one-sided")
    return Costs(plain, single, multi, fit_drone_affinity(learnt, folder / "sided.onnx", settings=sided, multi=first))


def helped(clip: Clip, share: float) -> Clip:
    """``clip`` with what the streams say moved towards the labels."""
    return replace(clip, seen=[_moved(one, clip.labels, share) for one in clip.seen])


def _moved(one: Observation, labels: LabelledActions, share: float) -> Observation:
    assert one.actions is not None
    rows = np.flatnonzero(labels.truth.frames == one.frame)
    found, label = assign_overlaps(iou_matrix(one.detections.boxes, labels.truth.boxes[rows]), SAME)
    actions = one.actions.copy()
    actions[:, found] += share * (labels.actions[rows[label]] - actions[:, found])
    return replace(one, actions=actions)


if __name__ == "__main__":
    main()
