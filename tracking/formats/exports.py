"""The files of other programs that tracks go into, by name; those with ``read`` are read again, also as labels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.body_points import write_deeplabcut
from tsuiseki.tracking.formats.coco_video import read_coco, write_coco
from tsuiseki.tracking.formats.cvat import read_cvat, write_cvat
from tsuiseki.tracking.formats.geff import write_geff
from tsuiseki.tracking.formats.kitti import write_kitti
from tsuiseki.tracking.formats.label_studio import read_label_studio, write_label_studio
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.formats.mot_sequence import write_sequence
from tsuiseki.tracking.formats.sleap_hdf5 import write_sleap_analysis, write_sleap_project
from tsuiseki.tracking.formats.tracked_video import TrackedVideo
from tsuiseki.tracking.formats.via_tracks import write_via_tracks
from tsuiseki.tracking.formats.yolo import is_yolo, read_yolo, write_yolo

FOLDER = ""


@dataclass(frozen=True)
class ExportFormat:
    """A kind of file.

    Attributes:
        suffix: of its name; `FOLDER` for a folder.
        write: into a path that does not exist.
        read: what was written; None where nothing reads it.
    """

    suffix: str
    write: Callable[[Path, TrackedVideo], object]
    read: Callable[[Path], TrackedVideo] | None = None


FORMATS = {
    "coco": ExportFormat(".json", write_coco, read_coco),
    "cvat": ExportFormat(".xml", write_cvat, read_cvat),
    "label-studio": ExportFormat(".json", write_label_studio, read_label_studio),
    "yolo": ExportFormat(FOLDER, write_yolo, read_yolo),
    "mot": ExportFormat(".txt", lambda path, video: write_tracks(path, video.tracks)),
    "dancetrack": ExportFormat(FOLDER, write_sequence),
    "kitti": ExportFormat(".txt", write_kitti),
    "sleap": ExportFormat(".slp", write_sleap_project),
    "sleap-analysis": ExportFormat(
        ".h5", lambda path, video: write_sleap_analysis(path, video.nodes, video.frame_count)
    ),
    "deeplabcut": ExportFormat(".csv", lambda path, video: write_deeplabcut(path, video.nodes, video.frame_count)),
    "via": ExportFormat(".csv", write_via_tracks),
    "geff": ExportFormat(FOLDER, write_geff),
}


def format_named(name: str) -> ExportFormat:
    """The format of a name.

    Raises:
        RequestError: there is none.
    """
    if name not in FORMATS:
        raise RequestError(f"`to`: expected one of {', '.join(FORMATS)}, got {name}")
    return FORMATS[name]


def format_at(path: Path) -> str | None:
    """The name of the format that can be read at a path, by its suffix and first letter; None where there is none."""
    if path.is_dir():
        return "yolo" if is_yolo(path) else None
    suffix = path.suffix.lower()
    if suffix != ".json" or not path.is_file():
        return "cvat" if suffix == ".xml" else None
    with path.open("rb") as file:
        start = file.read(64).lstrip(b"\xef\xbb\xbf \t\r\n")
    return "label-studio" if start.startswith(b"[") else "coco"


def exported_in(folder: Path) -> list[Path]:
    """What can be read in a folder, or else in those in it: ``annotations.xml`` or ``.json``, or the folder itself."""
    for places in ([folder], sorted(path for path in folder.iterdir() if path.is_dir())):
        wanted = [at for place in places for at in (place, place / "annotations.xml", place / "annotations.json")]
        if found := [at for at in wanted if at.exists() and format_at(at)]:
            return found
    return []


def read_exported(path: Path) -> TrackedVideo:
    """What is at a path of `format_at`.

    Raises:
        RequestError: it is broken, or of another kind.
    """
    name = format_at(path)
    read = FORMATS[name].read if name else None
    if read is None:
        raise RequestError(f"expected a file of {', '.join(n for n, one in FORMATS.items() if one.read)}, got {path}")
    return read(path)
