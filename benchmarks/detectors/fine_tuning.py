"""How much `tsuiseki train detector --data FOLDER` gains on later frames of the same camera, which it never saw.

    python -m benchmarks.detectors.fine_tuning --out out/fine-tuning [--streets 5] [--pets FOLDER] [--input 256 320]
        [--batches 60]

Each generated street is a camera of its own: its first two thirds are the labelled video, whose last tenth chooses the
epoch, and its last third is scored. With `--pets` the folder PETS09-S2L1-first gives frames 1-360 and 361-400.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from benchmarks.papers.tables import interval
from tsuiseki.datamodules.labelled_images import labelled_images
from tsuiseki.datamodules.video_pictures import read_image
from tsuiseki.tracking.cli import main as tsuiseki
from tsuiseki.tracking.evaluation.detection import LabelledBoxes, evaluate_detections
from tsuiseki.tracking.features.exported import Detector
from tsuiseki.tracking.weights import PEOPLE_DETECTOR, shipped
from tsuiseki.trainers.detector_labels import LOWEST_SCORE
from tsuiseki.trainers.fit import fit_detector

# Of the first street; no training of a shipped model used these.
SEED = 8200


def main() -> None:
    """Train, score and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--streets", type=int, default=5)
    parser.add_argument("--size", type=int, nargs=2, default=(320, 240), help="width and height of the streets")
    parser.add_argument("--pets", type=Path)
    parser.add_argument("--frames", type=int, default=180, help="of a street")
    parser.add_argument("--input", type=int, nargs=2, help="height and width of the detector's input")
    parser.add_argument("--batches", type=int, default=60, help="steps of each of the five epochs")
    arguments = parser.parse_args()
    width, height = arguments.size
    options = [f"--model.{name}={side}" for name, side in zip(("height", "width"), arguments.input or (), strict=False)]
    options.append(f"--data.batches={arguments.batches}")
    print(f"{'clip':14} pictures   start AP50  AP75   trained AP50  AP75   s CPU", flush=True)
    changes = []
    for seed in range(SEED, SEED + arguments.streets):
        clip = arguments.out / f"street-{seed}"
        if not clip.exists():
            size = f"--width {width} --height {height}"
            words = f"simulate street --frames {arguments.frames} {size} --seed {seed} --out {clip}"
            assert tsuiseki(words.split()) == 0
        changes.append(measured(clip, arguments.frames * 2 // 3, arguments.frames, options))
    if len(changes) > 1:
        for name, values in zip(("AP50", "AP75"), np.array(changes).T, strict=True):
            mean, low, high = interval(values)
            print(f"change in {name}: {mean:+.3f} [{low:+.3f}, {high:+.3f}] over {len(changes)} streets", flush=True)
    if arguments.pets is not None:
        link = arguments.out / "pets"
        if not link.exists():
            link.symlink_to(arguments.pets.resolve())
        measured(link, 360, 400, options)


def measured(clip: Path, learnt: int, last: int, options: list[str]) -> tuple[float, float]:
    """Change in AP50 and AP75 on the frames after ``learnt``, up to ``last``; prints a row."""
    begin = time.process_time()
    out = clip.with_name(f"{clip.name}-trained")
    if not (out / "detector.onnx").exists():
        part = first_frames(clip, learnt)
        assert fit_detector(["--data", str(part), "--out", str(out), "--overwrite=true", *options]) is not None
    pictures = labelled_images(clip, (learnt + 1, last))
    truth = [LabelledBoxes(picture.boxes, picture.ignored) for picture in pictures]
    scores = []
    for file in (shipped(PEOPLE_DETECTOR), out / "detector.onnx"):
        detector = Detector(file, LOWEST_SCORE)
        detected = [detector.detect([read_image(picture.picture)])[0] for picture in pictures]
        scores.append([evaluate_detections(truth, detected, iou).average_precision for iou in (0.5, 0.75)])
    (a, b), (c, d) = scores
    seconds = time.process_time() - begin
    print(f"{clip.name:14} {len(pictures):8} {a:12.3f} {b:5.3f} {c:14.3f} {d:5.3f} {seconds:7.0f}", flush=True)
    return c - a, d - b


def first_frames(clip: Path, count: int) -> Path:
    """A folder with the first frames of a clip and their labels."""
    part = clip.with_name(f"{clip.name}-first-{count}")
    (part / "img1").mkdir(parents=True, exist_ok=True)
    (part / "gt").mkdir(exist_ok=True)
    for picture in sorted((clip / "img1").iterdir())[:count]:
        if not (part / "img1" / picture.name).exists():
            (part / "img1" / picture.name).symlink_to(picture.resolve())
    rows = (clip / "gt" / "gt.txt").read_text().splitlines()
    (part / "gt" / "gt.txt").write_text("\n".join(row for row in rows if int(row.split(",")[0]) <= count) + "\n")
    return part


if __name__ == "__main__":
    main()
