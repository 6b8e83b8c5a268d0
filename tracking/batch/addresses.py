"""Files and what lies at an address, to read from any place or to copy."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import IO, Any

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.output import whole_file

# Bytes that are fetched at a time.
FETCHED = 1 << 22


def files_of(address: str) -> tuple[Any, str]:
    """What reads an address, and the place in it."""
    kind = address.split("://")[0]
    try:
        from fsspec.core import url_to_fs
    except ImportError as error:
        raise RequestError(f"{address}: addresses need fsspec; pip install 'tsuiseki[remote]'") from error
    try:
        files, place = url_to_fs(address)
    except (ImportError, ValueError) as error:
        raise RequestError(f"{address}: nothing here reads {kind}://: {' '.join(str(error).split())}") from error
    return files, place


@contextmanager
def opened(source: str) -> Iterator[tuple[IO[bytes], int]]:
    """A file or what lies at an address, to read from any place, and its length in bytes."""
    if "://" not in source:
        with Path(source).open("rb") as file:
            yield file, Path(source).stat().st_size
        return
    files, place = files_of(source)
    try:
        with files.open(place, "rb") as file:
            yield file, int(file.size)
    except (OSError, RequestError, RunError):
        raise
    except Exception as error:  # every reader has errors of its own
        raise ConnectionError(f"{source}: {type(error).__name__} {error}") from error


def fetch(address: str, folder: Path) -> Path:
    """A copy of what lies at an address, whole or not at all; one that is there stays.

    Raises:
        RequestError: the folder cannot be written to, or see `jobs_of`.
        OSError: the network fails.
    """
    copy = folder / ("source" + (PurePosixPath(address.split("?")[0]).suffix or ".mp4"))
    if not copy.exists():
        with opened(address) as (read, size), whole_file(copy) as file:
            while block := read.read(FETCHED):
                file.write(block)
            if file.tell() != size:
                raise RunError(f"expected {size} bytes of {address}, got {file.tell()}")
    return copy
