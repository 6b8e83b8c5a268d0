"""One video of a batch: the command, its options, and where the result goes; and whether that is there already.

A result counts as there by what it was made of: the bytes of the video and of the models, the options, the versions.
Dates tell nothing. Of a file of up to 64 MB all bytes are summed, of a larger one its length and 64 blocks of 1 MB from
its first to its last.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from tsuiseki.tracking.batch.addresses import opened
from tsuiseki.tracking.cli.commands import command_of
from tsuiseki.tracking.cli.request import Request, recorded, request_of
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot_sequence import is_sequence, read_sequence
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.output import RUN_FILE, is_partial, versions, whole_file
from tsuiseki.tracking.video.source import file_of
from tsuiseki.tracking.weights import shipped_or_file
from tsuiseki.tracking.weights.catalogue import file_sum

STATE = ".batch"
# Bytes that are summed at a time.
BLOCK = 1 << 20
# Blocks of a large file that are summed.
BLOCKS = 64
SCORES = "scores.json"
NETWORKS = ("detector", "appearance", "affinity")
# Options that change no result.
IDLE = ("out", "overwrite", "threads", "json")


@dataclass(frozen=True)
class Job:
    """A command on one video.

    Attributes:
        command: its words, such as track and people.
        source: what it is given: a path or an address.
        name: of the folder of its result.
        options: values by name, as words or as YAML has them; ``{name}`` in a text stands for the name.
        start: when the video began, seconds; None where unknown.
    """

    command: tuple[str, ...]
    source: str
    name: str
    options: Mapping[str, Any] = field(default_factory=dict)
    start: float | None = None

    def request(self, source: str, folder: Path, overwrite: bool = True, **changes: Any) -> Request:
        """That of the command for a video at a path, with ``changes`` of its options; the result goes to ``folder``.

        Raises:
            RequestError: an option is unknown or wrong.
        """
        place, *names = options_of(self.command)
        options = {**json.loads(json.dumps(dict(self.options)).replace("{name}", self.name)), **changes}
        if "detections" in names and (detections := own_detections(source, options)) is not None:
            options["detections"] = str(detections)
        options |= {"out": str(folder)} if "out" in names else {"json": str(folder / SCORES)} if "json" in names else {}
        return request_of(self.command, options | {"overwrite": overwrite, place: source})


def own_detections(source: str, options: Mapping[str, Any]) -> Path | None:
    """The file of detections in the folder of a video; None where the options say another one, or that of a detector.

    A path in the options that does not exist is looked for in the folder. Where there is none, a MOTChallenge sequence
    without pictures has ``det/det.txt``.
    """
    folder, named = Path(source), options.get("detections")
    if named is not None:
        inside = folder / str(named)
        return inside if isinstance(named, str) and not Path(named).exists() and inside.is_file() else None
    if options.get("detector") is not None or not folder.is_dir() or not is_sequence(folder):
        return None
    sequence = read_sequence(folder)
    return sequence.detections_path if not sequence.images and sequence.detections_path.is_file() else None


@cache
def options_of(words: tuple[str, ...]) -> list[str]:
    """Names of the options of a command, that of the source first; raises RequestError where there is none."""
    chain, command = command_of(words)
    if command.default_command is None or chain != words:
        raise RequestError(f"expected a command such as `track people` for a batch, got `{' '.join(words)}`")
    options = command.assemble_argument_collection(parse_docstring=False).filter_by(show=True)
    return [option.name[2:].replace("-", "_") for option in sorted(options, key=lambda option: option.index != 0)]


def content_of(source: str) -> str:
    """A sum over a file, over what lies at an address, or over the files in a folder by their names.

    Of each file length and bytes count: all, or `BLOCKS` of a larger one, shared among the files of a folder.
    """
    digest, path = hashlib.sha256(), file_of(source) or Path(source)
    inside = sorted(entry for entry in path.rglob("*") if entry.is_file()) if "://" not in source else []
    # Another stream of a file is another video.
    digest.update(source.removeprefix(str(path)).encode())
    for name in [str(entry) for entry in inside] or [source if "://" in source else str(path)]:
        if inside:
            digest.update(Path(name).relative_to(path).as_posix().encode())
        blocks = max(BLOCKS // max(len(inside), 1), 1)
        with opened(name) as (file, size):
            digest.update(str(size).encode())
            stride, place = max((size - BLOCK) / max(blocks - 1, 1), BLOCK), 0.0
            while place < size:
                file.seek(round(place))
                digest.update(file.read(BLOCK))
                place += stride
    return digest.hexdigest()


def key_of(job: Job, source: str, circumstances: Any = None) -> str:
    """What the result of a job is known by, in its ``circumstances``; see the head of this file.

    Raises:
        RequestError: see `Job.request`; or a file cannot be read.
    """
    plain: dict[str, Any] = {}
    for name, value in sorted(settings_of(job, source).items()):
        path = Path(str(value)) if isinstance(value, str) and value else None
        if path is not None and name in NETWORKS and value != "none":
            path = shipped_or_file(name, path)
        try:
            there = path is not None and path.exists()
        except OSError:
            there = False
        if path is not None and there:
            plain[name] = content_of(str(path)) if path.is_dir() else file_sum(path)
        else:
            plain[name] = value
    parts = [list(job.command), plain, content_of(source), versions(), circumstances]
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()[:24]


def settings_of(job: Job, source: str) -> dict[str, Any]:
    """Options that make a difference, plain, with all defaults; without the source."""
    settings, place = job.request(source, Path("unused")).settings, options_of(job.command)[0]
    return {name: value for name, value in recorded(settings).items() if name not in (*IDLE, place)}


@dataclass(frozen=True)
class Place:
    """Where a job leaves things: the folder of its result, and that of what it keeps on its way."""

    folder: Path
    state: Path

    @classmethod
    def of(cls, batch: Path, job: Job) -> Place:
        """In the folder of a batch."""
        return cls(batch / job.name, batch / STATE / job.name)

    @property
    def record(self) -> dict[str, Any]:
        """What the result was begun with: its key and settings; empty where there is none."""
        try:
            record: dict[str, Any] = read_json(self.state / "made.json", "what a batch has begun")
        except RequestError:
            return {}
        return record

    @property
    def there(self) -> bool:
        """Whether a whole result lies there."""
        record = self.folder / RUN_FILE
        return (record.is_file() and not is_partial(self.folder)) or (self.folder / SCORES).is_file()

    def refuse_others(self, job: Job) -> None:
        """Refuse a result of other settings; raises RequestError where one is there."""
        settings = settings_of(job, job.source) if self.there else {}
        if self.there and (not self.record or self.record["settings"] != json.loads(json.dumps(settings, default=str))):
            self._refuse(settings)

    def _refuse(self, settings: Mapping[str, Any]) -> None:
        old, now = self.record.get("settings"), json.loads(json.dumps(dict(settings), default=str))
        differs = [name for name in sorted({*old, *now}) if old.get(name) != now.get(name)] if old else []
        differences = ", ".join(f"{name} {(old or {}).get(name)}, now {now.get(name)}" for name in differs[:3])
        description = f"of other settings ({differences})" if differs else "of another video, other models or versions"
        description = "that no batch has made" if old is None else description
        raise RequestError(f"{self.folder} holds a result {description}; choose another `out` or add `overwrite`")

    def begin(self, key: str, settings: Mapping[str, Any], overwrite: bool, redo: bool = False) -> bool:
        """Take the place for a job; False where its result is there, unless it is to be done again.

        Raises:
            RequestError: another result is there.
        """
        record = self.record
        if record.get("key") == key and self.there and not redo:
            return False
        # What was left behind in part, of whatever settings, is no result.
        if self.there and not overwrite and record.get("key") != key:
            self._refuse(settings)
        (self.folder / RUN_FILE).unlink(missing_ok=True)
        (self.folder / SCORES).unlink(missing_ok=True)
        if record.get("key") != key:
            shutil.rmtree(self.state, ignore_errors=True)
        with whole_file(self.state / "made.json") as file:
            file.write(json.dumps({"key": key, "settings": dict(settings)}, default=str).encode())
        return True

    def clear(self) -> None:
        """Drop what was kept on the way."""
        for path in self.state.iterdir():
            if path.name != "made.json":
                shutil.rmtree(path) if path.is_dir() else path.unlink()
