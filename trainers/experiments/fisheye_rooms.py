"""Rooms under ceiling fisheye cameras: what is drawn of them, and what the networks make of it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.clip import FrameTruth, ground_truth
from tsuiseki.datamodules.scenes.room_clip import SIZES, Room, RoomClip, RoomSettings, plan_room
from tsuiseki.tracking.cameras.lens_files import read_lens
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera
from tsuiseki.tracking.cameras.person_model import PersonModel, build_table
from tsuiseki.tracking.features.exported import Appearance, Detector
from tsuiseki.tracking.fisheye.unrolled import looking
from tsuiseki.tracking.fisheye.view import CeilingView, Crops
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.types.tracks import FloorDetections

# Frames per second of the rooms (thesis 4.3.1), and people of each sequence; the small room's vary as in Table 4.2.
RATE = 15
PEOPLE: dict[Room, tuple[int, ...]] = {"large": (6,), "small": (4, 10, 3, 6)}
QUALITY = 95
# Detections below it are not kept: the lowest score that the experiment chooses from.
LEAST_SCORE = 0.2
CROPS: tuple[Crops, ...] = ("image", "upright")
STAGES = ("detect", "look up", "rectify", "describe")


@dataclass(frozen=True)
class CeilingClip:
    """One camera of one room.

    Attributes:
        room: large or small.
        seed: of the room.
        seconds: length.
        rate: frames per second that are kept, 1 or 15.
        camera: 0 or 1.
        calibration: lens file; None takes an equidistant lens.
    """

    room: Room
    seed: int
    seconds: int
    rate: int
    camera: int
    calibration: Path | None

    def plan(self) -> RoomClip[OmnidirectionalCamera]:
        """The room; its people walk alike at every rate."""
        people = PEOPLE[self.room]
        settings = RoomSettings(
            size=SIZES[self.room],
            frames=self.seconds * RATE,
            frame_rate=float(RATE),
            people=people[self.seed % len(people)],
        )
        return plan_room(settings, 10_000 + self.seed, read_lens(self.calibration) if self.calibration else None)

    def pictures(self) -> Iterator[tuple[int, ImageArray, FrameTruth]]:
        """Frame number in the room, picture ``(H, W, 3)`` uint8 RGB as a camera's JPEG has it, and truth."""
        room = self.plan()
        view = room.view(self.camera)
        for frame in range(0, self.seconds * RATE, RATE // self.rate):
            drawn, truth = room.draw_frame(view, frame)
            jpeg = cv2.imencode(".jpg", drawn[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
            image = np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_COLOR), dtype=np.uint8)[..., ::-1]
            yield frame, np.ascontiguousarray(image), truth


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
    """Files of the networks.

    Attributes:
        detector: file.
        appearance: file.
    """

    detector: Path
    appearance: Path


@dataclass(frozen=True)
class Observed:
    """The observations of a sequence, and the truth of one frame in every second.

    Attributes:
        rate: frames per second.
        found: of each frame, without features.
        features: by kind of crop, of each frame, in half precision.
        truth: its frames count seconds.
        places: ``(R, 2)`` metres, of the truth's rows.
        seconds: of each stage, over all frames.
    """

    rate: int
    found: list[FloorDetections]
    features: dict[str, list[FloatArray]]
    truth: GroundTruth
    places: FloatArray
    seconds: dict[str, float]

    def described(self, crops: str, least_score: float) -> list[FloorDetections]:
        """The detections from a score on, with the features of a kind of crop; ``none`` goes without."""
        result = []
        for frame, each in enumerate(self.found):
            kept = each.detections.scores >= least_score
            detections = each.detections.select(kept)
            if crops != "none":
                wide = self.features[crops][frame][kept].astype(np.float64)
                unit = wide / np.maximum(np.linalg.norm(wide, axis=1, keepdims=True), 1e-9)
                detections = detections.with_features(unit)
            result.append(FloorDetections(detections, each.rotated[kept], each.places[kept]))
        return result


def observe(clip: CeilingClip, models: CeilingModels) -> Observed:
    """What the networks make of the pictures of a sequence."""
    room = clip.plan()
    camera = room.cameras[clip.camera]
    appearance = Appearance(models.appearance, threads=1)
    table = build_table(camera, room.floor)
    views = {crops: CeilingView(camera, table, PersonModel(), appearance, crops) for crops in CROPS}
    detector = looking(Detector(models.detector, LEAST_SCORE, threads=1), camera, "unrolled")
    times, unmeasured = CpuTimes(dict.fromkeys(STAGES, 0.0)), CpuTimes()
    found, truths = list[FloorDetections](), list[FrameTruth]()
    features: dict[str, list[FloatArray]] = {crops: [] for crops in CROPS}
    for frame, image, truth in clip.pictures():
        with times.measure("detect"):
            detected = detector.detect([image])[0]
        located = views["upright"].locate(detected, times)
        for crops, each in views.items():
            own = each.describe(image, located, times if crops == "upright" else unmeasured).detections.features
            features[crops].append((np.empty((0, 128)) if own is None else own).astype(np.float16))
        plain = Detections(located.detections.boxes, detected.scores)
        found.append(FloorDetections(plain, located.rotated, located.places))
        truths += [truth] if frame % RATE == 0 else []
    places = np.concatenate([np.empty((0, 2)), *(one.places for one in truths if one.places is not None)])
    return Observed(clip.rate, found, features, ground_truth(truths), places, times.seconds)
