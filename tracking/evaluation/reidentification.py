"""How well an appearance network finds people again: in labelled video, or in Market-1501's query and gallery.

In video, views of a person are taken `APART` frames apart. The first of each person is a query; the others, of all
people and videos, are the gallery. In Market-1501 views of the query's own camera are left out, as its authors do, and
so are those of the id -1; those of the id 0 are wrong answers to every query.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.retrieval import Retrieval, evaluate_retrieval
from tsuiseki.tracking.features.exported import Describe
from tsuiseki.tracking.formats.labelled import open_labelled
from tsuiseki.tracking.formats.market import GALLERY, QUERY, is_market, read_market
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray
from tsuiseki.tracking.video.image_folder import read_image

APART = 25


@dataclass(frozen=True)
class Views:
    """Pictures of people.

    Attributes:
        pictures: a path, and ``(K, 4)`` boxes in it; None takes the whole picture.
        ids: ``(N,)`` person of each view, in the order of the pictures and boxes.
        cameras: ``(N,)``; -1 where a video was cut up, in which no view is left out.
        query: ``(N,)`` views that are looked for among the others.
    """

    pictures: Sequence[tuple[Path, FloatArray | None]]
    ids: IntArray
    cameras: IntArray
    query: BoolArray


def read_views(folder: Path) -> Views:
    """The views in a folder of Market-1501, or of labelled video with pictures.

    Raises:
        RequestError: there are no labels, no pictures, or fewer than two people seen twice.
    """
    views = _market(folder) if is_market(folder) else _videos(folder)
    if len(np.intersect1d(views.ids[views.query], views.ids[~views.query])) < 2:
        raise RequestError(f"{folder}: expected two people or more with a query and another view, got fewer")
    return views


def score_views(views: Views, describe: Describe) -> Retrieval:
    """Rank-1, -5 and -10 and mean average precision of a network."""
    rows = []
    for path, boxes in views.pictures:
        image = read_image(path)
        whole = np.array([[0.0, 0.0, image.shape[1], image.shape[0]]])
        rows.append(describe.describe(image, whole if boxes is None else boxes))
    features, query = np.concatenate(rows).astype(np.float64), views.query
    distances = 1 - features[query] @ features[~query].T
    same = views.ids[query][:, None] == views.ids[~query]
    seen = (views.cameras[query][:, None] == views.cameras[~query]) & (views.cameras[query] >= 0)[:, None]
    junk = (same & seen) | (views.ids[~query] == -1)
    return evaluate_retrieval(distances, views.ids[query], views.ids[~query], junk)


def _market(folder: Path) -> Views:
    query, gallery = read_market(folder, QUERY), read_market(folder, GALLERY)
    every = [*query, *gallery]
    pictures = [(crop.path, None) for crop in every]
    ids, cameras = (np.array([getattr(crop, name) for crop in every]) for name in ("person", "camera"))
    return Views(pictures, ids, cameras, np.arange(len(every)) < len(query))


def _videos(folder: Path) -> Views:
    pictures: list[tuple[Path, FloatArray | None]] = []
    ids, query = [np.empty(0, np.int64)], [np.empty(0, np.bool_)]
    people = 0
    for video in open_labelled(folder):
        truth = video.people()
        truth = truth.select(truth.evaluated)
        if video.length is None or len(video.files) != video.length:
            raise RequestError(f"{video.name}: expected pictures, such as img1/, found none")
        names, numbers = np.unique(truth.ids, return_inverse=True)
        last = np.full(len(names), -APART)
        seen = np.zeros(len(names), np.bool_)
        order = np.argsort(truth.frames, kind="stable")
        cuts = np.searchsorted(truth.frames[order], np.arange(video.length + 1))
        for frame in range(video.length):
            here = order[cuts[frame] : cuts[frame + 1]]
            here = here[frame - last[numbers[here]] >= APART]
            if len(here):
                who = numbers[here]
                pictures.append((video.files[frame], truth.boxes[here]))
                ids.append(people + who)
                query.append(~seen[who])
                last[who], seen[who] = frame, True
        people += len(names)
    number, first = np.concatenate(ids), np.concatenate(query)
    return Views(pictures, number, np.full(len(number), -1), first)
