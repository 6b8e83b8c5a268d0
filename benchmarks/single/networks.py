"""One target by a network: areas, precision, whether the status is true, what is found again, and the time.

    python -m benchmarks.single.networks ../shared/data/peers/nanotrackv2/*.onnx --data ../shared/data \
        --peer /path/to/venv/bin/python

Real clips are all of sot/; people of PETS and MOT17-13 are apart from them. Generated ones are
`benchmarks.single.disappearances` of seeds that taught nothing. Peers are OpenCV's TrackerNano, here, and CSRT, KCF and
MIL of the environment of `--peer`, which holds `opencv-contrib-python-headless`. Intervals are 95 %, over clips.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.papers.tables import bootstrap
from benchmarks.single.disappearances import KINDS, drawn
from benchmarks.single.people import people_clips
from tsuiseki.tracking.evaluation.success_curves import SequenceScores, evaluate_boxes
from tsuiseki.tracking.formats.single import find_single_sequences
from tsuiseki.tracking.geometry import corners_from_xywh, iou_pairs
from tsuiseki.tracking.single.settings import NONE, SingleChoice
from tsuiseki.tracking.single.tracker import SingleTracker
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray
from tsuiseki.tracking.video.image_folder import read_image

# Frames within which a target that is visible again is to be found: a second.
SECOND = 25
PEER_SCRIPT = Path(__file__).with_name("opencv_boxes.py")


@dataclass(frozen=True)
class ClipRun:
    """What one tracker did on one clip, without the first frame.

    Attributes:
        boxes: ``(T, 4)``.
        scores: ``(T,)``.
        tracking: ``(T,)`` whether the status was so.
        milliseconds: of CPU a frame.
    """

    boxes: FloatArray
    scores: FloatArray
    tracking: BoolArray
    milliseconds: float


def followed(tracker: SingleTracker, images: Sequence[ImageArray], box: FloatArray) -> ClipRun:
    """A tracker of ours over a clip."""
    tracker.start(images[0], box)
    begin = time.process_time()
    states = [tracker.follow(image) for image in images[1:]]
    spent = 1000 * (time.process_time() - begin) / len(states)
    boxes, scores = np.array([s.box for s in states]), np.array([s.score for s in states])
    return ClipRun(boxes, scores, np.array([s.status == "tracking" for s in states]), spent)


def opencv_nano(files: Sequence[Path], images: Sequence[ImageArray], box: FloatArray) -> ClipRun:
    """OpenCV's own loop over NanoTrack's files, backbone first."""
    opencv: Any = cv2  # its stubs do not tell of trackers
    parameters = opencv.TrackerNano_Params()
    parameters.backbone, parameters.neckhead = map(str, files)
    tracker, turned = (
        opencv.TrackerNano_create(parameters),
        [np.ascontiguousarray(image[..., ::-1]) for image in images],
    )
    corner, size = np.trunc(box[:2]).astype(int), np.trunc(box[2:] - box[:2]).astype(int)
    tracker.init(turned[0], (*corner.tolist(), *size.tolist()))
    begin, boxes, scores = time.process_time(), [], []
    for image in turned[1:]:
        boxes.append(tracker.update(image)[1])
        scores.append(tracker.getTrackingScore())
    spent = 1000 * (time.process_time() - begin) / len(boxes)
    return ClipRun(corners_from_xywh(np.array(boxes, float)), np.array(scores), np.ones(len(boxes), bool), spent)


def opencv_peer(python: str, name: str, images: Sequence[ImageArray], box: FloatArray) -> ClipRun:
    """A tracker of OpenCV-contrib in another environment."""
    with tempfile.TemporaryDirectory() as folder:
        np.save(Path(folder) / "images.npy", np.array(images))
        words = [python, str(PEER_SCRIPT), name, str(Path(folder) / "images.npy"), ",".join(map(str, box))]
        boxes, spent = json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout)
    return ClipRun(np.array(boxes), np.ones(len(boxes)), np.ones(len(boxes), bool), spent)


def real_clips(data: Path) -> Iterator[tuple[str, list[ImageArray], FloatArray]]:
    """Name, images and boxes of each clip of sot/."""
    for part in ("otb", "vot", "uav", "uav-more"):
        for sequence in find_single_sequences(data / "sot" / part):
            if sequence.images:
                yield sequence.name, [read_image(path) for path in sequence.images], sequence.boxes


def calibration_error(chances: FloatArray, on: BoolArray) -> float:
    """Expected calibration error with ten bins."""
    bins = np.minimum((10 * chances).astype(int), 9)
    parts = [(bins == k) for k in range(10) if (bins == k).any()]
    return float(sum(abs(chances[part].mean() - on[part].mean()) * part.mean() for part in parts))


def on_and_off(found: FloatArray, boxes: FloatArray, visible: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Which of the boxes ``found`` ``(F, 4)`` from the second frame on are on the target, and which are off it.

    On it: IoU above 0.5 with its box, of which half is visible. Off it: no overlap, or all hidden and IoU below 0.3.
    Neither, where it has no label. Both are ``(F,)``, or shorter where the labels end before.
    """
    count = min(len(found), len(boxes) - 1)
    truth, seen = boxes[1 : count + 1], visible[1 : count + 1]
    overlaps, labelled = iou_pairs(truth, found[:count]), np.isfinite(truth).all(axis=1)
    on = (overlaps > 0.5) & (seen >= 0.5) & labelled
    off = ((overlaps <= 0) | ((seen < 0.1) & (overlaps < 0.3))) & labelled
    return on, off


