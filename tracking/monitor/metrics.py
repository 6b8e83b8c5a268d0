"""Numbers of a run for Prometheus: its text format 0.0.4, with the usual names for what every process has."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from tsuiseki.tracking.monitor.board import Board

METRICS_TYPE = "text/plain; version=0.0.4; charset=utf-8"
# By field of a camera: the name of the metric, its type, and what it is.
CAMERA_METRICS = {
    "frames": ("tsuiseki_frames_total", "counter", "Frames that were used."),
    "dropped": ("tsuiseki_frames_dropped_total", "counter", "Frames that came while others were worked on."),
    "outages": ("tsuiseki_outages_total", "counter", "How often the camera was away."),
    "away_seconds": (
        "tsuiseki_outage_seconds_total",
        "counter",
        "Seconds without a picture, of past outages.",
    ),
    "rate": ("tsuiseki_frame_rate", "gauge", "Frames a second, lately."),
    "delay": ("tsuiseki_delay_seconds", "gauge", "From the frame to when its people are certain."),
    "people": ("tsuiseki_people", "gauge", "People in the newest frame."),
}


def metrics_text(board: Board) -> str:
    """All numbers of a run as text."""
    health = board.health()
    cameras = health["cameras"]
    lines = list[str]()
    for name, (metric, kind, text) in CAMERA_METRICS.items():
        lines += _family(metric, kind, text, ((c["name"], c[name]) for c in cameras))
    up = ((camera["name"], int(not camera["away"])) for camera in cameras)
    lines += _family("tsuiseki_camera_up", "gauge", "Whether the camera gives pictures.", up)
    for metric, kind, text, value in (
        ("tsuiseki_events_waiting", "gauge", "Events that were not received yet.", health["events_waiting"]),
        ("process_resident_memory_bytes", "gauge", "Resident memory size in bytes.", health["memory"]),
        ("process_start_time_seconds", "gauge", "Start time since unix epoch in seconds.", round(board.started, 2)),
    ):
        lines += [f"# HELP {metric} {text}", f"# TYPE {metric} {kind}", f"{metric} {value}"]
    return "\n".join(lines) + "\n"


def _family(metric: str, kind: str, text: str, values: Iterable[tuple[str, Any]]) -> list[str]:
    rows = [f'{metric}{{camera="{_escaped(name)}"}} {value}' for name, value in values if value is not None]
    return [f"# HELP {metric} {text}", f"# TYPE {metric} {kind}", *rows] if rows else []


def _escaped(label: str) -> str:
    return label.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
