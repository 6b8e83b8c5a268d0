"""Results on disk: written beside and renamed, so that the final name never holds half a result.

A result folder says in ``run.json`` how it was made and which files belong to it. While a run writes, it holds a lock
on its folder: a second one is refused, and what a run that was killed has left behind is cleared by the next.
"""

from __future__ import annotations

import errno
import json
import os
import platform
import secrets
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.openers.json_files import read_json

try:
    import fcntl
except ImportError:  # elsewhere than on Unix nothing is locked
    fcntl = None  # type: ignore[assignment]

RUN_FILE = "run.json"
# Of a run without end, which may go on in a folder that holds its result.
LIVE_FILE = "live.json"
UNFINISHED = ".unfinished"
# Of an earlier result, until the new one is in its place.
REPLACED = ".replaced"
# What a full or locked disk answers; it names no file.
REFUSED = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
BUSY = "another run is writing {} at this moment; choose another name"
# Columns of ``run.json`` that number frames: from 0 in Python, from 1 in the file.
SHIFTED = ("frame", "frame_of_each_video")
VERSIONED_PACKAGES = ("tsuiseki", "numpy", "scipy", "opencv-python-headless", "onnxruntime", "onnxruntime-gpu")


@contextmanager
def output_folder(folder: Path, overwrite: bool) -> Iterator[Path]:
    """A working folder whose files come to lie in ``folder`` when the ``with`` block ends, and vanish when it fails.

    An existing folder is kept. Files of the same name and sub-folders of the same name are replaced, and what an
    earlier run listed in its ``run.json`` and this one did not write is removed. A partial result does not take the
    place of a whole one, see `landing`.

    Raises:
        RequestError: ``folder`` is a file, holds files while ``overwrite`` is False, cannot be made, or another run
            writes to it.
        RunError: it was removed meanwhile.
        OSError: the disk is full, say; the files that were there are as before.
    """
    check_output_folder(folder, overwrite)
    with ExitStack() as stack:
        # Of two runs at once, only one can make the folder and lock it.
        is_new = not folder.exists()
        if is_new:
            stack.callback(remove_if_empty, folder)
        with writable(folder):
            folder.mkdir(parents=True, exist_ok=True)
        hold(folder, BUSY.format(folder), stack)
        check_output_folder(folder, overwrite)
        for left in _unfinished(folder, folder.name):
            shutil.rmtree(left, ignore_errors=True)
        work = stack.enter_context(_working_folder(folder.name, folder))
        with naming(folder):
            yield work
            check_there(work, folder)
            _publish(work, landing(work, folder))


@contextmanager
def replaced_files(folder: Path) -> Iterator[Path]:
    """A working folder whose files replace those of a result, ``run.json`` last, when the ``with`` block ends.

    Where it fails nothing is replaced. The caller holds ``folder``.

    Raises:
        RequestError: the disk refuses it.
    """
    for left in _unfinished(folder, folder.name):
        shutil.rmtree(left, ignore_errors=True)
    with _working_folder(folder.name, folder) as work, writable(folder):
        yield work
        for path in sorted(work.iterdir(), key=lambda path: path.name == RUN_FILE):
            path.replace(folder / path.name)


def check_output_folder(folder: Path, overwrite: bool) -> None:
    """Refuse a folder that results cannot go to; see `output_folder`."""
    if str(folder) == "-":
        raise RequestError("`out`: expected the name of a folder, got -; results are files, and are not printed")
    if folder.exists() and not folder.is_dir():
        raise RequestError(f"`out`: expected the name of a folder, but {folder} is a file; choose another name")
    names = sorted(p.name for p in folder.iterdir() if not p.name.startswith(".")) if folder.is_dir() else []
    if names and not overwrite:
        examples = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
        raise RequestError(f"{folder} already holds {examples}; choose another folder or add `overwrite`")
    check_writable(folder)


