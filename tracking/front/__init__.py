"""Track people and objects in video: the names that a user needs, each loaded when it is first used.

    import tsuiseki

    tracker = tsuiseki.Sort()
    people = tracker.update(detections)

`docs/how-to/python.md` shows them all at work. What is not named here is internal and may change.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tsuiseki.tracking.animals.linking import AnimalSettings
    from tsuiseki.tracking.animals.tracking import SkeletonSettings, track_animals
    from tsuiseki.tracking.bodies.tracker import DeformableSettings
    from tsuiseki.tracking.bodies.tracking import follow_deformable, track_deformable
    from tsuiseki.tracking.drone.settings import DroneSettings
    from tsuiseki.tracking.drone.tracking import track_drone
    from tsuiseki.tracking.errors import RequestError, RunError
    from tsuiseki.tracking.evaluation.calls import evaluate_people, evaluate_points, evaluate_target
    from tsuiseki.tracking.features.exported import Appearance, Detector
    from tsuiseki.tracking.formats.mot import read_tracks, write_tracks
    from tsuiseki.tracking.interchange import as_detections
    from tsuiseki.tracking.people.bytetrack import ByteTrack, ByteTrackSettings
    from tsuiseki.tracking.people.deepsort import DeepSort, DeepSortSettings
    from tsuiseki.tracking.people.flow import FlowTracker
    from tsuiseki.tracking.people.flow_input import FlowSettings
    from tsuiseki.tracking.people.ocsort import OcSort, OcSortSettings
    from tsuiseki.tracking.people.sort import Sort, SortSettings
    from tsuiseki.tracking.people.tracking import follow_people, track_people
    from tsuiseki.tracking.points.blob_tracker import BlobSettings
    from tsuiseki.tracking.points.measurement_tracking import follow_measurements, track_measurements
    from tsuiseki.tracking.points.tracker import PointSettings, PointTracker
    from tsuiseki.tracking.points.tracking import follow_blobs, follow_points, track_blobs, track_points
    from tsuiseki.tracking.single.run import follow
    from tsuiseki.tracking.sphere.points import track_sphere_points
    from tsuiseki.tracking.sphere.settings import SphereSettings
    from tsuiseki.tracking.sphere.tracking import follow_sphere, track_sphere
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
    "animals.tracking": "SkeletonSettings track_animals",
    "points.tracking": "follow_blobs follow_points track_blobs track_points",
    "bodies.tracking": "follow_deformable track_deformable",
    "drone.tracking": "track_drone",
    "evaluation.calls": "evaluate_people evaluate_points evaluate_target",
    "points.measurement_tracking": "follow_measurements track_measurements",
    "people.tracking": "follow_people track_people",
    "single.run": "follow",
    "sphere.tracking": "follow_sphere track_sphere",
    "sphere.points": "track_sphere_points",
    "sphere.settings": "SphereSettings",
    "animals.linking": "AnimalSettings",
    "points.blob_tracker": "BlobSettings",
    "people.bytetrack": "ByteTrack ByteTrackSettings",
    "people.deepsort": "DeepSort DeepSortSettings",
    "bodies.tracker": "DeformableSettings",
    "drone.tracker": "DroneSettings",
    "people.flow": "FlowSettings FlowTracker",
    "people.ocsort": "OcSort OcSortSettings",
    "points.tracker": "PointSettings PointTracker",
    "people.sort": "Sort SortSettings",
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
        from tsuiseki.tracking.errors import explained

        known = explained(error)
        if known is None:
            raise
        raise known from error


def __dir__() -> list[str]:
    return list(__all__)
