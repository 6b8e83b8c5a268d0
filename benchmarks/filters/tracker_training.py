"""The long training of the Siamese tracker: steps, fixed clips, the curve, and a comparison with other trackers.

    python -m benchmarks.filters.tracker_training run --until 16:50 [--options WORD ...]
    python -m benchmarks.filters.tracker_training compare --data ../shared/data
    python -m benchmarks.filters.tracker_training plot --out curve.png

``run`` goes on from the shipped files, and better ones take their place: the pages must follow. A fresh machine needs
the repository, and the pictures that docs/methods/tracker.md names. A step is a run of configs/tracker_generated.yaml
of another seed; ``--options`` change it. The number that must rise is the overlap of the best box on generated pairs.
Areas under the success curve of the plain loop, on generated clips and on the real ones in ``--data``, are recorded
beside it and choose nothing.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch

from benchmarks.long_training import LongTraining, command, draw_curve, next_time
from benchmarks.papers.single_target import Loaded, TargetClip, drawn_clips, read_clip
from benchmarks.papers.tables import bootstrap
from tsuiseki import configs
from tsuiseki.datamodules.tracker import TrackerData
from tsuiseki.tracking.evaluation.success_curves import SequenceScores, evaluate_boxes
from tsuiseki.tracking.formats.single import find_single_sequences
from tsuiseki.tracking.geometry import corners_from_xywh, xywh_from_corners
from tsuiseki.tracking.single.settings import NONE, SingleChoice
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.tracker import Tracker

# The search file is what a step starts from.
BEST = tuple(shipped(f"tracker_{part}") for part in ("search", "template"))
RECORD = Path(__file__).with_name("tracker.jsonl")
CONFIG = Path(str(configs.__path__[0])) / "tracker_generated.yaml"
# Generated pairs that choose the best step.
PAIRS = 256
HEADLINE = "overlap of pairs"
# Generated clips.
CLIPS = 6

# Boxes of all frames but the first, from the images and the first box.
Follow = Callable[[Sequence[ImageArray], FloatArray], FloatArray]


def main() -> None:
    """Do what the words ask for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run", "compare", "plot"))
    parser.add_argument("--until", type=next_time, default="23:59", help="no step begins after the next time HH:MM")
    parser.add_argument("--options", nargs=argparse.REMAINDER, default=[], help="of `tsuiseki train tracker`; last")
    parser.add_argument("--photographs", type=Path, help="of configs/tracker_generated.yaml")
    parser.add_argument("--files", type=Path, nargs=2, default=BEST, help="exported, to compare")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--work", type=Path, default=Path("out/train/tracker_long"))
    parser.add_argument("--out", type=Path, default=Path("out/tracker.png"))
    words = parser.parse_args()
    cv2.setNumThreads(1)
    if words.what == "compare":
        print(table(words.data, words.files))
    elif words.what == "plot":
        draw_curve(RECORD, (HEADLINE, "generated AUC", "real AUC"), words.out)
    else:
        pictures = [] if words.photographs is None else ["--data.photographs", str(words.photographs)]
        training(words.data, [*pictures, *words.options]).run(words.work, words.until)


def training(data: Path, options: Sequence[str]) -> LongTraining:
    """The long training, from the best files so far."""

    def fit(best: Sequence[Path], work: Path, number: int) -> list[Path]:
        start = ["--model.start", str(best[0]), "--data.seed", str(number)]
        command(
            ["train", "tracker", "--config", str(CONFIG), "--out", str(work), "--overwrite", "true", *start, *options]
        )
        return exported(work)

    clips = drawn_clips(CLIPS)
    return LongTraining(BEST, RECORD, HEADLINE, (), (), fit, lambda files: scores_of(files, clips, data))


def exported(work: Path) -> list[Path]:
    """The two files of a finished training in ``work``, in the order of `BEST`."""
    command([
        "export", "tracker", "--checkpoint", str(work / "checkpoints" / "last.ckpt"), "--float16",
        "--out", str(work / "tracker.onnx"), "--training-data", "generated pairs, with freely usable pictures in them",
    ])  # fmt: skip
    return [work / best.name for best in BEST]


def scores_of(files: Sequence[Path], clips: Mapping[str, TargetClip], data: Path) -> dict[str, float]:
    """Overlap on pairs, and areas on generated clips and on the real ones where they are, all in hundredths."""
    scores = {HEADLINE: pair_overlap(files[0]), "generated AUC": mean_area(network(files), clips)}
    real = real_clips(data)
    return scores | ({"real AUC": mean_area(network(files), real)} if real else {})


