"""`tsuiseki detect`: what a network detects in a video, for any program or tracker."""

from __future__ import annotations

from dataclasses import field, fields
from pathlib import Path

from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS, Share
from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.features.foreign_options import DetectorOptions
from tsuiseki.tracking.fields import ClassNames, Options, Threads
from tsuiseki.tracking.formats.measurement_tables import write_points
from tsuiseki.tracking.formats.mot import write_detections
from tsuiseki.tracking.people.detections import network_detections
from tsuiseki.tracking.people.settings import ForeignDetector, PeopleFinding, Tiles
from tsuiseki.tracking.runs.following import SourceOptions, count
from tsuiseki.tracking.runs.options import OutputFile
from tsuiseki.tracking.runs.progress import progress
from tsuiseki.tracking.types import Detections


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class DetectSettings(Options):
    """Which network detects, and what.

    Attributes:
        detector: detector as ONNX; by default the shipped detector_people.onnx. A bare word names another shipped one,
            or a downloaded one, such as yolox-s (tsuiseki models list).
        detector_options: reading of another project's detector, where its file leaves it open.
        score_threshold: least score of a detection that is kept, from 0 to 1.
        classes: detect these classes, by number or name, such as person,car; by default people.
        view: overlapping tiles of a frame for the detector; see track people.
        threads: CPU cores of the network; 0 takes all.
        device: what the network runs on: cpu, cuda (a GPU, with onnxruntime-gpu), or auto (cuda where it works).
    """

    detector: Path | None = None
    detector_options: ForeignDetector = field(default_factory=DetectorOptions)
    score_threshold: Share = 0.1
    classes: ClassNames | None = None
    view: Tiles = "auto"
    threads: Threads = 0
    device: Device = "auto"

    @property
    def finding(self) -> PeopleFinding:
        """The same as `track people` takes it."""
        return PeopleFinding(**{option.name: getattr(self, option.name) for option in fields(self)})


DETECTING = DetectSettings()


def detect(video: SourceOptions, *, output: OutputFile, detecting: DetectSettings = DETECTING) -> int:
    """Write what a network detects in a video, without tracking.

    FILE becomes MOTChallenge text (det.txt), with the class in column 8. Where its name ends in .csv, it gets the
    columns frame,x,y with the centre of each box. Frames count from 1.
    """
    source = video.open(images=True, ends="")
    detections = [Detections.empty()] * source.frames_wanted.first
    steps = progress(network_detections(source, detecting.finding), "detecting", source.frames_expected)
    detections += [of_frame for _, of_frame in steps]
    write = write_points if output.out.suffix == ".csv" else write_detections
    output.write(output.out, lambda path: write(path, detections))
    total = count(sum(map(len, detections)), "detection", "detections")
    print(f"{total} in {count(len(detections) - source.frames_wanted.first, 'frame', 'frames')}: {output.out}")
    return 0
