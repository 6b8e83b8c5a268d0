"""`tsuiseki convert`: a result into the file of another program."""

from __future__ import annotations

from pathlib import Path


def convert(result: Path, *, to: str, out: Path, video: str | None = None, overwrite: bool = False) -> None:
    """Write a result into the file of another program.

    Formats: csv, json, parquet, mot, dancetrack, kitti, coco, cvat, label-studio, yolo, sleap, sleap-analysis,
    deeplabcut, via, geff. KITTI, CVAT, COCO, Label Studio and YOLO are read, too.

    Args:
        result: folder of a result, or a file of tracks.
        to: format of the file.
        out: file to write; for dancetrack, yolo and geff a folder.
        video: what was tracked in, where the format needs the size of the frames and the result does not know it.
        overwrite: replace existing files.
    """
    from tsuiseki.tracking.formats.exports import format_named
    from tsuiseki.tracking.result import Result

    format_named(to)
    loaded: Result[object] = Result.load(result)
    written = loaded.save(out, overwrite, to, video)
    print(f"{len(loaded)} track{'' if len(loaded) == 1 else 's'}: {written}")