def pair_overlap(file: Path) -> float:
    """Mean overlap of the best box on generated pairs, in hundredths, of an exported search file."""
    module = Tracker(start=file).eval()
    with torch.no_grad():
        for number, batch in enumerate(TrackerData(validation=PAIRS).val_dataloader()):
            module.validation_step(batch, number)
    return 100 * module.scores(module.validated)["overlap"]


def real_clips(data: Path) -> dict[str, TargetClip]:
    """The real clips below ``data`` by name; none where it is missing."""
    folder = data / "sot"
    names = sorted(path for kind in ("otb", "vot", "uav", "uav-more") for path in (folder / kind).glob("*"))
    return {path.name: partial(read_clip, find_single_sequences(path)[0]) for path in names}


def network(files: Sequence[Path]) -> Follow:
    """The plain loop about a network."""
    return ours(SingleChoice(method="siamese", network=tuple(files)))


def ours(choice: SingleChoice) -> Follow:
    """A tracker of the toolkit."""

    def follow(images: Sequence[ImageArray], box: FloatArray) -> FloatArray:
        tracker = choice.tracker()
        tracker.start(images[0], box)
        return np.stack([tracker.follow(image).box for image in images[1:]])

    return follow


def opencv_nano(images: Sequence[ImageArray], box: FloatArray, files: Sequence[Path]) -> FloatArray:
    """OpenCV's own loop about NanoTrack's backbone and head."""
    parameters: Any = cv2.TrackerNano_Params()  # type: ignore[attr-defined]
    parameters.backbone, parameters.neckhead = map(str, files)
    tracker: Any = cv2.TrackerNano_create(parameters)  # type: ignore[attr-defined]
    tracker.init(np.ascontiguousarray(images[0][..., ::-1]), tuple(xywh_from_corners(box).round().astype(int).tolist()))
    boxes = [tracker.update(np.ascontiguousarray(image[..., ::-1]))[1] for image in images[1:]]
    return corners_from_xywh(np.array(boxes, dtype=np.float64))


def scored(follow: Follow, clip: Loaded) -> SequenceScores:
    """The scores on one clip."""
    truth, images = clip
    return evaluate_boxes(truth, np.concatenate([truth[:1], follow(images, truth[0])]))


def mean_area(follow: Follow, clips: Mapping[str, TargetClip]) -> float:
    """Mean area under the success curve of the clips, in hundredths."""
    return 100 * float(np.mean([scored(follow, clip()).auc for clip in clips.values()]))


def table(data: Path, files: Sequence[Path]) -> str:
    """Area and precision of each tracker on each real clip, and what ours gains, with an interval over the clips."""
    peer = data / "peers" / "nanotrackv2"
    nano = [peer / f"nanotrack_{part}_sim.onnx" for part in ("backbone", "head")]
    trackers: dict[str, Follow] = {
        "ours": network(files),
        "combined": ours(SingleChoice("combined", NONE)),
        "cv2.TrackerNano": partial(opencv_nano, files=nano),
    }
    clips, rows = real_clips(data), list[list[SequenceScores]]()
    lines = ["AUC / precision at 20 px", f"{'':14}" + "".join(f"{name:>18}" for name in trackers)]
    for name, clip in clips.items():
        loaded = clip()
        rows.append([scored(follow, loaded) for follow in trackers.values()])
        lines.append(f"{name:14}" + "".join(f"{100 * s.auc:10.1f} /{100 * s.precision_20:6.1f}" for s in rows[-1]))
    areas = 100 * np.array([[scores.auc for scores in row] for row in rows])
    precisions = 100 * np.array([[scores.precision_20 for scores in row] for row in rows])
    means = zip(areas.mean(axis=0), precisions.mean(axis=0), strict=True)
    lines.append(f"{'mean':14}" + "".join(f"{area:10.1f} /{precision:6.1f}" for area, precision in means))
    return "\n".join([*lines, *_gains(areas, list(trackers))])


def _gains(areas: FloatArray, names: Sequence[str]) -> Iterator[str]:
    """Lines of what the first of the trackers gains over each other, with 95 % intervals over clips."""
    for column, name in enumerate(names[1:], 1):
        gain = areas[:, 0] - areas[:, column]
        mean, low, high = bootstrap(gain)
        yield f"ours over {name}: {mean:+.1f} [{low:.1f}, {high:.1f}], better on {(gain > 0).sum()} of {len(gain)}"


if __name__ == "__main__":
    main()
