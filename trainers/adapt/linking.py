"""What tells people apart in a round: the appearance network and the prices of links, each kept only where it helps.

Both are learnt on the tracks of the round, without its held-out end, and tried there against what the tracks were made
with. Costs are better where identities survive missing frames better, there and in the whole video: few people in a few
seconds may tell anything. Appearance is where they survive gaps better, in the whole video, and it separates people
more: where motion tells who is who, a network that only does the latter harms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path

from tsuiseki.tracking.association.learnt_costs import Affinity
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.adapt.examples import between, first_held_out, joined, named
from tsuiseki.trainers.adapt.find import Found, Models, track
from tsuiseki.trainers.adapt.foreground import Foreground
from tsuiseki.trainers.adapt.labels import Labels, label
from tsuiseki.trainers.adapt.learn_appearance import (
    Projection,
    ProjectionSettings,
    export_projected,
    learn_projection,
    separation,
)
from tsuiseki.trainers.adapt.learn_costs import Stretch, fit_costs, identity_kept
from tsuiseki.trainers.adapt.settings import AdaptSettings
from tsuiseki.trainers.adapt.watch import Watched
from tsuiseki.trainers.affinity.affinity_samples import LabelledDetections

APPEARANCE, COSTS = "appearance.onnx", "affinity.onnx"
# What is learnt must be better by this much to be taken.
_BETTER = 0.002
# A camera shows few identities: rises of up to 0.03 over gaps, and of 0.005 of costs, did harm later.
_BETTER_OVER_GAPS, _BETTER_COSTS = 0.05, 0.02
# Frames that are missing, after as many that are there, where it is tried how well appearance keeps identities.
_GAP = 12


@dataclass(frozen=True)
class Seen:
    """What a round saw in a video.

    Attributes:
        watched: the video.
        foreground: of its kept pictures; None where the camera moves.
        found: detections and tracks.
        labels: taken of them.
    """

    watched: Watched
    foreground: Foreground | None
    found: Found
    labels: Labels


@dataclass(frozen=True)
class LinkScores:
    """How what tells people apart does, before and after learning; None where nobody can say.

    Attributes:
        separation: area under the ROC of appearance in the held-out ends: one track against people seen at one time.
        separation_learnt: likewise, of the network that was learnt.
        identity: IDF1 of tracks with every other frame missing against those of all frames, in the held-out ends or in
            the whole videos, where it rises less.
        identity_learnt: likewise, with the costs that were learnt.
        followed: IDF1 with every other dozen of frames missing, in the whole videos, with the appearance that the
            tracks were made with.
        followed_learnt: likewise, with the network that was learnt.
    """

    separation: float | None = None
    separation_learnt: float | None = None
    identity: float | None = None
    identity_learnt: float | None = None
    followed: float | None = None
    followed_learnt: float | None = None

    @property
    def better_appearance(self) -> bool:
        """Whether the learnt network is taken."""
        kept = _rises(self.followed, self.followed_learnt, _BETTER_OVER_GAPS)
        return kept and _rises(self.separation, self.separation_learnt)

    @property
    def better_costs(self) -> bool:
        """Whether the learnt costs are taken."""
        return _rises(self.identity, self.identity_learnt, _BETTER_COSTS)


def seen_in(watched: Watched, foreground: Foreground | None, found: Found, settings: AdaptSettings) -> Seen:
    """Labels of what was found in a video."""
    kept = [found.detections[frame - found.first] for frame in watched.frames]
    return Seen(watched, foreground, found, label(watched, foreground, found.tracks, kept, settings.labels))


def learn_links(
    seen: Sequence[Seen], models: Models, folder: Path, settings: AdaptSettings, seed: int
) -> tuple[list[Seen], Models, LinkScores]:
    """Learn both on what was seen, and look at the same detections with whichever is better.

    Args:
        seen: each video, its appearances described by ``models``.
        models: that looked.
        folder: for the files.
        settings: of the adaptation.
        seed: of all chance.

    Returns:
        What is seen then, the models then, and how both did.
    """
    now = list(seen)
    projection, scores = _appearance(now, settings, seed)
    if projection is not None and scores.better_appearance:
        export_projected(models.appearance or shipped("appearance_people"), projection, folder / APPEARANCE)
        models = replace(models, appearance=folder / APPEARANCE)
        now = [_again(each, replace(each.found, detections=_moved(each.found, projection)), settings) for each in now]
    costs, identities = _costs(now, folder, settings, seed)
    scores = replace(scores, identity=identities[0], identity_learnt=identities[1])
    if costs is not None and scores.better_costs:
        models = replace(models, affinity=costs)
        learnt = Affinity(costs, 1)
        now = [_again(each, replace(each.found, costs=learnt), settings) for each in now]
    return now, models, scores


def _appearance(seen: Sequence[Seen], settings: AdaptSettings, seed: int) -> tuple[Projection | None, LinkScores]:
    """The last layer, and how people are told apart without and with it."""
    learnt, held_out = _examples(seen, settings)
    projection = learn_projection(joined(learnt), ProjectionSettings(), seed)
    unseen = joined(held_out)
    if projection is None:
        return None, LinkScores(separation(unseen))
    followed = [
        identity_kept([_whole(each, by) for each in seen], settings.score_threshold, gap=_GAP)
        for by in (None, projection)
    ]
    scores = LinkScores(separation(unseen), separation(unseen, projection))
    return projection, replace(scores, followed=followed[0], followed_learnt=followed[1])


def _whole(seen: Seen, projection: Projection | None) -> Stretch:
    """All of a video, its people described with the last layer."""
    found = seen.found if projection is None else replace(seen.found, detections=_moved(seen.found, projection))
    return Stretch(seen.watched, found, seen.labels, found.first)


def _costs(
    seen: Sequence[Seen], folder: Path, settings: AdaptSettings, seed: int
) -> tuple[Path | None, tuple[float | None, float | None]]:
    """The file of costs, and how identities are kept without and with it where nothing was learnt."""
    learnt, _ = _examples(seen, settings)
    sources = [Path(each.watched.source) for each in seen]
    costs = fit_costs(learnt, sources, folder / COSTS, seed)
    if costs is None:
        return None, (None, None)
    ends = [
        Stretch(each.watched, each.found, each.labels, first_held_out(each.watched, each.found, settings.held_out))
        for each in seen
    ]
    tried = Affinity(costs, 1)
    held_out, whole = (
        (
            identity_kept(stretches, settings.score_threshold, None, tried.observation),
            identity_kept(stretches, settings.score_threshold, tried, tried.observation),
        )
        for stretches in (ends, [_whole(each, None) for each in seen])
    )
    return costs, min(held_out, whole, key=_rise)


def _examples(
    seen: Sequence[Seen], settings: AdaptSettings
) -> tuple[list[LabelledDetections], list[LabelledDetections]]:
    """Named detections of each video: those to learn from, and those of its held-out end."""
    learnt, held_out = [], []
    for each in seen:
        samples, border = named(each.found, each.labels), first_held_out(each.watched, each.found, settings.held_out)
        learnt.append(between(samples, each.found.first, border))
        held_out.append(between(samples, border, each.found.first + each.watched.length))
    return learnt, held_out


def _moved(found: Found, projection: Projection) -> list[Detections]:
    """The detections, described by the network that was learnt."""
    return [d if d.features is None else d.with_features(projection(d.features)) for d in found.detections]


def _again(seen: Seen, found: Found, settings: AdaptSettings) -> Seen:
    """The same video, tracked and labelled once more."""
    tracked = replace(found, tracks=track(seen.watched, found, settings.score_threshold))
    return seen_in(seen.watched, seen.foreground, tracked, settings)


def _rises(before: float | None, after: float | None, least: float = _BETTER) -> bool:
    return before is not None and after is not None and after > before + least


def _rise(scores: tuple[float | None, float | None]) -> float:
    """From before to after; no rise where nobody can say."""
    before, after = scores
    return -inf if before is None or after is None else after - before
