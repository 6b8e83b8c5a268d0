"""Labels: confident tracks with their filled boxes; what never moves is background; who is unknown teaches nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.trainers.adapt import street
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.correction_log import CORRECTIONS_FILE, CorrectedVideo, Correction, append, boxes_of
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.frame_range import EVERY_FRAME
from tsuiseki.trainers.adapt.track_labels import (
    DELETED,
    SHORT,
    STILL,
    TAKEN,
    TWICE,
    UNSURE,
    certain_boxes,
    corrections_in,
    label,
)
from tsuiseki.trainers.adapt.watch import Watched, watch, with_empty_view

NONE = Detections.empty()
# So far to the right that the boxes touch: they are 14 wide.
ASIDE = np.array([12.0, 0, 12, 0])


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Watched:
    folder = tmp_path_factory.mktemp("camera")
    return watch(str(street.write_video(folder / "street")), EVERY_FRAME, folder / "kept", 40)


def test_each_track_gets_its_verdict(watched: Watched) -> None:
    sure, doubtful = street.track_of(0), street.track_of(1, score=0.3)
    brief = street.track_of(1, frames=4)
    tracks = [sure, replace(doubtful, id=2), street.decoy_track(), replace(brief, id=3)]
    labels = label(with_empty_view(watched), tracks, [NONE] * 40)
    assert {v.id: v.verdict for v in labels.verdicts} == {1: TAKEN, 2: UNSURE, 9: STILL, 3: SHORT}
    assert [t.id for t in labels.tracks] == [1]
    people = labels.people
    assert set(people.ids[people.evaluated]) == {1}
    assert 9 not in people.ids
    assert {2, 3} <= set(people.ids[people.ignored])
    assert [t.id for t in labels.everyone] == [1, 2, 9, 3]


def test_who_is_boxed_twice_is_background(watched: Watched) -> None:
    """A box that straddles two people who walk together: no label, no doubt, and detections there teach that."""
    pair = [street.track_of(0), replace(street.track_of(0), id=2, boxes=street.track_of(0).boxes + ASIDE)]
    between = replace(pair[0], id=3, boxes=pair[0].boxes + ASIDE / 2, scores=0.8 * pair[0].scores)
    rejected = [Detections(between.boxes[f][None], np.array([0.4])) for f in watched.frames]
    labels = label(with_empty_view(watched), [*pair, between], rejected)
    assert [v.verdict for v in labels.verdicts] == [TAKEN, TAKEN, TWICE]
    assert set(labels.people.ids[labels.people.evaluated]) == {1, 2}
    ignored = labels.people.boxes[labels.people.ignored]
    assert not (np.abs(ignored[:, None] - between.boxes[None]).max(axis=2).min(axis=1) < 4).any()


def test_who_is_hidden_behind_others_is_left_out(watched: Watched) -> None:
    """Boxes that are filled in where surer people stand before them are no labels; those before and after are."""
    pair = [street.track_of(0), replace(street.track_of(0), id=2, boxes=street.track_of(0).boxes + ASIDE)]
    hidden = (np.arange(street.FRAMES) > 40) & (np.arange(street.FRAMES) < 70)
    aside = np.where(hidden, 6.0, 0.0)[:, None] * [1, 0, 1, 0] + np.where(hidden, 0.0, 45.0)[:, None] * [0, 1, 0, 1]
    third = replace(pair[0], id=3, boxes=pair[0].boxes + aside, scores=0.8 * pair[0].scores, observed=~hidden)
    labels = label(watched, [*pair, third], [NONE] * 40)
    assert labels.verdicts[2].verdict == TAKEN
    people = labels.people.select(labels.people.ids == 3)
    behind = hidden[np.array(watched.frames)[people.frames]]
    np.testing.assert_array_equal(people.evaluated, ~behind)
    np.testing.assert_array_equal(people.ignored, behind)


def test_what_never_moves_may_be_left_out(watched: Watched) -> None:
    labels = label(
        with_empty_view(watched),
        [street.track_of(0), street.decoy_track()],
        [NONE] * 40,
        sitting=True,
    )
    assert 9 in labels.people.ids[labels.people.ignored]


def test_filled_boxes_are_labels_and_mostly_filled_tracks_are_not(watched: Watched) -> None:
    observed = np.ones(street.FRAMES, dtype=np.bool_)
    observed[20:60] = False
    some = replace(street.track_of(0), observed=observed)
    labels = label(with_empty_view(watched), [some], [NONE] * 40)
    assert labels.verdicts[0].filled == 40
    assert len(labels.people.frames[labels.people.evaluated]) == 40
    most = replace(some, observed=np.arange(street.FRAMES) < 40)
    assert label(with_empty_view(watched), [most], [NONE] * 40).verdicts[0].verdict == UNSURE


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_boxes_are_moved_part_of_the_way_onto_silhouettes(watched: Watched, share: float) -> None:
    tracks = [street.track_of(n, shift=0.4) for n in range(2)]
    labels = label(with_empty_view(watched), tracks, [NONE] * 40, onto_silhouettes=share)
    right = np.concatenate([t.boxes[:, 2] for t in labels.tracks])
    truth = np.concatenate([[street.box_of(n, f)[2] for f in t.frames] for n, t in enumerate(labels.tracks)])
    # From 0.4 widths to 0.08, the room about silhouettes; an edge is found to a pixel.
    assert abs(np.median(right - truth) - (0.4 - 0.32 * share) * 14) < 1.0


def test_where_somebody_may_be_nothing_is_learnt(watched: Watched) -> None:
    """Person 1 is rejected, the decoy is rejected, too: only the first moves."""
    frames = [*watched.frames]
    rejected = [Detections(np.stack([street.box_of(1, f), street.DECOY]), np.array([0.2, 0.25])) for f in frames]
    labels = label(with_empty_view(watched), [street.track_of(0)], rejected)
    ignored = labels.people.boxes[labels.people.ignored]
    assert not (np.abs(ignored - street.DECOY).max(axis=1) < 1).any()
    found = [np.abs(ignored - street.box_of(1, f)).max(axis=1).min() < 1e-6 for f in frames[:20]]
    assert np.mean(found) > 0.9


def test_a_moving_camera_has_tracks_alone(watched: Watched) -> None:
    labels = label(watched, [street.track_of(0, shift=0.2), street.decoy_track()], [NONE] * 40)
    assert {v.verdict for v in labels.verdicts} == {TAKEN}
    assert (labels.offset == 0).all()


def test_detections_on_no_track_teach_nothing(watched: Watched) -> None:
    """Before a moving camera nobody knows what they are."""
    found = [Detections(street.people(f), np.array([0.9, 0.2])) for f in watched.frames]
    people = label(watched, [street.track_of(0)], found).people
    apart = [n for n, f in enumerate(watched.frames) if abs(street.box_of(0, f)[0] - street.box_of(1, f)[0]) > 14]
    assert len(apart) > 20
    for n in apart:
        ignored = people.boxes[people.ignored & (people.frames == n)]
        np.testing.assert_allclose(ignored, street.people(watched.frames[n])[1:])


def test_labels_are_as_wide_as_detected_in_their_frame(watched: Watched) -> None:
    """The track has the mean width; every other detection is 2 pixels wider on the right."""
    wider = [np.array([0, 0, 2.0 * (f % 2), 0]) for f in range(street.FRAMES)]
    track = street.track_of(0, shift=1 / 14)
    found = [Detections(street.people(f)[:1] + wider[f], np.array([0.9])) for f in watched.frames]
    people = label(watched, [track], found).people
    for n, frame in enumerate(watched.frames):
        np.testing.assert_allclose(people.boxes[people.frames == n], street.people(frame)[:1] + wider[frame])


def test_what_was_corrected_is_certain(watched: Watched, tmp_path: Path) -> None:
    """A doubtful track that is said to be a person teaches, a deleted one is background, a drawn box is a label."""
    doubtful, wrong = street.track_of(1, score=0.3), replace(street.track_of(0), id=3)
    moved, alone = watched.frames[5], np.array([60.0, 5.0, 74.0, 25.0])
    (one,), (drawn,) = boxes_of([moved], [street.box_of(1, moved)]), boxes_of([moved], [alone])
    said = [
        Correction("right", boxes_of(range(9), doubtful.boxes[:9])),
        Correction("delete", boxes_of(wrong.frames.tolist(), wrong.boxes)),
        Correction("several", parts=(Correction("box", (drawn,)), Correction("box", (one, one._replace(x=one.x + 3))))),
    ]
    append(tmp_path / CORRECTIONS_FILE, said, CorrectedVideo("street", street.SIZE, street.FRAMES))
    certain = certain_boxes(corrections_in(tmp_path, ["street"]), street.SIZE)
    rejected = [Detections(street.box_of(0, f)[None], np.array([0.9])) for f in watched.frames]
    labels = label(watched, [doubtful, wrong], rejected, certain=certain)
    assert [v.verdict for v in labels.verdicts] == [TAKEN, DELETED]
    assert not labels.people.ignored.any()
    here = labels.people.boxes[labels.people.frames == 5]
    np.testing.assert_allclose(here, [alone, street.box_of(1, moved) + np.array([3, 0, 3, 0])], atol=0.01)
    assert (np.bincount(labels.people.frames) == [1 + (n == 5) for n in range(40)]).all()
    for wrong_place, sources in ((tmp_path / "gone", ["a"]), (tmp_path, ["a", "b"])):
        with pytest.raises(RequestError, match="`corrections`"):
            corrections_in(wrong_place, sources)
