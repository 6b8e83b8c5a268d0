"""New targets are believed by M of N frames."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from tsuiseki.datamodules.scenes.blob_clip import BlobClip, BlobSceneSettings
from tsuiseki.tracking.features.colour_region import NAMED_COLOURS
from tsuiseki.tracking.filters.finite_sets.region_phd import Confirmation, at_patches
from tsuiseki.tracking.points.settings import BlobSettings
from tsuiseki.tracking.points.tracker import BlobTracker
from tsuiseki.tracking.types import Frame


@pytest.mark.parametrize(
    ("hits", "frames", "seen", "believed", "failed"),
    [
        (1, 1, [1], 1, 0),
        (3, 3, [1, 1, 1], 3, 0),
        (3, 3, [1, 0, 1], 0, 2),  # one miss is one too many
        (2, 4, [1, 0, 0, 1], 4, 0),
        (2, 4, [1, 0, 0, 0], 0, 4),
        (2, 4, [0, 0, 0, 1], 0, 3),  # one frame is left, and two are asked
        (2, 2, [1, 1, 0, 0, 0], 2, 0),  # what is believed stays so
    ],
)
def test_so_many_of_the_first_frames(hits: int, frames: int, seen: list[int], believed: int, failed: int) -> None:
    confirmation, label = Confirmation(hits, frames), np.array([7])
    at, ended = 0, 0
    for frame, hit in enumerate(seen, start=1):
        gone = confirmation.update(label, np.array([hit > 0]))
        at = at or (frame if confirmation.confirmed(label)[0] else 0)
        if len(gone):
            ended = frame
            break
    assert (at, ended) == (believed, failed)


def test_what_is_gone_is_forgotten() -> None:
    confirmation = Confirmation(2, 2)
    for labels in ([1, 2], [1, 2], [2, 3]):
        confirmation.update(np.array(labels), np.ones(2, dtype=np.bool_))
    assert confirmation.confirmed(np.array([1, 2, 3])).tolist() == [False, True, False]


def test_a_patch_is_at_a_box_that_shares_most_of_the_smaller() -> None:
    boxes = np.array([[0.0, 0, 20, 20], [100, 100, 120, 120]])
    patches = np.array([[2.0, 2, 10, 10], [115, 115, 160, 160]])
    assert at_patches(boxes, patches).tolist() == [True, False]
    assert at_patches(boxes, np.empty((0, 4))).tolist() == [False, False]
    assert at_patches(np.empty((0, 4)), patches).tolist() == []


def test_flashes_make_no_targets() -> None:
    scene = BlobSceneSettings(
        frames=25, width=320, height=240, objects=2, clutter=15, clutter_reach=0.25, flashes=6, enter=0.0, stay=True
    )
    lengths = {}
    for confirm in ((1, 1), (3, 3)):
        tracker = BlobTracker(NAMED_COLOURS[scene.colour], BlobSettings(particles=150, confirm=confirm))
        for index, ((image,), _) in enumerate(BlobClip(scene, 3).frames()):
            tracker.update(Frame(index, index / scene.frame_rate, image))
        lengths[confirm] = sorted(len(track) for track in tracker.tracks())
    # Both objects throughout; resting patches of an object's size are objects to both.
    assert lengths[3, 3][-2:] == [25, 25]
    assert len(lengths[3, 3]) < len(lengths[1, 1]) - 3


@pytest.mark.parametrize("bad", [(0, 3), (4, 3)])
def test_impossible_numbers_are_refused(bad: tuple[int, int]) -> None:
    with pytest.raises(ValidationError, match="confirm"):
        BlobSettings(confirm=bad)
