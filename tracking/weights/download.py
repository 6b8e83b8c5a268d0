"""A network of the catalogue comes into the cache: by pooch, which keeps only what has the right sum.

What pooch does not do is to go on where a download was cut off, so the bytes are fetched here.
"""

from __future__ import annotations

import errno
import tarfile
import zipfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.output import hold, whole_file
from tsuiseki.tracking.weights.catalogue import CatalogueModel, agrees, file_sum
from tsuiseki.tracking.weights.registries import SCHEME, fetch_archive
from tsuiseki.tracking.weights.tensorflow_js import frozen_graph

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
        RunError: the server refuses or keeps breaking off; a sum is another; or the disk is full.
    """
    part = entry.file.with_suffix(".part")
    try:
        part.parent.mkdir(parents=True, exist_ok=True)
        part.touch()
        with ExitStack() as until:
            hold(part, f"another run is downloading {entry.name}; wait for its end", until)
            fetched = _fetched(entry.address, entry.sha256 or entry.record().get("sha256"), entry.whole, part, watch)
        sha256 = file_sum(fetched)
        _put(fetched, entry)
        if len(entry.files) > 1:
            _fetch_weights(entry, watch)
        entry.keep(sha256)
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        reason = "no space left; make room" if full else f"{error.strerror or error}; make it writable"
        raise RunError(f"{part}: {reason}, or name another cache by TSUISEKI_CACHE") from error


def _fetch_weights(entry: CatalogueModel, watch: Watch) -> None:
    """OpenVINO's weights, from beside its graph."""
    file, address = entry.files[1], entry.address.removesuffix(entry.ending) + ".bin"
    part = file.with_suffix(".bin.part")
    part.touch()
    _fetched(address, entry.sums()[1] or None, file, part, watch)


def _fetched(address: str, expected: str | None, file: Path, part: Path, watch: Watch) -> Path:
    """``file``, with what lies at the address, if its sum is right; it is not fetched where it lies there already."""
    import pooch

    pooch.get_logger().setLevel("WARNING")

    def downloader(address: str, target: str, _: object) -> None:
        if address.startswith(SCHEME):
            fetch_archive(address, part)
        else:
            _resumed(address, part, watch)
        part.replace(target)

    try:
        return Path(pooch.retrieve(address, expected, file.name, file.parent, downloader=downloader))
    except ValueError as error:
        raise RunError(f"{address}: {error}") from error
    finally:
        if part.is_file() and not part.stat().st_size:
            part.unlink()


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
    """Make the file of the network of what was fetched.

    Raises:
        RunError: it is no archive, lacks the network, or has another one.
    """
    if not entry.packed:
        fetched.replace(entry.file)
        return
    try:
        with whole_file(entry.file) as file:
            file.write(_unpacked(fetched, entry))
    finally:
        fetched.unlink()
    if entry.file_sha256 and not agrees(entry.file, entry.file_sha256):
        got = file_sum(entry.file)
        entry.file.unlink()
        raise RunError(f"{entry.address}: expected a network of sha256 {entry.file_sha256}, got {got}; it is not kept")


def _unpacked(fetched: Path, entry: CatalogueModel) -> bytes:
    """The network in an archive. Members are read by name and never written under it: no path leads outside."""
    try:
        with _archive(fetched) as (names, read):
            name = entry.member or _only_network(names, entry)
            network = read(name)[entry.start :]
            if name.endswith(".json"):
                return frozen_graph(network, read(name.removesuffix(".json") + ".bin"))
            return network
    except KeyError as error:
        raise RunError(f"{entry.address}: expected {error} in the archive, found none; it is not kept") from error
    except (zipfile.BadZipFile, tarfile.TarError, EOFError) as error:
        raise RunError(f"{entry.address}: expected an archive, got something else; it is not kept") from error


@contextmanager
def _archive(path: Path) -> Iterator[tuple[list[str], Callable[[str], bytes]]]:
    """Names of the files in a zip or tar archive, and what reads one; KeyError where there is none of that name."""
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as zipped:
            yield zipped.namelist(), zipped.read
        return
    with tarfile.open(path) as packed:
        members = {member.name: member for member in packed if member.isreg()}

        def read(name: str) -> bytes:
            file = packed.extractfile(members[name])
            assert file is not None
            return file.read()

        yield list(members), read


def _only_network(names: Iterable[str], entry: CatalogueModel) -> str:
    networks = [name for name in names if name.endswith(".onnx")]
    if len(networks) != 1:
        raise RunError(f"{entry.address}: expected one ONNX file in the archive, got {len(networks)}")
    return networks[0]
