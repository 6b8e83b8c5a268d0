"""`tsuiseki track people`: everyone in view, each with an id.

`tsuiseki detect`: what a network detects in a video, for any program or tracker.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.features.foreign_options import DetectorOptions
from tsuiseki.tracking.formats.measurement_tables import write_points
from tsuiseki.tracking.formats.mot import write_detections
from tsuiseki.tracking.options import OutputFile, Shared
from tsuiseki.tracking.people.inputs import PeopleInputs, people_detect
from tsuiseki.tracking.people.settings import FindingOptions, Linking, PeopleFinding
from tsuiseki.tracking.runs.following import SourceOptions, Video, count
from tsuiseki.tracking.runs.progress import progress
from tsuiseki.tracking.runs.run import SeededOutput
from tsuiseki.tracking.types import Detections, Frame
from tsuiseki.tracking.video.source import Source
from tsuiseki.tracking.weights import PEOPLE_DETECTOR

if TYPE_CHECKING:
    from tsuiseki.tracking.people.hiding import Hiding, Wanted
    from tsuiseki.tracking.people.tracking import OpenedPeople
    from tsuiseki.tracking.result import Result
    from tsuiseki.tracking.runs.run import Run
    from tsuiseki.tracking.types import Track


def people(
    video: Video, output: SeededOutput, finding: PeopleFinding, linking: Linking, hide: str | None = None
) -> int:
    """Track the people in a video: each gets a number that stays.

    Without further options the people are detected, described and linked by the models that ship with the toolkit.
    DIR gets tracks.txt (MOTChallenge text), report.html with its plots and numbers in report/, run.json, with --method
    flow flow.npz (what tsuiseki review asks about) and, with --overlay, overlay.webm.

    Args:
        seed: of random numbers; kept in run.json, for the methods here draw none.
        hide: in the overlay and in the pictures of the report hide people, heads, or all-but the tracks with these
            ids, such as all-but 3,5; see tsuiseki hide.
    """
    return track(video, output, finding, linking, hide)


def track(
    video: Video,
    output: SeededOutput,
    finding: PeopleFinding,
    linking: Linking,
    hide: str | None = None,
    replayed: Callable[[Run, OpenedPeople], tuple[OpenedPeople, Iterator[tuple[int, Detections]]]] | None = None,
) -> int:
    """`people`, where ``replayed`` may give what runs instead, and each frame's number with its detections."""
    from tsuiseki.tracking.answers.page import counted, with_page
    from tsuiseki.tracking.features.view_choice import report_blank, report_models
    from tsuiseki.tracking.formats.mot import detection_lines
    from tsuiseki.tracking.people.hiding import Wanted
    from tsuiseki.tracking.people.tracking import open_people, people_result

    wanted = None if hide is None else Wanted.parse(hide)
    source = video.open(images=wanted is not None, timed=True)
    opened = open_people(source, finding, linking, output.seed)
    with output.run() as run:
        run.facts |= report_models(opened.inputs.detect, opened.inputs.describe)
        if replayed is None:
            frames = run.frames(source, record=video.overlay or wanted is not None)
            detections = opened.inputs.detections(frames, run.times)
        else:
            opened, detections = replayed(run, opened)
        kept = run.kept("detections.txt", detections, None if finding.detections else detection_lines)
        steps = run.steps(kept)
        settings = {"method": linking.method, "source": video.source, "hide": hide}
        result, lines = people_result(opened, steps, run.times, settings)
        for line in lines:
            print(line)
        report_blank(opened.inputs.detect)
        hiding = None if wanted is None else _hiding(run, source, result, wanted, finding)
        again = None if hiding is None else lambda: hiding.hidden(run.replay(source))
        run.save(
            with_page(result, hide=hiding and hiding.hidden),
            lambda: video.draw(run, source, result, frames=again) if wanted is None or hiding else None,
        )
        run.done(f"{counted(result.tracks)} in {count(run.count, 'frame', 'frames')}: {output.out / 'tracks.txt'}")
    return run.status


def _hiding(run: Run, source: Source, result: Result[Track], wanted: Wanted, finding: PeopleFinding) -> Hiding | None:
    """What to hide, whose places in doubt are listed in ``doubtful.csv``; None where that was not finished."""
    from tsuiseki.tracking.people.hiding import SENSITIVE, Hiding, find_missed

    score, written = min(finding.threshold, SENSITIVE), list[Hiding]()
    second = replace(finding, detections=None, classes=None, score_range=None, score_threshold=score)

    def write(path: Path) -> None:
        hiding = find_missed(source, run.replay(source), list(result), wanted, second)
        hiding.write_doubts(path)
        written.append(hiding)

    run.draw("doubtful.csv", write)
    for hiding in written:
        print(hiding.summary(run.output.out / "doubtful.csv"))
    return written[0] if written else None


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

    The frames are read, unless ``frames`` of the source are given.
    """
    detect = people_detect(source, finding, PEOPLE_DETECTOR)
    return PeopleInputs(source, detect, batch_size=finding.batch_size, threads=finding.threads).detections(frames)


def detect(video: SourceOptions, output: OutputFile, detecting: DetectSettings) -> int:
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
