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
    from tsuiseki.tracking.features.networks import Appearance, Detector
    from tsuiseki.tracking.interchange import as_detections
    from tsuiseki.tracking.pipelines.people import follow_people, track_people
    from tsuiseki.tracking.trackers.bytetrack import ByteTrack, ByteTrackSettings
    from tsuiseki.tracking.trackers.deepsort import DeepSort, DeepSortSettings
    from tsuiseki.tracking.trackers.flow import FlowSettings, FlowTracker
    from tsuiseki.tracking.trackers.ocsort import OcSort, OcSortSettings
    from tsuiseki.tracking.trackers.sort import Sort, SortSettings
    from tsuiseki.tracking.types import Detections, Estimate, Frame, Target, Targets, Track
    from tsuiseki.tracking.weights import shipped

    __version__: str

# Where each name comes from.
_MODULES = {
    "errors": "RequestError RunError",
    "features.networks": "Appearance Detector",
    "interchange": "as_detections",
    "pipelines.people": "follow_people track_people",
    "trackers.bytetrack": "ByteTrack ByteTrackSettings",
    "trackers.deepsort": "DeepSort DeepSortSettings",
    "trackers.flow": "FlowSettings FlowTracker",
    "trackers.ocsort": "OcSort OcSortSettings",
    "trackers.sort": "Sort SortSettings",
    "types": "Detections Estimate Frame Target Targets Track",
    "weights": "shipped",
}
_HOMES = {name: f"tsuiseki.tracking.{module}" for module, names in _MODULES.items() for name in names.split()}

__all__ = [
    "Appearance",
    "ByteTrack",
    "ByteTrackSettings",
    "DeepSort",
    "DeepSortSettings",
    "Detections",
    "Detector",
    "Estimate",
    "FlowSettings",
    "FlowTracker",
    "Frame",
    "OcSort",
    "OcSortSettings",
    "RequestError",
    "RunError",
    "Sort",
    "SortSettings",
    "Target",
    "Targets",
    "Track",
    "__version__",
    "as_detections",
    "follow_people",
    "shipped",
    "track_people",
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
