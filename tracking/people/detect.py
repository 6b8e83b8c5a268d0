"""`tsuiseki detect`: what a network detects in a video, for any program or tracker."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, fields
from pathlib import Path

from tsuiseki.tracking.cli.progress import progress
from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.features.foreign_options import DetectorOptions
from tsuiseki.tracking.following import SourceOptions, count
from tsuiseki.tracking.formats.mot import write_detections
from tsuiseki.tracking.formats.sensed_points import write_points
from tsuiseki.tracking.options import OutputFile, Shared
from tsuiseki.tracking.people.inputs import PeopleInputs, people_detect
from tsuiseki.tracking.people.settings import FindingOptions, PeopleFinding
from tsuiseki.tracking.types import Detections, Frame
from tsuiseki.tracking.video.source import Source, frames_expected
from tsuiseki.tracking.weights import PEOPLE_DETECTOR


@dataclass(frozen=True, kw_only=True)
class DetectSettings(Shared):
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
    detector_options: DetectorOptions = field(default_factory=DetectorOptions)
    score_threshold: float = 0.1
    classes: list[int | str] | None = None
    view: str = "auto"
    threads: int = 0
    device: Device = "auto"

    @property
    def finding(self) -> PeopleFinding:
        """The same as `track people` takes it."""
        return PeopleFinding(**{one.name: getattr(self, one.name) for one in fields(self)})

    def check(self) -> None:
        """See `Shared.check`."""
        self.finding.check()


def network_detections(
    source: Source, finding: FindingOptions, frames: Iterable[Frame] | None = None
) -> Iterator[tuple[int, Detections]]:
    """Frame numbers with what a network detects there; the options are checked at the call.

    Args:
        source: the video.
        finding: which network, and its tiles.
        frames: of the source, where somebody watches them; by default they are read.
    """
    detect = people_detect(source, finding, PEOPLE_DETECTOR)
    return PeopleInputs(source, detect, batch_size=finding.batch_size, threads=finding.threads).detections(frames)


def detect(video: SourceOptions, output: OutputFile, detecting: DetectSettings) -> int:
    """Write what a network detects in a video, without tracking.

    FILE becomes MOTChallenge text (det.txt), with the class in column 8. Where its name ends in .csv, it gets the
    columns frame,x,y with the centre of each box. Frames count from 1.
    """
    source = video.open(images=True, ends="")
    found = [Detections.empty()] * source.frames_wanted.first
    for _, here in progress(network_detections(source, detecting.finding), "detecting", frames_expected(source)):
        found.append(here)
    write = write_points if output.out.suffix == ".csv" else write_detections
    output.write(output.out, lambda path: write(path, found))
    total = count(sum(map(len, found)), "detection", "detections")
    print(f"{total} in {count(len(found) - source.frames_wanted.first, 'frame', 'frames')}: {output.out}")
    return 0
