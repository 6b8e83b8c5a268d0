"""Track people and objects in video: the names that a user needs, each loaded when it is first used.

    import tsuiseki

    tracker = tsuiseki.Sort()
    people = tracker.update(detections)

What is not named here is internal and may change.
"""

from __future__ import annotations

import ast
import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

# The one list of public names: type checkers read it as it stands, `_homes` reads where each name comes from.
if TYPE_CHECKING:
    from tsuiseki.tracking.animals.run import track_animals as track_animals
    from tsuiseki.tracking.animals.settings import AnimalSettings as AnimalSettings
    from tsuiseki.tracking.animals.settings import SkeletonSettings as SkeletonSettings
    from tsuiseki.tracking.answers.counting import Answers as Answers
    from tsuiseki.tracking.answers.counting import count as count
    from tsuiseki.tracking.answers.online import Counter as Counter
    from tsuiseki.tracking.answers.scene import Scene as Scene
    from tsuiseki.tracking.answers.scene import read_scene as read_scene
    from tsuiseki.tracking.answers.settings import CountSettings as CountSettings
    from tsuiseki.tracking.batch.run import batch as batch
    from tsuiseki.tracking.bodies.run import follow_deformable as follow_deformable
    from tsuiseki.tracking.bodies.run import track_deformable as track_deformable
    from tsuiseki.tracking.bodies.settings import DeformableSettings as DeformableSettings
    from tsuiseki.tracking.calibrate.people import PeopleCalibration as PeopleCalibration
    from tsuiseki.tracking.calibrate.people import calibrate_people as calibrate_people
    from tsuiseki.tracking.calibrate.people import check_cameras as check_cameras
    from tsuiseki.tracking.drone.run import track_drone as track_drone
    from tsuiseki.tracking.drone.settings import DroneSettings as DroneSettings
    from tsuiseki.tracking.errors import RequestError as RequestError
    from tsuiseki.tracking.errors import RunError as RunError
    from tsuiseki.tracking.evaluation.calls import evaluate_people as evaluate_people
    from tsuiseki.tracking.evaluation.calls import evaluate_points as evaluate_points
    from tsuiseki.tracking.evaluation.calls import evaluate_target as evaluate_target
    from tsuiseki.tracking.features.exported import Appearance as Appearance
    from tsuiseki.tracking.features.exported import Detector as Detector
    from tsuiseki.tracking.features.foreign_options import AppearanceOptions as AppearanceOptions
    from tsuiseki.tracking.features.foreign_options import DetectorOptions as DetectorOptions
    from tsuiseki.tracking.fisheye.run import track_fisheye as track_fisheye
    from tsuiseki.tracking.fisheye.settings import CeilingOptions as CeilingOptions
    from tsuiseki.tracking.floor.run import OneFloorSettings as OneFloorSettings
    from tsuiseki.tracking.floor.run import track_floor as track_floor
    from tsuiseki.tracking.formats.mot import read_tracks as read_tracks
    from tsuiseki.tracking.formats.mot import write_tracks as write_tracks
    from tsuiseki.tracking.interchange import as_detections as as_detections
    from tsuiseki.tracking.linking.run import Linked as Linked
    from tsuiseki.tracking.linking.run import link as link
    from tsuiseki.tracking.people.bytetrack import ByteTrack as ByteTrack
    from tsuiseki.tracking.people.bytetrack import ByteTrackSettings as ByteTrackSettings
    from tsuiseki.tracking.people.flow import FlowTracker as FlowTracker
    from tsuiseki.tracking.people.flow_input import FlowSettings as FlowSettings
    from tsuiseki.tracking.people.hiding import hide as hide
    from tsuiseki.tracking.people.ocsort import OcSort as OcSort
    from tsuiseki.tracking.people.ocsort import OcSortSettings as OcSortSettings
    from tsuiseki.tracking.people.sort import DeepSort as DeepSort
    from tsuiseki.tracking.people.sort import DeepSortSettings as DeepSortSettings
    from tsuiseki.tracking.people.sort import Sort as Sort
    from tsuiseki.tracking.people.sort import SortSettings as SortSettings
    from tsuiseki.tracking.people.tracking import follow_people as follow_people
    from tsuiseki.tracking.people.tracking import track_people as track_people
    from tsuiseki.tracking.points.measured import follow_measurements as follow_measurements
    from tsuiseki.tracking.points.measured import track_measurements as track_measurements
    from tsuiseki.tracking.points.run import follow_blobs as follow_blobs
    from tsuiseki.tracking.points.run import follow_points as follow_points
    from tsuiseki.tracking.points.run import track_blobs as track_blobs
    from tsuiseki.tracking.points.run import track_points as track_points
    from tsuiseki.tracking.points.settings import BlobSettings as BlobSettings
    from tsuiseki.tracking.points.settings import PointSettings as PointSettings
    from tsuiseki.tracking.points.tracker import PointTracker as PointTracker
    from tsuiseki.tracking.result import Result as Result
    from tsuiseki.tracking.result import convert as convert
    from tsuiseki.tracking.single.run import follow_single as follow_single
    from tsuiseki.tracking.single.run import track_single as track_single
    from tsuiseki.tracking.sphere.points import track_sphere_points as track_sphere_points
    from tsuiseki.tracking.sphere.run import follow_sphere as follow_sphere
    from tsuiseki.tracking.sphere.run import track_sphere as track_sphere
    from tsuiseki.tracking.sphere.settings import SphereSettings as SphereSettings
    from tsuiseki.tracking.types import Detections as Detections
    from tsuiseki.tracking.types import Estimate as Estimate
    from tsuiseki.tracking.types import Frame as Frame
    from tsuiseki.tracking.types import Position as Position
    from tsuiseki.tracking.types import Target as Target
    from tsuiseki.tracking.types import Targets as Targets
    from tsuiseki.tracking.types import Track as Track
    from tsuiseki.tracking.types.labels import GroundTruth as GroundTruth
    from tsuiseki.tracking.types.measurements import PersonOnFloor as PersonOnFloor
    from tsuiseki.tracking.types.measurements import Scan as Scan
    from tsuiseki.tracking.types.measurements import SensedTargets as SensedTargets
    from tsuiseki.tracking.types.measurements import SensedTrack as SensedTrack
    from tsuiseki.tracking.types.measurements import SensingModel as SensingModel
    from tsuiseki.tracking.types.tracks import ActingTrack as ActingTrack
    from tsuiseki.tracking.types.tracks import BodyTrack as BodyTrack
    from tsuiseki.tracking.weights import shipped as shipped

    __version__: str


def _homes() -> dict[str, str]:
    """The module of each public name."""
    listed = next(node for node in ast.parse(Path(__file__).read_text("utf-8")).body if isinstance(node, ast.If))
    imports = [node for node in listed.body if isinstance(node, ast.ImportFrom)]
    return {alias.name: str(node.module) for node in imports for alias in node.names}


_HOMES = _homes()
__all__ = sorted([*_HOMES, "__version__"])


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib import metadata

        value: Any = metadata.version("tsuiseki")
    elif name in _HOMES:
        from tsuiseki.tracking.arguments import guarded

        value = guarded(getattr(_imported(_HOMES[name]), name))
        if name.startswith(("track_", "follow_")):  # what they give is guarded, too
            _ = [globals().get(given) or __getattr__(given) for given in ("Result", "Frame")]
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