def status_line(name: str, runs: Sequence[ClipRun], truths: Sequence[tuple[FloatArray, FloatArray]]) -> str:
    """Whether the status is true, over clips."""
    parts = [on_and_off(run.boxes, *truth) for run, truth in zip(runs, truths, strict=True)]
    on, off = (np.concatenate(side) for side in zip(*parts, strict=True))
    tracking = np.concatenate([run.tracking[: len(a)] for run, (a, _) in zip(runs, parts, strict=True)])
    chances = np.concatenate([run.scores[: len(a)] for run, (a, _) in zip(runs, parts, strict=True)])
    clear = on | off
    return (
        f"{name}: {off.sum()} frames off, tracking in {100 * tracking[off].mean():.0f} % of them; not tracking in "
        f"{100 * (~tracking[on]).mean():.1f} % of {on.sum()} on; calibration error "
        f"{calibration_error(chances[clear], on[clear]):.3f}"
    )


def recoveries(run: ClipRun, boxes: FloatArray, visible: FloatArray) -> tuple[int, int, int]:
    """Disappearances, those after which it is found within `SECOND`, and those where something else is tracked."""
    hidden = visible[1:] < 0.1
    begins = np.flatnonzero(~hidden[:-1] & hidden[1:]) + 1
    overlaps, count, found, wrong = iou_pairs(boxes[1:], run.boxes), 0, 0, 0
    for begin in begins:
        back = next((t for t in range(begin, len(hidden)) if visible[t + 1] >= 0.5), None)
        if back is None or overlaps[:begin][-10:].max(initial=0.0) < 0.5:
            continue
        after = slice(back, back + SECOND)
        count += 1
        right = (overlaps[after] > 0.5).any()
        found += int(right)
        wrong += int(not right and (run.tracking[after] & (overlaps[after] <= 0)).sum() > SECOND / 2)
    return count, found, wrong