@contextmanager
def output_file(path: Path, overwrite: bool) -> Iterator[Path]:
    """A working file beside ``path`` that takes its place when the ``with`` block ends, and vanishes when it fails.

    Raises:
        RequestError: ``path`` is a folder, exists while ``overwrite`` is False, cannot be made, or another run writes
            it.
    """
    check_output_file(path, overwrite)
    with ExitStack() as stack:
        parent = path.resolve().parent
        with writable(parent):
            parent.mkdir(parents=True, exist_ok=True)
        for left in _unfinished(parent, path.name):
            with ExitStack() as probe:
                hold(left, BUSY.format(path), probe)
                shutil.rmtree(left, ignore_errors=True)
        work = stack.enter_context(_working_folder(path.name, parent))
        hold(work, BUSY.format(path), stack)
        with naming(path):
            yield work / path.name
            check_there(work, parent)
            (work / path.name).replace(path)


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A file to write into that takes the name ``path`` when the ``with`` block ends, and vanishes when it fails.

    For what a program keeps for itself, such as entries of a cache: nothing is locked, an earlier file is replaced,
    and of two writers at once the last one stays.

    Raises:
        RequestError: the folder of ``path`` cannot be made or written to.
        OSError: the disk is full.
    """
    beside = _beside(path.parent, path.name)
    try:
        with writable(path.parent):
            path.parent.mkdir(parents=True, exist_ok=True)
            file = beside.open("wb")
        with naming(path):
            with file:
                yield file
            beside.replace(path)
    finally:
        with suppress(OSError):
            beside.unlink(missing_ok=True)


def check_output_file(path: Path, overwrite: bool) -> None:
    """Refuse a file that a result cannot go to; see `output_file`."""
    if str(path) == "-":
        raise RequestError("expected the name of a file to write, got -")
    if path.is_dir():
        raise RequestError(f"expected the name of a file to write, but {path} is a folder")
    if path.exists() and not overwrite:
        raise RequestError(f"{path} already exists; choose another name or add `overwrite`")
    check_writable(path.resolve().parent)


def check_writable(folder: Path) -> None:
    """Refuse a folder in which no file can be made, or of one that is not there yet, the nearest above it.

    A file is made and is gone again: what the rights of a folder say is not all that counts.
    """
    place = next(parent for parent in (folder.absolute(), *folder.absolute().parents) if parent.exists())
    with writable(place), tempfile.TemporaryFile(dir=place):
        pass


@dataclass
class RunRecord:
    """What ``run.json`` says of a run.

    Attributes:
        command: the program's words that started it, or the name of the Python function.
        settings: every setting, defaults included.
        seed: of all random numbers.
        seconds: per stage.
        frames: one list a name, all as long as ``frame``: frame numbers counted from 0, counts and scores.
        partial: the run was stopped before the end of its input, or before all was written.
        reason: why it is partial.
        facts: what the run found out about its input, or chose by itself.
        results: what is known of the video beside the tracks, for each folder with some; see `formats.result_folder`.
    """

    command: Sequence[str]
    settings: Mapping[str, Any]
    seed: int = 0
    seconds: Mapping[str, float] = field(default_factory=dict)
    frames: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    partial: bool = False
    reason: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)
    results: Mapping[str, Any] = field(default_factory=dict)

    def write(self, folder: Path) -> None:
        """Write ``run.json`` into ``folder``; call it last, for it lists the files there."""
        values = {
            "command": list(self.command),
            "partial": self.partial,
            **({"reason": self.reason} if self.reason else {}),
            "seed": self.seed,
            "settings": self.settings,
            **({"facts": self.facts} if self.facts else {}),
            "versions": versions(),
            "seconds": {stage: round(value, 4) for stage, value in self.seconds.items()},
            "files": sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()),
            **({"results": self.results} if self.results else {}),
            "frames": columns_shifted(self.frames, 1),
        }
        with whole_file(folder / RUN_FILE) as file:
            file.write(record_text(values).encode())


def columns_shifted(columns: Mapping[str, Sequence[Any]], by: int) -> dict[str, Sequence[Any]]:
    """Columns of a run's frames, whose numbers count from another one."""
    return {name: _shifted(column, by) if name in SHIFTED else column for name, column in columns.items()}


def _shifted(numbers: Sequence[Any], by: int) -> list[Any]:
    return [None if n is None else _shifted(n, by) if isinstance(n, list) else n + by for n in numbers]


def is_partial(folder: Path) -> bool:
    """Whether the ``run.json`` in ``folder`` says that the run was stopped before the end of its input."""
    try:
        return read_json(folder / RUN_FILE, "the record of a run")["partial"] is True
    except (ValueError, KeyError, TypeError):
        return False


