"""Coloured objects by particles that look at the image, beside connected components linked by SORT (`reproduce blobs`).

Both get the same pixels of the colour. The baseline takes each patch of them that is large enough for an object, as the
filter's births do, and links patches by SORT.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace

import numpy as np

from tsuiseki.datamodules.scenes.blob_clip import BlobSceneSettings, as_ground_truth, plan_blobs
from tsuiseki.tracking.evaluation.points import PointScores, PointTracks, evaluate_points
from tsuiseki.tracking.features.colour_region import NAMED_COLOURS, ColourImage, ColourRange
from tsuiseki.tracking.filters.finite_sets.region_births import PatchBirths
from tsuiseki.tracking.people.sort import Sort
from tsuiseki.tracking.points.blob_tracker import BlobSettings, BlobTracker
from tsuiseki.tracking.types import Detections, FloatArray, Frame, Track
from tsuiseki.trainers.experiments.experiment import Bench, Outcome, Table, at_least_one

CUT_OFF = 50.0
FIRST_SEED = 700
"""Of the clips: nothing else draws from it on."""
USUAL = BlobSceneSettings(frames=100, width=480, height=360)
SCENES: Mapping[str, BlobSceneSettings] = {
    "usual clutter: 12 patches up to a third of an object": USUAL,
    "hard: 40 patches up to a half of an object": replace(USUAL, clutter=40, clutter_reach=0.25),
    "hard, and 10 others flash in every frame": replace(USUAL, clutter=40, clutter_reach=0.25, flashes=10),
}


class ComponentsAndSort:
    """The baseline.

    Args:
        colour: of the objects.
        settings: its smallest side of an object is that of a patch.
    """

    def __init__(self, colour: ColourRange, settings: BlobSettings) -> None:
        self.colour, self.sort = colour, Sort()
        self._patches = PatchBirths(smallest=settings.smallest, limit=200)

    def update(self, frame: Frame) -> object:
        """Take the next frame."""
        boxes = self._patches.patches(ColourImage.of(frame.image, self.colour), np.empty((0, 4)))
        return self.sort.update(Detections(boxes, np.ones(len(boxes))))

    def tracks(self) -> list[Track]:
        """The tracks so far."""
        return self.sort.tracks()


def reproduce(bench: Bench, seeds: int = 5, particles: int = 300) -> Outcome:
    """The tracker of coloured objects beside connected components and SORT, with usual and with hard clutter.

    DIR gets results.json and tables.md.

    Args:
        bench: where it works.
        seeds: clips of each kind.
        particles: of each target.

    Raises:
        RequestError: a number below 1.
    """
    at_least_one(seeds=seeds, particles=particles)
    jobs = [(scene, name, FIRST_SEED + n) for scene in SCENES for name in METHODS for n in range(seeds)]
    found: dict[tuple[str, str], list[PointScores]] = {}
    for scene, name, seed in bench.watch.over(jobs, "clips", len(jobs)):
        scores = bench.store.recall(run_clip, SCENES[scene], name, seed, particles)
        found.setdefault((scene, name), []).append(scores)
    values = [
        {"scene": scene, "method": name, "runs": [asdict(one) for one in runs]} for (scene, name), runs in found.items()
    ]
    columns = ("clutter", "method", "OSPA p=1", "missed a frame", "false a frame", "count error", "switches a clip")
    rows = [(scene, name, *_means(runs)) for (scene, name), runs in found.items()]
    note = f"{seeds} clips of each kind from seed {FIRST_SEED}, cut-off {CUT_OFF:g}; ± is the standard error."
    return Outcome(values, [Table("", columns, rows)], notes=[note])


def run_clip(scene: BlobSceneSettings, method: str, seed: int, particles: int) -> PointScores:
    """One method on one clip, an object being there while half of it is in the image."""
    colour, settings = NAMED_COLOURS[scene.colour], BlobSettings(particles=particles)
    tracker = METHODS[method](colour, settings)
    boxes = []
    for index, ((image,), there) in enumerate(plan_blobs(scene, seed).frames()):
        tracker.update(Frame(index, index / scene.frame_rate, image))
        boxes.append(there)
    truth = as_ground_truth(_half_in_view(np.stack(boxes), scene))
    places = (truth.boxes[:, :2] + truth.boxes[:, 2:]) / 2
    return evaluate_points(
        PointTracks(truth.frames, truth.ids, places), PointTracks.of(tracker.tracks()), scene.frames, CUT_OFF
    )


def _half_in_view(boxes: FloatArray, scene: BlobSceneSettings) -> FloatArray:
    """Boxes ``(T, K, 4)``, NaN while less than half lies in the image."""
    size = np.array([scene.width, scene.height])
    sides = np.clip(np.minimum(boxes[..., 2:], size) - np.maximum(boxes[..., :2], 0), 0, None)
    share = sides.prod(axis=-1) / (boxes[..., 2:] - boxes[..., :2]).prod(axis=-1)
    return np.asarray(np.where((share >= 0.5)[..., None], boxes, np.nan))


def _means(runs: list[PointScores]) -> tuple[str, ...]:
    first = np.array([run.ospa1 for run in runs])
    error = first.std(ddof=1) / np.sqrt(len(first)) if len(first) > 1 else float("nan")
    names = ("missed", "false", "cardinality_error", "switches")
    means = [float(np.mean([getattr(run, name) for run in runs])) for name in names]
    return (f"{first.mean():.1f} ± {error:.1f}", *(f"{mean:.2f}" for mean in means))


def believed_at_once(colour: ColourRange, settings: BlobSettings) -> BlobTracker:
    """The tracker without its confirmation."""
    return BlobTracker(colour, replace(settings, confirm=(1, 1)))


METHODS: Mapping[str, Callable[[ColourRange, BlobSettings], ComponentsAndSort | BlobTracker]] = {
    "components and SORT": ComponentsAndSort,
    "track blobs": BlobTracker,
    "track blobs --confirm 1,1": believed_at_once,
}
