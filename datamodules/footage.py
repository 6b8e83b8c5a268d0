"""Labelled images held for training, and what composing people onto a fixed camera's frames needs. No torch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tsuiseki.datamodules.augmentation import Example
from tsuiseki.datamodules.composition import Cutout, SizeByRow, cut_out_people, empty_view, fit_size_by_row
from tsuiseki.datamodules.labelled_images import labelled_images, read_image
from tsuiseki.datamodules.scenes.training_pictures import BoxConvention
from tsuiseki.tracking.types import ImageArray

# Most bytes of decoded images kept of one source; beyond it they are decoded anew each time.
_MEMORY = 1 << 30


@dataclass(frozen=True)
class TrainingSource:
    """Labelled video to learn from or to validate on.

    Attributes:
        folder: a MOTChallenge sequence or a folder of sequences, VisDrone-MOT or Okutama-Action.
        frames: first and last frame of each sequence, 1-based and both included; null for all.
        part: likewise in shares of its length, such as [0, 0.9].
        share: how often examples come from here, relative to the other sources.
        fixed_camera: the camera stands still in each sequence, so that people can be cut out and pasted.
        least_visible: people of whom a smaller share is visible are ignored, in [0, 1].
        generate: fill a folder that does not exist with this many random generated pictures.
        scene: what those show: a street; streets, crowds, views from afar and empty places by day and night (varied);
            few people among many things (sparse); people among many things from above (aerial); a few people near the
            camera (near); people all around below a fisheye camera (overhead); people who act under a drone; or people
            in rooms, as ceiling cameras see them in unrolled pictures.
        sprites: folder of rendered people (`tsuiseki simulate sprites`), shown in varied, sparse, aerial, near and
            overhead pictures.
        photographs: folder of photographs without people: ``surfaces/`` and ``views/`` for the grounds of these, cut
            out ``things/`` to stand on them.
        town: these pictures show things of towns, too: traffic lights, signs, bicycles, shop fronts and the like.
        things: and photographed things, which the folder of photographs must hold.
        sun: share of the pictures in a hard sun, in [0, 1]; of all scenes but streets and rooms.
        boxes: how people are boxed in these: round their silhouettes; or steady, as wide as in a whole walk on average,
            as people label videos.
        seed: of those.
        size: their width and height, pixels; by default those of the input.
    """

    folder: str
    frames: tuple[int, int] | None = None
    part: tuple[float, float] = (0.0, 1.0)
    share: float = 1.0
    fixed_camera: bool = False
    least_visible: float = 0.25
    generate: int = 0
    scene: Literal["street", "varied", "sparse", "aerial", "near", "overhead", "drone", "ceiling"] = "street"
    sprites: str = ""
    photographs: str = ""
    town: bool = False
    things: bool = False
    sun: float = 0.0
    boxes: BoxConvention = "silhouettes"
    seed: int = 0
    size: tuple[int, int] | None = None


@dataclass(frozen=True)
class FixedView:
    """What a fixed camera's sequence gives for composing.

    Attributes:
        background: the scene without people; ignored boxes where there always are some.
        cutouts: for each frame and box the person cut out, or None.
        sizes: how tall people are by row.
    """

    background: Example
    cutouts: list[list[Cutout | None]]
    sizes: SizeByRow

    def people(self) -> list[Cutout]:
        """All the people that could be cut out."""
        return [person for frame in self.cutouts for person in frame if person is not None]


class Footage:
    """The labelled images of one source.

    Raises:
        RequestError: the source has no usable labelled image, or an image cannot be read.
    """

    def __init__(self, source: TrainingSource) -> None:
        self.source = source
        self.labels = labelled_images(source.folder, source.frames, source.part)
        first = read_image(self.labels[0].path)
        self._decoded: list[ImageArray] | None = None
        if first.nbytes * len(self.labels) <= _MEMORY:
            self._decoded = [read_image(label.path) for label in self.labels]
        self.views: list[FixedView] = []
        self._place: list[tuple[int, int]] = []
        if source.fixed_camera:
            self._study_views()

    def __len__(self) -> int:
        return len(self.labels)

    def example(self, index: int) -> Example:
        """The labelled image at ``index``."""
        label = self.labels[index]
        image = read_image(label.path) if self._decoded is None else self._decoded[index]
        return Example(image, label.boxes, label.ignored | (label.visibility < self.source.least_visible))

    def view(self, index: int) -> FixedView | None:
        """The fixed view that image ``index`` belongs to, if the source says that the camera stands still."""
        return self.views[self._place[index][0]] if self.views else None

    def cutouts(self, index: int) -> list[Cutout | None]:
        """The people cut out of image ``index``, one entry a box."""
        view, frame = self._place[index]
        return self.views[view].cutouts[frame]

    def _study_views(self) -> None:
        names = [label.sequence for label in self.labels]
        for number, name in enumerate(dict.fromkeys(names)):
            members = [i for i, other in enumerate(names) if other == name]
            examples = [self.example(i) for i in members]
            background = empty_view(examples)
            boxes = np.concatenate([e.boxes[~e.ignored] for e in examples])
            cutouts = [cut_out_people(e, background.image) for e in examples]
            self.views.append(FixedView(background, cutouts, fit_size_by_row(boxes)))
            self._place += [(number, frame) for frame in range(len(members))]
