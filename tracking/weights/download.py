"""Fetching a model of the catalogue: it goes on where it was cut off, and only what has the right sum is kept."""

from __future__ import annotations

import errno
import shutil
import time
import zipfile
from collections.abc import Iterator
from http.client import HTTPException, HTTPResponse
from pathlib import Path
from typing import BinaryIO
from urllib.error import HTTPError, URLError
from urllib.request import Request, urlopen

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.weights.catalogue import CatalogueModel, file_sum

try:
    import fcntl
except ImportError:  # elsewhere than on Unix nothing is locked
    fcntl = None  # type: ignore[assignment]

MEGABYTE = 1_000_000
# Seconds for the server to say anything; how often it may break off; bytes a second that it must give on the whole.
PATIENCE, TRIES, SLOWEST = 30.0, 5, 10_000
_NOT_SATISFIABLE, _PARTIAL = 416, 206


def download(entry: CatalogueModel) -> Iterator[None]:
    """Fetch ``entry`` into its place in the cache; one step a megabyte.

    Raises:
        RequestError: another run is fetching it.
        RunError: the server refuses, is too slow or keeps breaking off; the sum is another; or the disk is full.
    """
    part = entry.file.with_suffix(".part")
    try:
        part.parent.mkdir(parents=True, exist_ok=True)
        with part.open("ab") as file:
            _lock(file, entry)
            yield from _fetched(entry, file)
        expected, got = entry.sha256 or entry.record().get("sha256"), file_sum(part)
        if expected and got != expected:
            part.unlink()
            raise RunError(
                f"{entry.address}: expected sha256 {expected}, got {got}; it is not kept, for it came broken or is "
                "another file; give the command again, and ask the project where that does not help"
            )
        _put(part, entry)
        entry.keep(got)
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        reason = "no space left; make room" if full else f"{error.strerror or error}; make it writable"
        raise RunError(f"{part}: {reason}, or name another cache by XDG_CACHE_HOME") from error


def _lock(file: BinaryIO, entry: CatalogueModel) -> None:
    if fcntl is not None:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise RequestError(f"another run is downloading {entry.name}; wait for its end") from error


def _fetched(entry: CatalogueModel, file: BinaryIO) -> Iterator[None]:
    """Append to ``file`` until it is whole; a step for each megabyte that it has, however often it is cut off."""
    reason, shown = "", 0
    for _ in range(TRIES):
        if entry.size and file.tell() == entry.size:
            break
        try:
            with _answer(entry.address, file) as answer:
                for _ in _appended(answer, file, Path(file.name)):
                    while shown < file.tell() // MEGABYTE:
                        shown += 1
                        yield
            break
        except HTTPError as error:
            if error.code != _NOT_SATISFIABLE:
                raise RunError(f"{entry.address}: the server answers {error.code} {error.reason}") from error
            _empty(file)  # what is here is no beginning of what is there
        except (URLError, HTTPException, TimeoutError, ConnectionError) as error:
            reason = str(getattr(error, "reason", "") or error) or type(error).__name__
    else:
        raise RunError(
            f"{entry.address}: broke off {TRIES} times, the last time with {reason!r}; {file.tell()} bytes are kept: "
            "give the command again to go on from there"
        )


def _answer(address: str, file: BinaryIO) -> HTTPResponse:
    """What follows what ``file`` has, or all where the server does not do that; ``file`` is emptied then."""
    start = file.seek(0, 2)
    answer: HTTPResponse = urlopen(
        Request(address, headers={"Range": f"bytes={start}-"} if start else {}), timeout=PATIENCE
    )
    if start and answer.status != _PARTIAL:
        _empty(file)
    return answer


def _empty(file: BinaryIO) -> None:
    file.seek(0)
    file.truncate()


def _appended(answer: HTTPResponse, file: BinaryIO, path: Path) -> Iterator[None]:
    """Append all of ``answer``, step by step.

    Raises:
        TimeoutError: it comes more slowly than `SLOWEST`.
        HTTPException: it ends too early.
    """
    length = int(answer.headers.get("Content-Length") or 0)
    free = shutil.disk_usage(path.parent).free
    if length > free:
        raise OSError(errno.ENOSPC, "")
    start, begun = file.tell(), time.monotonic()
    while chunk := answer.read1(1 << 16):
        file.write(chunk)
        yield
        if time.monotonic() - begun > PATIENCE + (file.tell() - start) / SLOWEST:
            raise TimeoutError("too slow")
    if length and file.tell() - start < length:
        raise HTTPException("the end of the connection")


def _put(part: Path, entry: CatalogueModel) -> None:
    """Make the ONNX file of what was fetched."""
    if not entry.address.endswith(".zip"):
        part.replace(entry.file)
        return
    work = entry.file.with_suffix(".unpacked")
    try:
        with zipfile.ZipFile(part) as archive:
            names = [name for name in archive.namelist() if name.endswith(".onnx")]
            if len(names) != 1:
                raise RunError(f"{entry.address}: expected one ONNX file in the archive, got {len(names)}")
            with archive.open(names[0]) as packed, work.open("wb") as file:
                shutil.copyfileobj(packed, file)
        work.replace(entry.file)
    except zipfile.BadZipFile as error:
        raise RunError(f"{entry.address}: expected a zip archive, got something else; it is not kept") from error
    finally:
        part.unlink()
        work.unlink(missing_ok=True)
