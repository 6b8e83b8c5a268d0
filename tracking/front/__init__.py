"""Track people and objects in video: the names that a user needs, each loaded when it is first used.

    import tsuiseki

    tracker = tsuiseki.Sort()
    people = tracker.update(detections)

`docs/python.md` shows them all at work. What is not named here is internal and may change.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tsuiseki.tracking.errors import RequestError, RunError
    from tsuiseki.tracking.features.networks.exported import Appearance, Detector
    from tsuiseki.tracking.formats.mot import read_tracks, write_tracks
    from tsuiseki.tracking.interchange import as_detections
    from tsuiseki.tracking.pipelines.bodies.animals import SkeletonSettings, track_animals
    from tsuiseki.tracking.pipelines.bodies.deformable import follow_deformable, track_deformable
    from tsuiseki.tracking.pipelines.drone.tracking import track_drone
    from tsuiseki.tracking.pipelines.evaluation import evaluate_people, evaluate_points, evaluate_target
    from tsuiseki.tracking.pipelines.people.tracking import follow_people, track_people
    from tsuiseki.tracking.pipelines.points.blobs import follow_blobs, follow_points, track_blobs, track_points
    from tsuiseki.tracking.pipelines.points.measurements import follow_measurements, track_measurements
    from tsuiseki.tracking.pipelines.single.tracking import follow
    from tsuiseki.tracking.pipelines.sphere.points import track_sphere_points
    from tsuiseki.tracking.pipelines.sphere.settings import SphereSettings
    from tsuiseki.tracking.pipelines.sphere.tracking import follow_sphere, track_sphere
    from tsuiseki.tracking.trackers.animals.linking import AnimalSettings
    from tsuiseki.tracking.trackers.blobs import BlobSettings
    from tsuiseki.tracking.trackers.deformable import DeformableSettings
    from tsuiseki.tracking.trackers.drone import DroneSettings
    from tsuiseki.tracking.trackers.people.bytetrack import ByteTrack, ByteTrackSettings
    from tsuiseki.tracking.trackers.people.deepsort import DeepSort, DeepSortSettings
    from tsuiseki.tracking.trackers.people.flow import FlowSettings, FlowTracker
    from tsuiseki.tracking.trackers.people.ocsort import OcSort, OcSortSettings
    from tsuiseki.tracking.trackers.people.sort import Sort, SortSettings
    from tsuiseki.tracking.trackers.points import PointSettings, PointTracker
    from tsuiseki.tracking.types import Detections, Estimate, Frame, Position, Target, Targets, Track
    from tsuiseki.tracking.types.labels import GroundTruth
    from tsuiseki.tracking.types.measurements import Scan, SensedTargets, SensedTrack, SensingModel
    from tsuiseki.tracking.types.tracks import ActingTrack, BodyTrack
    from tsuiseki.tracking.weights import shipped

    __version__: str

# Where each name comes from.
_MODULES = {
    "errors": "RequestError RunError",
    "features.networks.exported": "Appearance Detector",
    "formats.mot": "read_tracks write_tracks",
    "interchange": "as_detections",
    "pipelines.bodies.animals": "SkeletonSettings track_animals",
    "pipelines.points.blobs": "follow_blobs follow_points track_blobs track_points",
    "pipelines.bodies.deformable": "follow_deformable track_deformable",
    "pipelines.drone.tracking": "track_drone",
    "pipelines.evaluation": "evaluate_people evaluate_points evaluate_target",
    "pipelines.points.measurements": "follow_measurements track_measurements",
    "pipelines.people.tracking": "follow_people track_people",
    "pipelines.single.tracking": "follow",
    "pipelines.sphere.tracking": "follow_sphere track_sphere",
    "pipelines.sphere.points": "track_sphere_points",
    "pipelines.sphere.settings": "SphereSettings",
    "trackers.animals.linking": "AnimalSettings",
    "trackers.blobs": "BlobSettings",
    "trackers.people.bytetrack": "ByteTrack ByteTrackSettings",
    "trackers.people.deepsort": "DeepSort DeepSortSettings",
    "trackers.deformable": "DeformableSettings",
    "trackers.drone": "DroneSettings",
    "trackers.people.flow": "FlowSettings FlowTracker",
    "trackers.people.ocsort": "OcSort OcSortSettings",
    "trackers.points": "PointSettings PointTracker",
    "trackers.people.sort": "Sort SortSettings",
    "types": "Detections Estimate Frame Position Target Targets Track",
    "types.labels": "GroundTruth",
    "types.measurements": "Scan SensedTargets SensedTrack SensingModel",
    "types.tracks": "ActingTrack BodyTrack",
    "weights": "shipped",
}
_HOMES = {name: f"tsuiseki.tracking.{module}" for module, names in _MODULES.items() for name in names.split()}

__all__ = [
    "ActingTrack",
    "AnimalSettings",
    "Appearance",
    "BlobSettings",
    "BodyTrack",
    "ByteTrack",
    "ByteTrackSettings",
    "DeepSort",
    "DeepSortSettings",
    "DeformableSettings",
    "Detections",
    "Detector",
    "DroneSettings",
    "Estimate",
    "FlowSettings",
    "FlowTracker",
    "Frame",
    "GroundTruth",
    "OcSort",
    "OcSortSettings",
    "PointSettings",
    "PointTracker",
    "Position",
    "RequestError",
    "RunError",
    "Scan",
    "SensedTargets",
    "SensedTrack",
    "SensingModel",
    "SkeletonSettings",
    "Sort",
    "SortSettings",
    "SphereSettings",
    "Target",
    "Targets",
    "Track",
    "__version__",
    "as_detections",
    "evaluate_people",
    "evaluate_points",
    "evaluate_target",
    "follow",
    "follow_blobs",
    "follow_deformable",
    "follow_measurements",
    "follow_people",
    "follow_points",
    "follow_sphere",
    "read_tracks",
    "shipped",
    "track_animals",
    "track_blobs",
    "track_deformable",
    "track_drone",
    "track_measurements",
    "track_people",
    "track_points",
    "track_sphere",
    "track_sphere_points",
    "write_tracks",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib import metadata

        value: Any = metadata.version("tsuiseki")
    elif name in _HOMES:
        value = getattr(_imported(_HOMES[name]), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def _imported(module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        from tsuiseki.tracking.opencv import explained

        known = explained(error)
        if known is None:
            raise
        raise known from error


def __dir__() -> list[str]:
    return list(__all__)
