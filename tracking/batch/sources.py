"""What a batch is to do: folders, globs, manifests and addresses as one job a video, each with a name of its own."""

from __future__ import annotations

import csv
import glob
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

from tsuiseki.tracking.batch.addresses import files_of
from tsuiseki.tracking.batch.jobs import Job
from tsuiseki.tracking.cameras.multicamera import is_floor_folder
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot_sequence import is_sequence, list_images
from tsuiseki.tracking.openers.yaml_files import yaml_of
from tsuiseki.tracking.output import RUN_FILE
from tsuiseki.tracking.video.source import file_of

VIDEOS = (".mp4", ".m4v", ".avi", ".mkv", ".mov", ".mpg", ".mpeg", ".webm", ".ts", ".mts", ".m2ts", ".wmv", ".flv")
MANIFESTS = (".csv", ".yaml", ".yml")
# Columns of a manifest that are no options.
OWN = ("source", "name", "start")


def jobs_of(sources: Sequence[str], job: Job) -> list[Job]:
    """What ``job`` is, for each video of folders, globs, manifests, addresses and files.

    Raises:
        RequestError: there is no video, two have one name, a row of a manifest is wrong, or nothing reads an address.
    """
    jobs: list[tuple[str, Job]] = []
    for source in sources:
        jobs += _jobs_of(str(source), job)
    if not jobs:
        raise RequestError("expected at least one source, got none")
    names: dict[str, str] = {}
    for where, video in jobs:
        if not re.fullmatch(r"[^/\\]+", video.name) or video.name.startswith("."):
            raise RequestError(f"{where}: expected a name for a folder, got {video.name!r}")
        if video.name.casefold() in names:
            raise RequestError(
                f"{names[video.name.casefold()]} and {where} would both be called {video.name}; name them in a manifest"
            )
        names[video.name.casefold()] = where
    return [video for _, video in jobs]


def _jobs_of(source: str, job: Job) -> Iterator[tuple[str, Job]]:
    path = Path(source)
    if not source:
        raise RequestError("expected the name of a video, a folder or an address, got nothing")
    if "://" in source:
        for address in _addresses(source):
            yield address, replace(job, source=address, name=PurePosixPath(address.split("?")[0]).stem)
    elif path.is_dir():
        for video in _in_folder(path, job):
            inside = video.relative_to(path).with_suffix("").parts if video != path else (video.resolve().name,)
            yield str(video), replace(job, source=str(video), name="-".join(inside))
    elif path.suffix.lower() in MANIFESTS:
        yield from _in_manifest(path, job)
    elif (file := file_of(source)) is not None:
        yield source, replace(job, source=source, name=file.stem)
    else:
        matches = sorted(glob.iglob(source, recursive=True)) if glob.has_magic(source) else []  # noqa: PTH207
        if not matches:
            what = "no file fits this pattern" if glob.has_magic(source) else "there is no such file or folder"
            raise RequestError(f"{source}: expected videos, but {what}")
        for match in matches:
            yield from _jobs_of(match, job)


def _in_folder(folder: Path, job: Job) -> list[Path]:
    """The videos in a folder and below; of commands on results, the results."""
    if job.command[0] in ("count", "evaluate"):
        videos = [folder] if (folder / RUN_FILE).exists() or is_sequence(folder) else sorted(folder.iterdir())
        videos = [entry for entry in videos if entry.is_dir() and not entry.name.startswith(".")]
    elif job.command == ("track", "floor"):
        # The boxes of all its cameras are one video.
        videos = [entry for entry in (folder, *folder.iterdir()) if is_floor_folder(entry)]
    elif list_images(folder) or is_sequence(folder):
        videos = [folder]
    else:
        inside = sorted(path for path in folder.rglob("*") if not any(x.startswith(".") for x in path.parts))
        videos = [path for path in inside if path.is_file() and path.suffix.lower() in VIDEOS]
        pictures = [path for path in inside if path.is_dir() and (list_images(path) or is_sequence(path))]
        # The pictures of a sequence lie in a folder of its own.
        videos += [path for path in pictures if not any(parent in path.parents for parent in pictures)]
    if not videos and job.command == ("track", "floor"):
        raise RequestError(f"{folder}: expected folders of WILDTRACK or Shelf, found none")
    if not videos:
        raise RequestError(f"{folder}: expected videos ({', '.join(VIDEOS[:4])}, …) or folders of images, found none")
    return sorted(videos)


def _in_manifest(path: Path, job: Job) -> Iterator[tuple[str, Job]]:
    for number, row in enumerate(_rows(path), 1):
        where = f"{path} row {number}"
        if not row.get("source"):
            raise RequestError(f"{where}: expected a `source`, got {', '.join(map(str, row)) or 'nothing'}")
        source = str(row["source"])
        if "://" not in source and file_of(path.parent / source) is not None:
            source = str(path.parent / source)
        if "://" not in source and file_of(source) is None:
            raise RequestError(f"{where}: there is no {source}")
        name = str(row.get("name") or PurePosixPath(source.split("?")[0]).stem)
        row_options: dict[str, Any] = {}
        for key, value in row.items():
            if not isinstance(key, str):
                raise RequestError(f"{where}: expected names of options, got {key!r}")
            if key not in OWN and value not in (None, ""):
                put(row_options, key.replace("-", "_"), value)
        try:
            start = None if row.get("start") in (None, "") else float(row["start"])
            options = merged(job.options, row_options)
            video = replace(job, source=source, name=name, options=options, start=start)
            if row_options:
                video.request(source, Path("unused"))
        except (TypeError, ValueError) as error:
            raise RequestError(f"{where}: {error}") from error
        yield where, video


def put(values: dict[str, Any], name: str, value: Any) -> None:
    """Set the option ``name``, such as ``flow.fill``, in nested values."""
    *above, last = name.split(".")
    for part in above:
        values = values.setdefault(part, {})
    values[last] = value


def merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Nested values, of which those of ``above`` win."""
    both = [name for name in above if isinstance(above[name], Mapping) and isinstance(below.get(name), Mapping)]
    return {**below, **above} | {name: merged(below[name], above[name]) for name in both}


def _rows(path: Path) -> list[Mapping[str, Any]]:
    try:
        text = path.read_text(encoding="utf-8-sig")
        if path.suffix.lower() == ".csv":
            rows: Any = [*csv.DictReader(text.splitlines(), restkey="more than the columns")]
        else:
            rows = yaml_of(text, str(path), "a manifest")
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RequestError(f"{path}: cannot be read as a manifest: {' '.join(str(error).split())[:160]}") from error
    if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
        raise RequestError(f"{path}: expected rows with a `source` each, got something else")
    return rows


def _addresses(address: str) -> list[str]:
    files, place = files_of(address)
    if not (glob.has_magic(place) or place.endswith("/")):
        return [address]
    try:
        matches = files.glob(place) if glob.has_magic(place) else files.find(place)
    except (OSError, ValueError) as error:
        raise RequestError(f"{address}: nothing answers: {error}") from error
    videos = sorted(match for match in matches if PurePosixPath(match).suffix.lower() in VIDEOS)
    if not videos:
        raise RequestError(f"{address}: expected videos, but no file fits")
    return [files.unstrip_protocol(match) for match in videos]
