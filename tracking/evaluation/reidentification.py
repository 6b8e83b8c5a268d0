"""How well an appearance network finds people again: ranks, mean average precision, area under the ROC.

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
from tsuiseki.tracking.features.exported import Describe
from tsuiseki.tracking.formats.labelled import open_labelled
from tsuiseki.tracking.formats.person_crops import GALLERY, QUERY, is_market, read_market
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray
from tsuiseki.tracking.video.image_folder import read_image


@dataclass(frozen=True)
class Retrieval:
    """Scores of a retrieval, each in [0, 1].

    Attributes:
        rank1: share of the queries whose closest gallery entry is the same person.
        rank5: share of those of which one of the five closest is.
        rank10: likewise, of ten.
        mean_average_precision: mean over the queries of the area under their precision-recall steps.
        queries: number of queries that have an answer in the gallery; the others do not count.
    """

    rank1: float
    rank5: float
    rank10: float
    mean_average_precision: float
    queries: int


def evaluate_retrieval(
    distances: FloatArray, query_ids: IntArray, gallery_ids: IntArray, junk: BoolArray | None = None
) -> Retrieval:
    """Rank-1 and mean average precision of a query set against a gallery, as Market-1501 defines them.

    Equal distances count against the query: a wrong entry comes before a right one.

    Args:
        distances: ``(Q, G)`` smaller is more alike.
        query_ids: ``(Q,)`` identities.
        gallery_ids: ``(G,)`` identities.
        junk: ``(Q, G)`` gallery entries that are neither right nor wrong for a query, such as views a moment apart.

    Raises:
        ValueError: no query has an answer in the gallery.
    """
    junk = np.zeros(distances.shape, dtype=np.bool_) if junk is None else junk
    right = (query_ids[:, None] == gallery_ids[None, :]) & ~junk
    answered = right.any(axis=1)
    if not answered.any():
        raise ValueError("expected queries with the same person in the gallery, found none")
    right, junk, distances = right[answered], junk[answered], distances[answered]
    # Junk sinks to the end, where it takes no rank from anything that counts.
    order = np.lexsort([right, np.where(junk, np.inf, distances)], axis=1)
    hits = np.take_along_axis(right, order, axis=1)
    precision = np.cumsum(hits, axis=1) / np.arange(1, hits.shape[1] + 1)
    average = (precision * hits).sum(axis=1) / hits.sum(axis=1)
    ranks = [float(hits[:, :k].any(axis=1).mean()) for k in (1, 5, 10)]
    return Retrieval(ranks[0], ranks[1], ranks[2], float(average.mean()), int(answered.sum()))


def area_under_roc(positive: FloatArray, negative: FloatArray) -> float:
    """Probability that a random positive scores higher than a random negative, ties counted half.

    >>> area_under_roc(np.array([0.9, 0.5]), np.array([0.5, 0.1]))
    0.875

    Args:
        positive: ``(P,)`` scores of pairs that are the same.
        negative: ``(N,)`` scores of pairs that are not.

    Raises:
        ValueError: one of them is empty.
    """
    if len(positive) == 0 or len(negative) == 0:
        raise ValueError(f"expected positives and negatives, got {len(positive)} and {len(negative)}")
    ordered = np.sort(negative)
    below = np.searchsorted(ordered, positive, side="left") + np.searchsorted(ordered, positive, side="right")
    return float(below.mean() / (2 * len(negative)))


# Frames from one view of a person to the next.
APART = 25


@dataclass(frozen=True)
class Views:
    """Pictures of people.

    Attributes:
        pictures: a path, and ``(K, 4)`` boxes in it; None takes the whole picture.
        ids: ``(N,)`` person of each view, in the order of the pictures and boxes.
        cameras: ``(N,)``; -1 where a video was cut up, in which no view is left out.
        query: ``(N,)`` views that are searched among the others.
    """

    pictures: Sequence[tuple[Path, FloatArray | None]]
    ids: IntArray
    cameras: IntArray
    query: BoolArray


def read_views(folder: Path) -> Views:
    """The views in a folder of Market-1501, or of labelled video with pictures.

    Raises:
        RequestError: there are no labels, no pictures, or fewer than two people with two crops.
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
        frame = np.array([[0.0, 0.0, image.shape[1], image.shape[0]]])
        rows.append(describe.describe(image, frame if boxes is None else boxes))
    features, query = np.concatenate(rows).astype(np.float64), views.query
    distances = 1 - features[query] @ features[~query].T
    same = views.ids[query][:, None] == views.ids[~query]
    same_camera = (views.cameras[query][:, None] == views.cameras[~query]) & (views.cameras[query] >= 0)[:, None]
    junk = (same & same_camera) | (views.ids[~query] == -1)
    return evaluate_retrieval(distances, views.ids[query], views.ids[~query], junk)


def _market(folder: Path) -> Views:
    query, gallery = read_market(folder, QUERY), read_market(folder, GALLERY)
    crops = [*query, *gallery]
    pictures = [(crop.path, None) for crop in crops]
    ids, cameras = (np.array([getattr(crop, name) for crop in crops]) for name in ("person", "camera"))
    return Views(pictures, ids, cameras, np.arange(len(crops)) < len(query))


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
        queried = np.zeros(len(names), np.bool_)
        order = np.argsort(truth.frames, kind="stable")
        cuts = np.searchsorted(truth.frames[order], np.arange(video.length + 1))
        for frame in range(video.length):
            here = order[cuts[frame] : cuts[frame + 1]]
            here = here[frame - last[numbers[here]] >= APART]
            if len(here):
                who = numbers[here]
                pictures.append((video.files[frame], truth.boxes[here]))
                ids.append(people + who)
                query.append(~queried[who])
                last[who], queried[who] = frame, True
        people += len(names)
    number, first = np.concatenate(ids), np.concatenate(query)
    return Views(pictures, number, np.full(len(number), -1), first)
