"""Learning the costs of the flow on video from a drone: with action features, and as if the camera stood still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from tsuiseki.tracking.association.affinity import FEATURE_SETS, Affinity, FeatureSet
from tsuiseki.tracking.association.rows import DetectionRows
from tsuiseki.tracking.association.tracklets.action_refinement import (
    Prices,
    RefinementSettings,
    compared_features,
    refine,
)
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.action import ActionRecogniser, averaged
from tsuiseki.tracking.features.motion.camera_motion import CameraMotionSettings
from tsuiseki.tracking.features.motion.camera_trajectory import CameraTrajectory
from tsuiseki.tracking.features.networks.exported import Appearance, Detector
from tsuiseki.tracking.formats.mot import find_sequences, read_detections, read_ground_truth
from tsuiseki.tracking.output import check_output_file
from tsuiseki.tracking.pipelines.observation_cache import file_digest
from tsuiseki.tracking.pipelines.observations import Observation, Observers
from tsuiseki.tracking.pipelines.video_observations import video_observations
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.affinity.affinity import (
    BoostingSettings,
    affinity_card,
    check_kinds,
    fit_observation,
    fit_transition,
    with_unknown,
)
from tsuiseki.trainers.affinity.affinity_samples import LabelledDetections, join_samples, label_detections, pair_samples
from tsuiseki.trainers.exporting.export_affinity import export_affinity

GROUPS = 5
WINDOWED: dict[str, Literal["centred", "one-sided"]] = {
    "affinity_drone_maf.onnx": "centred",
    "affinity_drone_sided.onnx": "one-sided",
}
# Half the trees of a street's costs: every iteration of the alternation prices pairs with them.
FEW_TREES = BoostingSettings(trees=60, learning_rate=0.15)


def labelled_clip(observations: Sequence[Observation], truth: GroundTruth) -> LabelledDetections:
    """The detections of a clip, what each shows and does, with boxes where they would be had the camera stood still.

    Args:
        observations: of consecutive frames.
        truth: labels of the clip.
    """
    camera = CameraTrajectory("images")
    for one in observations:
        camera.append(None if one.motion is None else one.motion.similarity)
    detections = [
        replace(one.detections, actions=None if one.actions is None else averaged(one.actions)) for one in observations
    ]
    first = observations[0].frame
    found = label_detections(detections, truth, first)
    return replace(found, boxes=camera.to_first(found.boxes, found.frames - first))


def fit_drone_affinity(
    clips: Sequence[LabelledDetections],
    out: Path,
    features: FeatureSet = "thesis_action",
    settings: RefinementSettings | None = None,
    multi: Prices | None = None,
    training_data: Sequence[Path] = (),
    boosting: BoostingSettings | None = None,
    b: float = -0.5,
    seed: int = 0,
    overwrite: bool = False,
) -> Affinity:
    """Fit c_tran and c_obsv to labelled clips and write them.

    Args:
        clips: that the tracker will not be scored on, see `labelled_clip`.
        out: ONNX file to write.
        features: what the trees see.
        settings: of the tracker; its gate says which pairs are asked about.
        multi: prices with which the clips are tracked first; the trees then see the multi-frame features along those
            tracks, as those of the repetitions do. None takes single-frame features.
        training_data: for the card.
        boosting: settings of the trees.
        b: bias of the observation cost (eq. 2.12).
        seed: of all chance.
        overwrite: replace an existing file.

    Raises:
        RequestError: no pairs of both kinds, features of actions without actions, or the file exists.
    """
    settings = settings or RefinementSettings()
    check_output_file(out, overwrite)
    names = FEATURE_SETS[features]
    if "action" in names and any(clip.actions is None for clip in clips):
        raise RequestError(f"features {features} need action streams, got none")
    groups = max(1, -(-GROUPS // len(clips)))
    samples = join_samples(
        [pair_samples(c, features, settings.gate, groups, _features_of(c, settings, multi)) for c in clips]
    )
    check_kinds(samples)
    samples = with_unknown(samples, names.index("appearance"), np.random.default_rng(seed))
    trees, report = fit_transition(samples, names, boosting or FEW_TREES, seed)
    observation = fit_observation(clips, b)
    card = affinity_card(features, settings.gate, observation, report, training_data, None)
    export_affinity(trees, (report.scale, report.shift), card, out, samples.rows, overwrite)
    print(
        f"{out}: {report.pairs} pairs, {report.positives} of the same person; on unseen clips AUC {report.auc:.4f}, "
        f"log loss {report.log_loss:.4f}"
    )
    return Affinity(out, threads=1)


def fit_drone_affinities(
    folders: list[Path],
    out: Path,
    actions: list[Path],
    appearance: Path | None = None,
    detector: Path | None = None,
    keep_camera_motion: bool = False,
    cache: Path | None = None,
    extended: bool = False,
    drone: RefinementSettings | None = None,
    boosting: BoostingSettings | None = None,
    b: float = -0.5,
    seed: int = 0,
    overwrite: bool = False,
) -> None:
    """Fit the costs of `track drone` to labelled clips: of flow, of flow-saf, and of the repetitions of flow-maf.

    OUT gets affinity_drone.onnx, affinity_drone_saf.onnx, affinity_drone_maf.onnx and, for one-sided windows,
    affinity_drone_sided.onnx. The clips must be others than
    those that the action streams learnt from, which know the actions there better than elsewhere.

    Args:
        folders: MOTChallenge sequences with gt/gt.txt, or folders of them.
        out: folder for the files.
        actions: exported action streams, separated by commas.
        appearance: exported appearance network; without one appearance counts as unknown.
        detector: exported detector; without one det/det.txt of each sequence is taken.
        keep_camera_motion: compare places as they are in the pictures, not as if the camera had stood still.
        cache: folder that keeps what the networks say.
        extended: also let the trees see gap, size and motion, which the thesis does not.
        drone: settings of the flow.
        boosting: settings of the trees.
        b: bias of the observation cost (eq. 2.12).
        seed: of all chance.
        overwrite: replace existing files.

    Raises:
        RequestError: unusable folders or models, no pairs of both kinds, or a file exists.
    """
    streams = ActionRecogniser(actions)
    describe = None if appearance is None else Appearance(appearance)
    camera = CameraMotionSettings()
    key = {str(n): file_digest(path) for n, path in enumerate([*actions, appearance, detector]) if path is not None}
    clips = []
    for sequence in (s for folder in folders for s in find_sequences(folder)):
        given = read_detections(sequence.detections_path, sequence.length) if detector is None else Detector(detector)
        observers = Observers(given, describe, streams, camera)
        whole = key | {"camera": repr(camera)}
        if detector is None:
            whole["detections"] = file_digest(sequence.detections_path)
        seen = list(video_observations(sequence.folder, observers, whole, cache))
        if keep_camera_motion:
            seen = [replace(one, motion=None) for one in seen]
        clips.append(labelled_clip(seen, read_ground_truth(sequence.ground_truth_path)))
    plain: FeatureSet = "extended" if extended else "thesis"
    acting: FeatureSet = "extended_action" if extended else "thesis_action"

    def fit(name: str, features: FeatureSet, multi: Prices | None = None) -> Affinity:
        return fit_drone_affinity(clips, out / name, features, drone, multi, folders, boosting, b, seed, overwrite)

    fit("affinity_drone.onnx", plain)
    single = fit("affinity_drone_saf.onnx", acting)
    settings = drone or RefinementSettings()
    for name, windows in WINDOWED.items():
        drone = replace(settings, windows=windows)
        fit(name, acting, Prices(single.observation, single))


def _features_of(
    clip: LabelledDetections, settings: RefinementSettings, multi: Prices | None
) -> tuple[FloatArray, FloatArray] | None:
    """Action features of detections as the earlier and as the later one of a pair."""
    if clip.actions is None:
        return None
    if multi is None:
        return clip.actions, clip.actions
    rows = DetectionRows(np.arange(len(clip)), clip.frames, clip.boxes, clip.scores, clip.features)
    flow = next(refine(rows, clip.actions, multi, replace(settings, iterations=1)))
    return compared_features(rows, flow.labels, clip.actions, settings)
