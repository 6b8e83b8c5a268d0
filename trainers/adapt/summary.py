"""What the report of an adaptation shows: pictures before and after, and examples of labels taken and refused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict

import numpy as np

from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.report.adapted import AdaptedReport, BeforeAndAfter, example_crop
from tsuiseki.tracking.types import Detections, ImageArray, Track
from tsuiseki.trainers.adapt.rounds import Adaptation, Round, above
from tsuiseki.trainers.adapt.track_labels import DELETED, SHORT, STILL, TAKEN, TWICE, UNSURE
from tsuiseki.trainers.adapt.watch import HELD_OUT, Watched

# Held-out pictures of each video that are shown.
_PICTURES = 4
# Boxes of each kind that are shown.
_EXAMPLES = 12
# A box of a track that became labels, where nothing was detected.
_FILLED = "filled"
# What became of boxes, in the order in which examples are shown.
_MEANINGS = {
    TAKEN: "Taken as labels",
    _FILLED: "Taken as labels where nothing was detected",
    STILL: "Refused, and background to learn from: never moves",
    TWICE: "Refused, and background to learn from: lies on surer tracks",
    DELETED: "Refused, and background to learn from: deleted by a correction",
    UNSURE: "Refused, and left out: unsure",
    SHORT: "Refused, and left out: too short",
}


def summary(
    adaptation: Adaptation, finished: Sequence[Round], best: Round, notes: Sequence[str], unlearnt: str
) -> AdaptedReport:
    """What to show of the rounds that are ``finished``.

    Args:
        adaptation: what they share.
        finished: from the start on.
        best: of them; the start where no round is kept.
        notes: lines about the camera and the end of the rounds.
        unlearnt: name of the detector that is left where no round is kept.
    """
    # Where nothing was better than the start, the last round shows why.
    pictured = best if best.number else finished[-1]
    return AdaptedReport(
        [video.source for video in adaptation.videos],
        [asdict(here.scores) for here in finished],
        best.number,
        [pair for n in range(len(adaptation.videos)) for pair in _compared(adaptation, finished[0], pictured, n)],
        _examples(adaptation, finished[0 if best.number == 0 else best.number - 1]),
        pictured.number,
        notes,
        unlearnt,
    )


def _compared(adaptation: Adaptation, start: Round, later: Round, number: int) -> list[BeforeAndAfter]:
    """The held-out pictures, some time apart, in which either finds most that the other does not."""
    video, threshold = adaptation.videos[number], adaptation.settings.score_threshold
    boxes_before, boxes_after = (above(here.detections[number], threshold) for here in (start, later))
    unseen = {n: video.frames[n] - video.span[0] for n in range(video.learnt(HELD_OUT), len(video.frames))}
    apart = {n: _differences(boxes_before[row], boxes_after[row]) for n, row in unseen.items()}
    chosen = spread_best(apart, _PICTURES, max(1, len(unseen) // (2 * _PICTURES)))
    return [
        BeforeAndAfter(
            f"frame {video.frames[n] + 1} of {video.source}",
            video.picture(n),
            boxes_before[unseen[n]],
            boxes_after[unseen[n]],
        )
        for n in chosen
    ]


def spread_best(values: Mapping[int, int], count: int, distance: int) -> list[int]:
    """Up to ``most`` numbers with the largest values, ``distance`` apart, in their order."""
    chosen: list[int] = []
    for number in sorted(values, key=lambda n: -values[n]):
        if len(chosen) < count and all(abs(number - chosen_number) >= distance for chosen_number in chosen):
            chosen.append(number)
    return sorted(chosen)


def _differences(first: Detections, second: Detections) -> int:
    """Boxes of either that the other does not have, from an IoU of 0.5 on."""
    shared = len(assign_overlaps(iou_matrix(first.boxes, second.boxes), 0.5)[0])
    return len(first) + len(second) - 2 * shared


def _examples(adaptation: Adaptation, taught_by: Round) -> dict[str, list[ImageArray]]:
    """Some boxes of each kind, by their meanings."""
    rng = np.random.default_rng(0)
    places: dict[str, list[tuple[Watched, int, np.ndarray]]] = {}
    for video, labels in zip(adaptation.videos, taught_by.labels, strict=True):
        number_of = {frame: picture for picture, frame in enumerate(video.frames)}
        for track, verdict in zip(labels.everyone, labels.verdicts, strict=True):
            for row in _rows(rng, track):
                frame = int(track.frames[row])
                kind = _FILLED if verdict.verdict == TAKEN and not track.observed[row] else verdict.verdict
                if frame in number_of:
                    places.setdefault(kind, []).append((video, number_of[frame], track.boxes[row]))
    examples = {}
    for kind in [kind for kind in _MEANINGS if kind in places]:
        sample = [places[kind][i] for i in rng.permutation(len(places[kind]))[:_EXAMPLES]]
        examples[_MEANINGS[kind]] = [example_crop(video.picture(picture), box) for video, picture, box in sample]
    return examples


def _rows(rng: np.random.Generator, track: Track) -> list[int]:
    """A few rows of a track, those filled in apart from the others."""
    chosen = []
    for kind in (track.observed, ~track.observed):
        rows = np.flatnonzero(kind)
        chosen += rng.choice(rows, min(4, len(rows)), replace=False).tolist()
    return chosen
