"""Rooms under ceiling fisheye cameras: their pictures, truth and observations, kept on disk."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.clip import FrameTruth, ground_truth
from tsuiseki.datamodules.scenes.room_clip import (
    SIZES,
    Room,
    RoomClip,
    RoomSettings,
    plan_room,
)
from tsuiseki.datamodules.simulated_detections import DetectorFaults, simulate_detections
from tsuiseki.tracking.cameras.lens_files import read_lens
from tsuiseki.tracking.cameras.person_model import PersonModel, build_table
from tsuiseki.tracking.features.exported import Appearance, Detector
from tsuiseki.tracking.fisheye.unrolled import looking
from tsuiseki.tracking.fisheye.view import CeilingView, Crops
from tsuiseki.tracking.result import StageTimes
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.types.tracks import FloorDetections
from tsuiseki.tracking.video.image_folder import read_image

# Frames per second of the rooms (thesis 4.3.1), and people of each sequence; the small room's vary as in Table 4.2.
RATE = 15
PEOPLE: dict[Room, tuple[int, ...]] = {"large": (6,), "small": (4, 10, 3, 6)}
TRUTH = ("ids", "boxes", "visibility", "places")
QUALITY = 95
# Pictures of a part, which is kept when a run is stopped: three quarters of a minute of work.
PART = 180


@dataclass(frozen=True)
class CeilingClip:
    """One camera of one room, or a part of its frames.

    Attributes:
        room: large or small.
        seed: of the room.
        camera: 0 or 1.
        seconds: length.
        rate: frames per second that are kept, 1 or 15.
        calibration: lens file; None takes an equidistant lens.
        part: number of the part of `PART` pictures, from 0.
    """

    room: Room
    seed: int
    camera: int
    seconds: int
    rate: Literal[1, 15]
    calibration: Path | None
    part: int = 0


def parts_of(sequence: CeilingClip) -> list[CeilingClip]:
    """The parts of a sequence, in order."""
    return [replace(sequence, part=part) for part in range(-(-sequence.seconds * sequence.rate // PART))]


def plan(sequence: CeilingClip) -> RoomClip:
    """The room of a sequence; its people walk alike at every rate."""
    people = PEOPLE[sequence.room]
    settings = RoomSettings(
        size=SIZES[sequence.room],
        frames=sequence.seconds * RATE,
        frame_rate=float(RATE),
        people=people[sequence.seed % len(people)],
    )
    lens = None if sequence.calibration is None else read_lens(sequence.calibration)
    return plan_room(settings, 10_000 + sequence.seed, lens)


def frames_of(sequence: CeilingClip) -> range:
    """The frames of the room's clip in a part."""
    every = range(0, sequence.seconds * RATE, RATE // sequence.rate)
    return every[sequence.part * PART : (sequence.part + 1) * PART]


def render(folder: Path, sequence: CeilingClip) -> None:
    """Write the pictures of a sequence and their truth to ``folder``."""
    clip = plan(sequence)
    view = clip.view(sequence.camera)
    folder.mkdir(parents=True, exist_ok=True)
    rows: dict[str, list[Any]] = {name: [] for name in ("count", *TRUTH)}
    for frame in frames_of(sequence):
        image, truth = clip.draw_frame(view, frame)
        cv2.imwrite(str(_path(folder, frame)), image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        rows["count"].append(np.array([len(truth.ids)]))
        for name in TRUTH:
            rows[name].append(getattr(truth, name))
    arrays: dict[str, Any] = {name: np.concatenate(values) for name, values in rows.items()}
    np.savez_compressed(folder / "truth.npz", **arrays)


def read_rendered(folder: Path, sequence: CeilingClip) -> Iterator[tuple[int, ImageArray, FrameTruth]]:
    """Frame number, picture ``(H, W, 3)`` uint8 RGB and truth of each frame that `render` wrote."""
    with np.load(folder / "truth.npz", allow_pickle=False) as stored:
        ends = np.cumsum(stored["count"])[:-1]
        truths = [np.split(stored[name], ends) for name in TRUTH]
    for frame, *values in zip(frames_of(sequence), *truths, strict=True):
        yield frame, read_image(_path(folder, frame)), FrameTruth(*values)


def _path(folder: Path, frame: int) -> Path:
    return folder / f"{frame:06d}.jpg"


# Detections below it are not kept: the lowest score that the experiment chooses from.
LEAST_SCORE = 0.2
# Of detections that are drawn from the truth: sixteen of a hundred people in full view are missed.
FAULTS = DetectorFaults(jitter=0.04, missed=0.16, hidden=0.5, false_alarms=0.3, persistence=0.0, doubled=0.03)
CROPS: tuple[Crops, ...] = ("image", "upright")
STAGES = ("detect", "look up", "rectify", "describe")


class CpuTimes(StageTimes):
    """Seconds of the processor instead of the clock, which other programs change."""

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Add the processor's time inside the ``with`` block to ``stage``."""
        start = time.process_time()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.process_time() - start


@dataclass(frozen=True)
class CeilingModels:
    """Files of the networks; without a detector, faulty detections are drawn from the truth.

    Attributes:
        detector: file.
        appearance: file.
    """

    detector: Path | None
    appearance: Path


@dataclass(frozen=True)
class Observed:
    """The observations of a sequence, and the truth of one frame in every second.

    Attributes:
        rate: frames per second.
        found: of each frame, without features.
        features: by kind of crop, of each frame.
        truth: its frames count seconds.
        places: ``(R, 2)`` metres, of the truth's rows.
        seconds: of each stage, over all frames.
        persons: number of detections.
    """

    rate: int
    found: list[FloorDetections]
    features: dict[str, list[FloatArray]]
    truth: GroundTruth
    places: FloatArray
    seconds: dict[str, float]
    persons: int

    def described(self, crops: str, least_score: float) -> list[FloorDetections]:
        """The detections from a score on, with the features of a kind of crop; ``none`` goes without."""
        result = []
        for frame, each in enumerate(self.found):
            kept = each.detections.scores >= least_score
            detections = each.detections.select(kept)
            if crops != "none":
                detections = detections.with_features(self.features[crops][frame][kept])
            result.append(FloorDetections(detections, each.rotated[kept], each.places[kept]))
        return result


def observe(folder: Path, sequence: CeilingClip, rendered: Path, networks: CeilingModels) -> None:
    """Run the networks over the pictures of a part of a sequence, and write their output to ``folder``."""
    clip = plan(sequence)
    camera = clip.cameras[sequence.camera]
    table = build_table(camera, clip.floor)
    appearance = Appearance(networks.appearance, threads=1)
    views = {crops: CeilingView(camera, table, PersonModel(), appearance, crops) for crops in CROPS}
    detector = None
    if networks.detector is not None:
        detector = looking(Detector(networks.detector, LEAST_SCORE, threads=1), camera, "unrolled")
    times, unmeasured = CpuTimes(), CpuTimes()
    rows: dict[str, list[Any]] = {name: [] for name in ("count", "boxes", "scores", "rotated", "places", *views)}
    labels: dict[str, list[Any]] = {name: [] for name in ("frames", "ids", "boxes", "visibility", "places")}
    for frame, image, truth in read_rendered(rendered, sequence):
        with times.measure("detect"):
            found = _drawn_from(truth, sequence, frame) if detector is None else detector.detect([image])[0]
        located = views["upright"].locate(found, times)
        for crops, each in views.items():
            described = each.describe(image, located, times if crops == "upright" else unmeasured)
            features = described.detections.features
            rows[crops].append(np.empty((0, 128)) if features is None else features)
        boxes = located.detections.boxes
        for name, values in (("boxes", boxes), ("scores", found.scores), ("rotated", located.rotated),
                             ("places", located.places), ("count", np.array([len(found)]))):  # fmt: skip
            rows[name].append(values)
        if frame % RATE == 0:
            labels["frames"].append(np.full(len(truth.ids), frame // RATE))
            for name in ("ids", "boxes", "visibility", "places"):
                labels[name].append(getattr(truth, name))
    folder.mkdir(parents=True, exist_ok=True)
    arrays = {name: np.concatenate(values) for name, values in rows.items()}
    arrays |= {f"truth_{name}": np.concatenate(values) for name, values in labels.items()}
    arrays |= {f"seconds_{stage}": np.array(times.seconds.get(stage, 0.0)) for stage in STAGES}
    kept: dict[str, Any] = {name: a.astype(np.float16) if name in CROPS else a for name, a in arrays.items()}
    np.savez_compressed(folder / "observed.npz", **kept, rate=np.array(sequence.rate))


def _drawn_from(truth: FrameTruth, sequence: CeilingClip, frame: int) -> Detections:
    """Detections of a frame by a better detector than ours."""
    if not len(truth.ids):
        return Detections.empty()
    rng = np.random.default_rng([sequence.seed, sequence.camera, frame, 9])
    return simulate_detections(rng, ground_truth([truth]), 1, 1280, 960, FAULTS)[0]


def read_observed(folders: Iterable[Path]) -> Observed:
    """The observations of the parts of a sequence, in their order, as `observe` wrote them."""
    parts: list[dict[str, Any]] = []
    for folder in folders:
        with np.load(folder / "observed.npz", allow_pickle=False) as stored:
            parts.append(dict(stored.items()))
    arrays = {name: np.concatenate([np.atleast_1d(part[name]) for part in parts]) for name in parts[0]}
    ends = np.cumsum(arrays["count"])[:-1]
    split = {name: np.split(arrays[name], ends) for name in ("boxes", "scores", "rotated", "places")}
    found = [
        FloorDetections(Detections(b, s), r, p)
        for b, s, r, p in zip(*(split[n] for n in ("boxes", "scores", "rotated", "places")), strict=True)
    ]
    features: dict[str, list[FloatArray]] = {
        n: [_unit(f) for f in np.split(arrays[n], ends)] for n in CROPS if n in arrays
    }
    ids = arrays["truth_ids"].astype(np.int64)
    everyone = np.ones(len(ids), dtype=np.bool_)
    truth = GroundTruth(
        arrays["truth_frames"].astype(np.int64), ids, arrays["truth_boxes"], everyone, ~everyone,
        arrays["truth_visibility"],
    )  # fmt: skip
    seconds = {stage: float(arrays[f"seconds_{stage}"].sum()) for stage in STAGES}
    return Observed(
        int(arrays["rate"][0]), found, features, truth, arrays["truth_places"], seconds, int(arrays["count"].sum())
    )


def _unit(features: Any) -> FloatArray:
    wide = features.astype(np.float64)
    return np.asarray(wide / np.maximum(np.linalg.norm(wide, axis=1, keepdims=True), 1e-9))
