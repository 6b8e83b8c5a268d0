"""`tsuiseki convert`: a result into the file of another program."""

from __future__ import annotations

from pathlib import Path


def convert(
    result: Path, out: Path, *, to: str | None = None, video: str | None = None, overwrite: bool = False
) -> None:
    """Write a result into the file of another program; events of track people --events go into csv.

    Formats: csv, json, parquet, mot, dancetrack, kitti, coco, cvat, label-studio, yolo, sleap, sleap-analysis,
    deeplabcut, via, geff. KITTI, CVAT, COCO, Label Studio and YOLO are read, too.

    Args:
        result: folder of a result, or a file of tracks or events.
        out: file to write; for dancetrack, yolo and geff a folder.
        to: format of the file; by default the first above that has the ending of OUT.
        video: what was tracked in, where the format needs the size of the frames and the result does not know it.
        overwrite: replace existing files.
    """
    from tsuiseki.tracking.errors import RequestError
    from tsuiseki.tracking.events.table import is_event_file
    from tsuiseki.tracking.formats.exports import SUFFIXES, format_named
    from tsuiseki.tracking.result import Result

    if to is None and (to := SUFFIXES.get(out.suffix.lower())) is None:
        raise RequestError(f"expected `to`, or the name of a file ending in {', '.join(SUFFIXES)}, got {out}")
    format_named(to)
    if is_event_file(result):
        _convert_events(result, to, out, overwrite)
        return
    loaded: Result[object] = Result.load(result)
    written = loaded.save(out, overwrite, to, video)
    print(f"{len(loaded)} track{'' if len(loaded) == 1 else 's'}: {written}")


def _convert_events(path: Path, to: str, out: Path, overwrite: bool) -> None:
    from tsuiseki.tracking.errors import RequestError
    from tsuiseki.tracking.events.table import read_events, write_event_table
    from tsuiseki.tracking.output import output_file

    if to != "csv" or out.suffix.lower() != ".csv":
        raise RequestError(f"events go into csv, expected `to` csv and the name of a .csv, got {to} and {out}")
    with output_file(out, overwrite) as work:
        count = write_event_table(work, read_events(path))
    print(f"{count} event{'' if count == 1 else 's'}: {out}")