def record_text(values: Mapping[str, Any]) -> str:
    """What ``run.json`` holds: JSON with a line for each setting and each column of numbers."""
    text = json.dumps({**values, "frames": None}, indent=2, default=str)
    columns = ",\n".join(f"    {json.dumps(name)}: {json.dumps(list(c))}" for name, c in values["frames"].items())
    assert text.endswith('"frames": null\n}')
    return text.removesuffix("null\n}") + ("{\n" + columns + "\n  }" if columns else "{}") + "\n}\n"


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that results depend on."""
    by_package = {"python": platform.python_version()}
    for package in VERSIONED_PACKAGES:
        try:
            by_package[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return by_package


@contextmanager
def writable(folder: Path) -> Iterator[None]:
    """What the disk refuses within is a RequestError."""
    try:
        yield
    except OSError as error:
        raise RequestError(f"cannot write to {folder}: {error.strerror}; choose another place") from error


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """An error of the disk within that names no file, or an unfinished one, names ``path``."""
    try:
        yield
    except OSError as error:
        if (error.filename is None and error.errno in REFUSED) or UNFINISHED in str(error.filename):
            error.filename = str(path)
        raise


def check_there(work: Path, folder: Path) -> None:
    """Refuse to go on where ``work``, in which results come into being, is gone; raises RunError."""
    if not work.is_dir():
        raise RunError(f"{folder} was removed while the run wrote into it; nothing was written")


def landing(work: Path, folder: Path) -> Path:
    """Where the files in ``work`` come to lie: ``folder``, or beside it a partial result in place of a whole one."""
    whole = (folder / RUN_FILE).is_file() and not is_partial(folder)
    return folder.with_name(f"{folder.resolve().name}.partial") if whole and is_partial(work) else folder


def hold(held: Path, busy: str, until: ExitStack) -> None:
    """Hold a lock on a folder; raises RequestError, which says ``busy``, where another process or session does."""
    if fcntl is None:
        return
    try:
        number = os.open(held, os.O_RDONLY)
    except FileNotFoundError:
        return
    until.callback(os.close, number)
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise RequestError(busy) from error
    except OSError:
        return  # a file system without locks


def held(folder: Path, until: ExitStack) -> bool:
    """Hold a lock on ``folder``; False where another process does."""
    try:
        hold(folder, "", until)
    except RequestError:
        return False
    return True


def _unfinished(parent: Path, name: str) -> list[Path]:
    """What runs that were killed have left behind."""
    return [p for p in parent.iterdir() if p.name.startswith(f".{name}.") and p.name.endswith(UNFINISHED)]


def remove_if_empty(folder: Path) -> None:
    """Remove a folder in which nothing lies, where that may be."""
    with suppress(OSError):
        folder.rmdir()


def _beside(parent: Path, name: str) -> Path:
    return parent / f".{name}.{secrets.token_hex(4)}{UNFINISHED}"


def destination(place: Path) -> Path:
    """Where a file or folder in a working folder comes to lie, and any other where it lies."""
    return Path(*(part for part in place.absolute().parts if not part.endswith(UNFINISHED)))


@contextmanager
def _working_folder(name: str, parent: Path) -> Iterator[Path]:
    work = _beside(parent, name)
    with writable(parent):
        work.mkdir()
    try:
        yield work
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _publish(work: Path, folder: Path) -> None:
    """Move the files in ``work`` to ``folder``; on a failure all that was there lies there again."""
    written = {path.relative_to(work).as_posix() for path in work.rglob("*") if path.is_file()}
    stale = sorted(listed_files(folder) - written - {RUN_FILE})
    paths, aside = sorted(work.iterdir(), key=lambda path: path.name == RUN_FILE), work / REPLACED
    for place in (folder, aside):
        place.mkdir(exist_ok=True)
    with ExitStack() as undo:

        def move(path: Path, target: Path) -> None:
            path.rename(target)
            undo.callback(target.rename, path)

        # run.json goes first and comes last: while it is missing, a mixture is not taken for a result.
        for number, name in enumerate((RUN_FILE, *stale, *(path.name for path in paths))):
            if os.path.lexists(folder / name):
                move(folder / name, aside / str(number))
        for path in paths:
            move(path, folder / path.name)
        undo.pop_all()
    for name in stale:
        remove_if_empty((folder / name).parent)


def listed_files(folder: Path) -> set[str]:
    """Files that the ``run.json`` in ``folder`` lists, without any that would lead out of it."""
    try:
        names = read_json(folder / RUN_FILE, "the record of a run")["files"]
        paths = {PurePosixPath(name) for name in names}
    except (ValueError, KeyError, TypeError):
        return set()
    inside = {path for path in paths if not path.is_absolute() and ".." not in path.parts}
    return {p.as_posix() for p in inside if (folder / p).resolve().is_relative_to(folder.resolve())}
