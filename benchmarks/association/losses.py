"""Where a result loses: its scores as they are, and with places, identities, false boxes or misses put right by labels.

    python -m benchmarks.association.losses SEQUENCE RESULT [--frames 301-400]

A box of the result is of the labelled person that it is matched to in its frame (one to one, from IoU 0.5 on). A false
box is classed by where it lies: beside a missed person (IoU from 0.2 on), on people who have their box already (IoU
from 0.3 on, or half of it on one), or on no person, then by whether its track moves by half of its height.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.evaluation.coverage import UNMATCHED, matched_labels
from tsuiseki.tracking.evaluation.multi import evaluate_sequence, restrict
from tsuiseki.tracking.formats.mot import read_ground_truth, read_tracks
from tsuiseki.tracking.geometry import areas, intersections, iou_matrix
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, Track
from tsuiseki.tracking.types.frame_range import parse_frames
from tsuiseki.tracking.types.labels import GroundTruth

# IoU from which a false box is that of a person who was missed; from which, or which share of it, on one who was not.
BESIDE, ON_IOU, ON_SHARE, HALF = 0.2, 0.3, 0.5, 0.5


@dataclass(frozen=True)
class Rows:
    """Boxes of a result.

    Attributes:
        frames: ``(N,)``.
        ids: ``(N,)``.
        boxes: ``(N, 4)``.
        person: ``(N,)`` row of the labels that each is matched to, or `UNMATCHED`.
    """

    frames: IntArray
    ids: IntArray
    boxes: FloatArray
    person: IntArray

    def tracks(self) -> list[Track]:
        """As tracks; of two boxes of one id in a frame the first."""
        _, first = np.unique(np.stack([self.ids, self.frames], axis=1), axis=0, return_index=True)
        found = []
        for number in np.unique(self.ids):
            which = first[self.ids[first] == number]
            found.append(
                Track(
                    int(number), self.frames[which], self.boxes[which], np.ones(len(which)), np.ones(len(which), bool)
                )
            )
        return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sequence", type=Path)
    parser.add_argument("result", type=Path)
    parser.add_argument("--frames")
    arguments = parser.parse_args()
    wanted = parse_frames(arguments.frames)
    truth = read_ground_truth(arguments.sequence / "gt" / "gt.txt")
    truth = truth.select(wanted.mask(truth.frames) & truth.evaluated)
    tracks = restrict(read_tracks(arguments.result / "tracks.txt"), wanted)
    if not tracks:
        raise SystemExit(f"{arguments.result}: expected tracks in these frames, got none")
    rows = matched(truth, tracks)
    print(f"{'':36} HOTA   DetA   AssA   MOTA   IDF1  switches  false  missed")
    for name, each in put_right(truth, rows).items():
        s = evaluate_sequence(truth, each.tracks())
        shares = "  ".join(f"{value:.3f}" for value in (s.hota, s.det_a, s.ass_a, s.mota, s.idf1))
        print(f"{name:36}{shares}  {s.id_switches:8} {s.false_positives:6} {s.false_negatives:7}")
    for what, counts in (("false", false_kinds(truth, rows)), ("missed", missed_kinds(truth, rows))):
        print(f"{what}: " + ", ".join(f"{kind} {count}" for kind, count in counts.items()))


def matched(truth: GroundTruth, tracks: list[Track]) -> Rows:
    """The boxes of ``tracks``, matched to the labels of their frames."""
    frames = np.concatenate([t.frames for t in tracks])
    ids = np.concatenate([np.full(len(t), t.id) for t in tracks])
    boxes = np.concatenate([t.boxes for t in tracks])
    return Rows(frames, ids, boxes, matched_labels(frames, boxes, truth))


def false_kinds(truth: GroundTruth, rows: Rows) -> dict[str, int]:
    """How many false boxes lie where."""
    free = np.ones(len(truth.frames), dtype=np.bool_)
    free[rows.person[rows.person != UNMATCHED]] = False
    moving = {number for number in np.unique(rows.ids).tolist() if _moves(rows.boxes[rows.ids == number])}
    counts = dict.fromkeys(("beside a missed person", "doubled", "on no person, still", "on no person, moving"), 0)
    for row in np.flatnonzero(rows.person == UNMATCHED).tolist():
        here, box = truth.frames == rows.frames[row], rows.boxes[row]
        overlaps = iou_matrix(box[None], truth.boxes[here])[0]
        on_one = intersections(box[None, None], truth.boxes[here][None])[0, 0] / areas(box)
        taken = ~free[here]
        if (overlaps[free[here]] >= BESIDE).any():
            kind = "beside a missed person"
        elif (taken & ((overlaps >= ON_IOU) | (on_one >= ON_SHARE))).any():
            kind = "doubled"
        else:
            kind = "on no person, moving" if int(rows.ids[row]) in moving else "on no person, still"
        counts[kind] += 1
    return counts


def missed_kinds(truth: GroundTruth, rows: Rows) -> dict[str, int]:
    """How many missed people are boxed badly, and how many of the others are hidden by half or more."""
    missed = np.setdiff1d(np.arange(len(truth.frames)), rows.person)
    counts = dict.fromkeys(("boxed badly", "half hidden or more", "others"), 0)
    for row in missed.tolist():
        wrong = rows.boxes[(rows.frames == truth.frames[row]) & (rows.person == UNMATCHED)]
        if (iou_matrix(truth.boxes[row][None], wrong) >= BESIDE).any():
            counts["boxed badly"] += 1
        else:
            counts["half hidden or more" if truth.visibility[row] <= HALF else "others"] += 1
    return counts


def _moves(boxes: FloatArray) -> bool:
    """Whether feet pass half of the usual height."""
    feet = np.stack([boxes[:, [0, 2]].mean(axis=1), boxes[:, 3]], axis=1)
    return bool(np.hypot(*np.ptp(feet, axis=0)) >= HALF * np.median(boxes[:, 3] - boxes[:, 1]))


def put_right(truth: GroundTruth, rows: Rows) -> dict[str, Rows]:
    """The result as it is, and with one kind of error taken away at a time."""
    right = rows.person != UNMATCHED
    placed, named = rows.boxes.copy(), rows.ids + int(truth.ids.max()) + 1
    placed[right] = truth.boxes[rows.person[right]]
    named[right] = truth.ids[rows.person[right]]
    places, identities = replace(rows, boxes=placed), replace(rows, ids=named)
    missed = np.setdiff1d(np.arange(len(truth.frames)), rows.person)
    # Who was missed has the id of most of that person's boxes, in place of a box of that id elsewhere in the frame.
    usual = np.array([_usual(truth, rows, int(n)) for n in missed], dtype=np.int64)
    taken = (rows.ids[:, None] == usual) & (rows.frames[:, None] == truth.frames[missed])
    others = _kept(rows, ~taken.any(axis=1))
    filled = Rows(
        np.concatenate([others.frames, truth.frames[missed]]),
        np.concatenate([others.ids, usual]),
        np.concatenate([others.boxes, truth.boxes[missed]]),
        np.concatenate([others.person, missed]),
    )
    return {
        "as it is": rows,
        "right boxes at the labels' places": places,
        "right boxes with the labels' names": identities,
        "without false boxes": _kept(rows, right),
        "with those missed": filled,
        "places and names": replace(places, ids=named),
    }


def _usual(truth: GroundTruth, rows: Rows, missed: int) -> int:
    of_them = rows.ids[(rows.person != UNMATCHED) & (truth.ids[rows.person] == truth.ids[missed])]
    return int(np.bincount(of_them).argmax()) if len(of_them) else int(rows.ids.max()) + 1 + int(truth.ids[missed])


def _kept(rows: Rows, which: BoolArray) -> Rows:
    return Rows(rows.frames[which], rows.ids[which], rows.boxes[which], rows.person[which])


if __name__ == "__main__":
    main()
