"""What tells people apart in a round: the appearance network and the prices of links, each kept only where it helps.

Both are learnt on the tracks of the round, without its held-out end, and tried there against what the tracks were made
with. Appearance is better where it separates people more; costs where identities survive missing frames better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tsuiseki.tracking.association.affinity import Affinity
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.adapt.examples import between, first_held_out, joined, named
from tsuiseki.trainers.adapt.find import Found, Models, track
from tsuiseki.trainers.adapt.foreground import Foreground
from tsuiseki.trainers.adapt.labels import Labels, label, rejected_detections
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
    """How what tells people apart does in the held-out ends, before and after learning; None where nobody can say.

    Attributes:
        separation: area under the ROC of appearance: one track against people seen at one time.
        separation_learnt: likewise, of the network that was learnt.
        identity: IDF1 of tracks with every other frame missing against those of all frames.
        identity_learnt: likewise, with the costs that were learnt.
    """

    separation: float | None = None
    separation_learnt: float | None = None
    identity: float | None = None
    identity_learnt: float | None = None

    @property
    def better_appearance(self) -> bool:
        """Whether the learnt network is taken."""
        return _rises(self.separation, self.separation_learnt)

    @property
    def better_costs(self) -> bool:
        """Whether the learnt costs are taken."""
        return _rises(self.identity, self.identity_learnt)


def seen_in(watched: Watched, foreground: Foreground | None, found: Found, settings: AdaptSettings) -> Seen:
    """Labels of what was found in a video."""
    rejected = rejected_detections(watched, found.detections, found.tracks, found.first)
    return Seen(watched, foreground, found, label(watched, foreground, found.tracks, rejected, settings.labels))


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
    projection, separations = _appearance(now, settings, seed)
    scores = LinkScores(*separations)
    if projection is not None and scores.better_appearance:
        export_projected(models.appearance or shipped("appearance_people"), projection, folder / APPEARANCE)
        models = replace(models, appearance=folder / APPEARANCE)
        now = [_again(each, replace(each.found, detections=_moved(each.found, projection)), settings) for each in now]
    costs, identities = _costs(now, folder, settings, seed)
    scores = LinkScores(*separations, *identities)
    if costs is not None and scores.better_costs:
        models = replace(models, affinity=costs)
        learnt = Affinity(costs, 1)
        now = [_again(each, replace(each.found, costs=learnt), settings) for each in now]
    return now, models, scores


def _appearance(
    seen: Sequence[Seen], settings: AdaptSettings, seed: int
) -> tuple[Projection | None, tuple[float | None, float | None]]:
    """The last layer, and how people separate without and with it where nothing was learnt."""
    learnt, held_out = _examples(seen, settings)
    projection = learn_projection(joined(learnt), ProjectionSettings(), seed)
    unseen = joined(held_out)
    return projection, (separation(unseen), None if projection is None else separation(unseen, projection))


def _costs(
    seen: Sequence[Seen], folder: Path, settings: AdaptSettings, seed: int
) -> tuple[Path | None, tuple[float | None, float | None]]:
    """The file of costs, and how identities are kept without and with it where nothing was learnt."""
    learnt, _ = _examples(seen, settings)
    sources = [Path(each.watched.source) for each in seen]
    costs = fit_costs(learnt, sources, folder / COSTS, seed)
    stretches = [
        Stretch(each.watched, each.found, each.labels, first_held_out(each.watched, each.found, settings.held_out))
        for each in seen
    ]
    if costs is None:
        return None, (None, None)
    tried = Affinity(costs, 1)
    before, after = (
        identity_kept(stretches, settings.score_threshold, which, tried.observation) for which in (None, tried)
    )
    return costs, (before, after)


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


def _rises(before: float | None, after: float | None) -> bool:
    return before is not None and after is not None and after > before + _BETTER