def real_part(files: Sequence[Path], data: Path, python: str | None) -> None:
    """The table of real clips."""
    runs: dict[str, list[ClipRun]] = {}
    truths, names = [], []
    for name, images, boxes in real_clips(data):
        names.append(name)
        truths.append((boxes, np.ones(len(boxes))))
        entries = {
            "combined": followed(SingleChoice(network=tuple(files)).tracker(), images, boxes[0]),
            "siamese": followed(SingleChoice("siamese", network=tuple(files)).tracker(), images, boxes[0]),
            "no network": followed(SingleChoice(network=NONE).tracker(), images, boxes[0]),
        }
        if len(files) == 2 and hasattr(cv2, "TrackerNano_create") and "backbone" in files[0].name:
            entries["OpenCV Nano"] = opencv_nano(files, images, boxes[0])
        for peer in ("CSRT", "KCF", "MIL") if python else ():
            entries[f"OpenCV {peer}"] = opencv_peer(python or "", peer, images, boxes[0])
        for entry, run in entries.items():
            runs.setdefault(entry, []).append(run)
        print(name, {e: f"{100 * _area(run, boxes):.1f}" for e, run in entries.items()}, flush=True)
    base = np.array([100 * _area(run, boxes) for run, (boxes, _) in zip(runs["siamese"], truths, strict=True)])
    print(f"\n{'':16}{'AUC':>7}{'lowest':>8}{'P@20':>7}{'ms':>7}   gain over siamese")
    for entry, of in runs.items():
        areas = np.array([100 * _area(run, boxes) for run, (boxes, _) in zip(of, truths, strict=True)])
        precision = np.mean([_scores(run, boxes).precision_20 for run, (boxes, _) in zip(of, truths, strict=True)])
        _, low, high = bootstrap(areas - base)
        print(
            f"{entry:16}{areas.mean():7.1f}{areas.min():8.1f}{100 * precision:7.1f}"
            f"{np.mean([run.milliseconds for run in of]):7.2f}   {(areas - base).mean():+.1f} [{low:+.1f}, {high:+.1f}]"
        )
    print(status_line("combined, real clips", runs["combined"], truths))


def people_part(files: Sequence[Path], data: Path) -> None:
    """Areas on people, with and without the network, and the status."""
    clips = list(people_clips(data))
    if not clips:
        print("no people: the data lacks mot/")
        return
    choices = {"combined": SingleChoice(network=tuple(files)), "no network": SingleChoice(network=NONE)}
    runs = {
        entry: [followed(choice.tracker(), clip.images, clip.boxes[0]) for clip in clips]
        for entry, choice in choices.items()
    }
    areas = {
        entry: np.array([100 * _area(run, clip.boxes) for run, clip in zip(of, clips, strict=True)])
        for entry, of in runs.items()
    }
    names = np.array([clip.name.rsplit(" ", 1)[0] for clip in clips])
    for name in np.unique(names).tolist():
        part = names == name
        mean, low, high = bootstrap((areas["combined"] - areas["no network"])[part])
        means = ", ".join(f"{entry} {values[part].mean():.1f}" for entry, values in areas.items())
        print(f"{part.sum()} people of {name}: {means}; gain {mean:+.1f} [{low:+.1f}, {high:+.1f}]")
    truths = [(clip.boxes, clip.visible) for clip in clips]
    for entry, of in runs.items():
        print(status_line(f"{entry}, people", of, truths))


def generated_part(files: Sequence[Path], first: int, last: int) -> None:
    """Status and recoveries on generated disappearances."""
    runs, truths, counts = [], [], np.zeros((len(KINDS), 3), dtype=int)
    for seed in range(first, last):
        clip = drawn(seed)
        run = followed(SingleChoice(network=tuple(files)).tracker(), list(clip.images), clip.boxes[0])
        runs.append(run)
        truths.append((clip.boxes, clip.visible))
        counts[KINDS.index(clip.kind)] += recoveries(run, clip.boxes, clip.visible)
    print(status_line(f"combined, generated clips {first} to {last - 1}", runs, truths))
    for kind, (count, found, wrong) in zip(KINDS, counts.tolist(), strict=True):
        print(f"  {kind}: {count} disappearances, found again within a second {found}, another thing tracked {wrong}")


def _scores(run: ClipRun, boxes: FloatArray) -> SequenceScores:
    return evaluate_boxes(boxes, np.concatenate([boxes[:1], run.boxes]))


def _area(run: ClipRun, boxes: FloatArray) -> float:
    return float(_scores(run, boxes).auc)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("network", type=Path, nargs="+", help="ONNX files, NanoTrack's backbone first")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--peer", help="python of an environment with opencv-contrib-python-headless")
    parser.add_argument("--seeds", type=int, nargs=2, default=(32, 72))
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    real_part(arguments.network, arguments.data, arguments.peer)
    people_part(arguments.network, arguments.data)
    generated_part(arguments.network, *arguments.seeds)


if __name__ == "__main__":
    main()
