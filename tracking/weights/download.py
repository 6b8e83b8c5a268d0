"""A network of the catalogue comes into the cache: by pooch, which keeps only what has the right sum.

What pooch does not do is to go on where a download was cut off, so the bytes are fetched here.
"""

from __future__ import annotations

import errno
import shutil
import zipfile
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.output import hold, whole_file
from tsuiseki.tracking.weights.catalogue import CatalogueModel, file_sum

if TYPE_CHECKING:
    import requests

# Bytes of a piece, by which progress is counted.
MEGABYTE = 1_000_000
# Seconds of silence after which a server counts as gone.
PATIENCE = 30.0
# Times that a server may break off.
TRIES = 5
# What a server answers to a start beyond the end of the file.
RANGE_NOT_SATISFIABLE = 416

Watch = Callable[[Iterable[bytes], str, int | None], Iterable[bytes]]
"""Passes pieces of a megabyte through: the pieces, what is being done, and how many there are where that is known."""


def download(entry: CatalogueModel, watch: Watch = lambda pieces, _, __: pieces) -> None:
    """Fetch ``entry`` into its place in the cache, and keep its record.

    Args:
        watch: shows how far it is.

    Raises:
        RequestError: another run is fetching it.
        RunError: the server refuses or keeps breaking off; the sum is another; or the disk is full.
    """
    part = entry.file.with_suffix(".part")
    try:
        part.parent.mkdir(parents=True, exist_ok=True)
        part.touch()
        with ExitStack() as until:
            hold(part, f"another run is downloading {entry.name}; wait for its end", until)
            fetched = _fetched(entry, part, watch)
        sha256 = file_sum(fetched)
        _put(fetched, entry)
        entry.keep(sha256)
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        reason = "no space left; make room" if full else f"{error.strerror or error}; make it writable"
        raise RunError(f"{part}: {reason}, or name another cache by TSUISEKI_CACHE") from error


def _fetched(entry: CatalogueModel, part: Path, watch: Watch) -> Path:
    """What lies at the address, if its sum is right."""
    import pooch

    pooch.get_logger().setLevel("WARNING")
    expected = entry.sha256 or entry.record().get("sha256")

    def downloader(address: str, file: str, _: object) -> None:
        _resumed(address, part, watch).replace(file)

    try:
        return Path(pooch.retrieve(entry.address, expected, f"{entry.name}.whole", part.parent, downloader=downloader))
    except ValueError as error:
        raise RunError(f"{entry.address}: {error}") from error


def _resumed(address: str, part: Path, watch: Watch) -> Path:
    """``part``, to which is appended what it lacks, however often the server breaks off."""
    import requests

    reason = "no beginning that fits"
    for _ in range(TRIES):
        start = part.stat().st_size
        headers = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={start}-"} if start else {})
        try:
            with requests.get(address, headers=headers, stream=True, timeout=PATIENCE) as answer:
                if answer.ok:
                    _append(answer, part, watch)
                    return part
                if answer.status_code != RANGE_NOT_SATISFIABLE:
                    raise RunError(f"{address}: the server answers {answer.status_code} {answer.reason}")
            part.write_bytes(b"")  # what is here is no beginning of what is there
        except requests.RequestException as error:
            reason = str(error)
    raise RunError(
        f"{address}: broke off {TRIES} times, the last time with {reason!r}; {part.stat().st_size} bytes are kept: "
        "give the command again to go on from there"
    )


def _append(answer: requests.Response, part: Path, watch: Watch) -> None:
    """Write ``answer`` behind ``part``, or in its place where the server sends the whole file again."""
    with part.open("ab" if answer.status_code == 206 else "wb") as file:
        count = int(answer.headers.get("Content-Length", 0)) // MEGABYTE or None
        for piece in watch(answer.iter_content(MEGABYTE), f"downloading {part.stem}, megabytes", count):
            file.write(piece)


def _put(fetched: Path, entry: CatalogueModel) -> None:
    """Make the ONNX file of what was fetched."""
    if not entry.address.endswith(".zip"):
        fetched.replace(entry.file)
        return
    try:
        with zipfile.ZipFile(fetched) as archive:
            names = [name for name in archive.namelist() if name.endswith(".onnx")]
            if len(names) != 1:
                raise RunError(f"{entry.address}: expected one ONNX file in the archive, got {len(names)}")
            with archive.open(names[0]) as packed, whole_file(entry.file) as file:
                shutil.copyfileobj(packed, file)
    except zipfile.BadZipFile as error:
        raise RunError(f"{entry.address}: expected a zip archive, got something else; it is not kept") from error
    finally:
        fetched.unlink()
