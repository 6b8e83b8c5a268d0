"""Who entered and left a zone, when; however narrow the zone is and however long the steps are.

The band about the border is the same as about a line. Where a zone is narrower than its two bands, nobody could be
inside beyond them: there, a quarter of its width is enough. Between two frames a way leads straight on. Who came in and
went out has been halfway between these two places, even where no frame shows them inside.
"""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.counts.crossings import Crossings, changes
from tsuiseki.tracking.counts.paths import Paths
from tsuiseki.tracking.counts.polygons import border_meetings, distance_to_border, inside, width_across
from tsuiseki.tracking.counts.scene import SceneZone
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# Share of the width of a narrow zone beyond which somebody is inside: half of the way to its middle.
NARROW = 0.25


def border_crossings(paths: Paths, zone: SceneZone, band: float) -> Crossings:
    """Who entered and left a zone; ``band`` is in heights of the person, to each side of the border.

    Who passes through between two frames enters and leaves at the same row.
    """
    distances, width = zone_distances(paths.points, zone), band * paths.heights
    bands = zone_bands(paths.points, distances, zone, width)
    rows, middles = _passages(paths, zone, width)
    if not len(rows):
        return changes(distances, bands, paths.starts)
    distances = np.insert(distances, rows, zone_distances(middles, zone))
    # There, they are beyond the band.
    bands = np.insert(bands, rows, 0.0)
    origins = np.insert(np.arange(len(paths)), rows, rows)
    crossed = changes(distances, bands, paths.starts + np.searchsorted(rows, paths.starts, "right"))
    return Crossings(
        origins[crossed.rows], crossed.sides, origins[crossed.settled_before], origins[crossed.settled_after]
    )


def zone_distances(points: FloatArray, zone: SceneZone) -> FloatArray:
    """``(N,)`` distance of ``(N, 2)`` points from the border of a zone, above 0 inside."""
    return np.where(inside(points, zone.corners), 1.0, -1.0) * distance_to_border(points, zone.corners)


def zone_bands(points: FloatArray, distances: FloatArray, zone: SceneZone, band: FloatArray) -> FloatArray:
    """``(N,)`` how far from the border people at ``(N, 2)`` points are settled; less where the zone is narrow.

    Args:
        points: in the unit of the scene.
        distances: ``(N,)`` of the points, see `zone_distances`.
        zone: whose border.
        band: ``(N,)`` half the width of the band where the zone is wide.
    """
    bands = band.copy()
    shallow = np.flatnonzero((distances > 0) & (distances <= band))
    width = width_across(points[shallow], zone.corners)
    bands[shallow] = np.where(width < 2 * band[shallow], NARROW * width, band[shallow])
    return bands


def was_inside(entries: FloatArray, exits: FloatArray, zone: SceneZone, band: FloatArray) -> BoolArray:
    """``(V,)`` which visits of a zone led beyond the band, halfway between where they came in and went out.

    Args:
        entries: ``(V, 2)`` where each visit came in.
        exits: ``(V, 2)`` where it went out.
        zone: which was visited.
        band: ``(V,)`` half the width of the band where the zone is wide.
    """
    middles = 0.5 * (entries + exits)
    distances = zone_distances(middles, zone)
    return np.asarray(distances > zone_bands(middles, distances, zone, band))


def _passages(paths: Paths, zone: SceneZone, band: FloatArray) -> tuple[IntArray, FloatArray]:
    """The rows ``(V,)`` before which people have been inside beyond the band, and where ``(V, 2)``."""
    steps = np.setdiff1d(np.arange(len(paths)), paths.starts)
    way, share, inward = border_meetings(paths.points[steps - 1], paths.points[steps], zone.corners)
    rows = steps[way]
    places = paths.points[rows - 1] + share[:, None] * (paths.points[rows] - paths.points[rows - 1])
    first = paths.first_rows[rows]
    come = np.flatnonzero(inward[:-1] & ~inward[1:] & (first[1:] == first[:-1]))
    go = come + 1
    deep = was_inside(places[come], places[go], zone, band[rows[go]])
    return rows[go][deep], 0.5 * (places[come] + places[go])[deep]
