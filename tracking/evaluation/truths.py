"""What results are scored against: the people labelled at a path, in the frames that count."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.label_checks import NothingLabelledError
from tsuiseki.tracking.formats.labelled import Size, open_labelled
from tsuiseki.tracking.formats.okutama import Protocol
from tsuiseki.tracking.types.frame_range import EVERY_FRAME, FrameRange
from tsuiseki.tracking.types.labels import GroundTruth


@dataclass(frozen=True)
class Truth:
    """The labels of one sequence.

    Attributes:
        name: of the sequence.
        labels: its ground truth, of the frames that count.
        length: number of frames; None where nothing tells.
        frames: that count; results in others are passed over.
        size: width and height of the pictures, where the sequence says.
        wanted: number or name of the class that the labels are of; None for people, whatever class results have.
        classes: names by number, where the layout has numbers.
        files: one image a frame; empty where only labels are there.
    """

    name: str
    labels: GroundTruth
    length: int | None
    frames: FrameRange = EVERY_FRAME
    size: Size = None
    wanted: int | str | None = None
    classes: Mapping[int, str] = field(default_factory=dict)
    files: Sequence[Path] = ()


def read_truths(
    path: Path,
    frames: FrameRange = EVERY_FRAME,
    protocol: Protocol = "lenient",
    size: Size = None,
    wanted: int | str | None = None,
    single: bool = False,
) -> list[Truth]:
    """The labels at ``path``.

    Args:
        path: see `open_labelled`.
        frames: to keep, with their numbers.
        protocol: by which Okutama-Action's labels count, see `okutama_truth`.
        size: width and height of the frames that were tracked, for Okutama-Action's labels; by default those of the
            frames that lie with them, or else of those that come with the data.
        wanted: number or name of a class; by default people. Videos in which none of it is labelled are left out.
        single: boxes without ids count, too.

    Raises:
        RequestError: there are none, they are broken, or no label in these frames counts.
    """
    truths, without = [], list[NothingLabelledError]()
    for video in open_labelled(path):
        try:
            labels = video.people(protocol, size, wanted, single)
        except NothingLabelledError as error:
            without.append(error)
            continue
        more = video.size, wanted, video.classes, video.files
        truths.append(Truth(video.name, labels, video.length, video.counted(protocol), *more))
    if without and (wanted is None or not truths):
        raise without[0]
    for each in without:
        warnings.warn(f"{each}; left out", InputWarning, stacklevel=2)
    return [_restricted(truth, frames) for truth in truths] if frames != EVERY_FRAME else truths


def _restricted(truth: Truth, frames: FrameRange) -> Truth:
    last = int(truth.labels.frames.max())
    wanted = frames.within(truth.length or last + 1)
    assert wanted.last is not None
    first = max(wanted.first, truth.frames.first)
    labels = truth.labels.between(first, wanted.last)
    if not labels.evaluated.any():
        raise RequestError(f"{truth.name}: expected a labelled box that counts in frames {frames}, got none")
    return replace(truth, labels=labels, frames=FrameRange(first, frames.last))
