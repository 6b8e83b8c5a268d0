"""The result of a run without end: a folder for every so many hours, readable while it is written.

    OUT/2026-11-29T15-00Z/tracks.csv    rows of one part; its frames count from 1, its times are seconds since 1970
    OUT/outages.csv                     when a camera was away, the clock jumped, or nothing ran
    OUT/live.json                       the highest id so far, and the settings
    OUT/run.json                        how it was made, with the counts of each camera

Rows are on the disk as soon as they are certain, whole lines at a time. A run that is started again with the same
settings goes on, whatever ended it: what was cut off within a line is removed, and no id is given twice.
"""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from pydantic import PositiveFloat
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.errors import AbsentCameraError, InputWarning, RequestError
from tsuiseki.tracking.fields import Options
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.output import (
    BUSY,
    LIVE_FILE,
    RunRecord,
    check_output_folder,
    hold,
    listed_files,
    whole_file,
    writable,
)
from tsuiseki.tracking.runs.ending import on_signals
from tsuiseki.tracking.runs.options import Output
from tsuiseki.tracking.types.live import CameraOutage, CameraState, Observer

if TYPE_CHECKING:
    from tsuiseki.tracking.video.source import Source

T = TypeVar("T")
OUTAGES_FILE = "outages.csv"
OUTAGE_COLUMNS = ("what", "from", "to", "seconds")
# Settings that say where a result goes, not what it is.
PLACES = ("out", "overwrite")
# Seconds by which the time of day may move against a clock that never falls before it counts as a jump.
JUMP = 1.0
# Gives, by the state of each camera, who gets the events of a run; its folder is there then.
Watch: TypeAlias = Callable[[Sequence[CameraState]], AbstractContextManager[Sequence[Observer]]]
# Bytes at the end of a file within which its last row lies.
TAIL = 65_536


def unwatched(_: Sequence[CameraState]) -> AbstractContextManager[Sequence[Observer]]:
    """Nobody gets the events."""
    return nullcontext(())


@pydantic_dataclass(frozen=True, kw_only=True, config=SETTINGS)
class LiveOptions(Options):
    """How long a live run goes on, and where its result goes meanwhile.

    Attributes:
        give_up: seconds without a picture that end a live run; by default it waits.
        roll: hours of each folder that a live run writes; by default at its end.
    """

    give_up: PositiveFloat | None = None
    roll: PositiveFloat | None = None

    def applied(self, source: Source) -> Source:
        """The source, waited for as these options say; raises RequestError where it is given up and not live."""
        if not source.live:
            if self.give_up is not None:
                raise RequestError(f"`give_up`: expected a live source, got {source.name}; leave it out")
            return source
        # It answered; what rolls waits where its first picture is late, too.
        changes: Any = {"give_up": self.give_up, "awaited": self.roll is not None}
        return replace(source, **changes)

    def opened(self, out: Path, open_cameras: Callable[[], T]) -> T:
        """What ``open_cameras`` gives; it is asked again where a camera is away and the run in ``out`` goes on.

        Raises:
            RequestError: as it does; an absent camera of a run that begins, or that is given up.
        """
        from tsuiseki.tracking.video.live import LONGEST_PAUSE, PAUSE

        begin, pause = time.monotonic(), PAUSE
        while True:
            try:
                return open_cameras()
            except AbsentCameraError as error:
                passed = time.monotonic() - begin
                if not (out / LIVE_FILE).is_file() or (self.give_up is not None and passed >= self.give_up):
                    raise
                if pause == PAUSE:
                    warnings.warn(f"{error} The run goes on when it is back", InputWarning, stacklevel=2)
            time.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)


class PartFile:
    """One table that rows are added to.

    Attributes:
        number: of the last frame in it, from 1; 0 for none.
        time: of that frame, seconds.
    """

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self.number, self.time = 0, 0.0
        self._file = path.open("ab+", buffering=0)
        self._first: int | None = None
        end = self._file.seek(0, 2)
        start = self._file.seek(max(0, end - TAIL))
        lines = self._file.read()
        whole = lines.rfind(b"\n") + 1
        self._file.truncate(start + whole)
        if not start + whole:
            self._file.write((",".join(columns) + "\n").encode())
        elif b"," in (last := lines[:whole].splitlines()[-1]) and last.split(b",")[0].isdigit():
            number, seconds = last.split(b",")[:2]
            self.number, self.time = int(number), float(seconds)

    def numbered(self, frame: int, seconds: float, rate: float) -> int:
        """The number in this table, from 1, of a frame of the run; a new one lies after those of earlier runs."""
        if self._first is None:
            passed = max(1, round((seconds - self.time) * rate)) if self.number else 1
            self._first = frame - self.number - passed + 1
        return frame - self._first + 1

    def add(self, rows: Sequence[Sequence[object]]) -> None:
        """Write rows at once."""
        self._file.write("".join(",".join(map(str, row)) + "\n" for row in rows).encode())

    def close(self) -> None:
        self._file.close()


class RollingFolder:
    """The folder that a run without end writes into.

    Args:
        output: of the run.
        hours: of each part.
        table: name of the file in each part, and its columns, of which the first are ``frame,time``.
        rate: frames a second.
        about: what is known of the source, for the record.

    Attributes:
        ids: the highest id so far.
        states: of the cameras, for the record.
        facts: further ones, for the record.
    """

    def __init__(
        self, output: Output, hours: float, table: tuple[str, Sequence[str]], rate: float, about: Mapping[str, Any]
    ) -> None:
        self.out, self.ids, self.states = output.out, 0, list[CameraState]()
        self._output, self._seconds, self._rate, self._about = output, 3600.0 * hours, rate, dict(about)
        self._name, self._columns = table
        self.facts = dict[str, Any]()
        self._settings = {name: value for name, value in output.settings.items() if name not in PLACES}
        self._part: PartFile | None = None
        self._key, self._last = "", 0.0
        self._clocks: tuple[float, float] | None = None
        self._asked = 0

    @contextmanager
    def opened(self) -> Iterator[RollingFolder]:
        """Within the ``with`` block it is written to; a first signal asks the run to stop, a second one ends it.

        Raises:
            RequestError: another run writes there, or it holds something else.
        """
        with ExitStack() as stack:
            earlier = self.out / LIVE_FILE
            goes_on = earlier.is_file() and self._is_ours(read_json(earlier, "the state of a live run"))
            if not goes_on:
                check_output_folder(self.out, self._output.overwrite)
            with writable(self.out):
                self.out.mkdir(parents=True, exist_ok=True)
            hold(self.out, BUSY.format(self.out), stack)
            if not goes_on:
                for name in listed_files(self.out):
                    (self.out / name).unlink(missing_ok=True)
            stack.enter_context(on_signals(self._hear))
            self._save()
            self._record("the run goes on")
            try:
                yield self
            finally:
                if self._part is not None:
                    self._part.close()
                self._record("")

    def _is_ours(self, content: Any) -> bool:
        ids, settings = (content.get(name) if isinstance(content, dict) else None for name in ("ids", "settings"))
        if not isinstance(ids, int) or isinstance(ids, bool) or ids < 0:
            raise RequestError(f"{self.out / LIVE_FILE}: expected the state of a live run, got something else")
        if settings != json.loads(json.dumps(self._settings, default=str)):
            return False
        self.ids = ids
        last = content.get("time")
        self._last = float(last) if isinstance(last, int | float) else 0.0
        return True

    def _hear(self, number: int) -> None:
        if self._asked:
            raise KeyboardInterrupt
        self._asked = number

    def stopped(self) -> bool:
        """Whether the user has asked the run to end."""
        return self._asked > 0

    def add(self, seconds: float, frame: int, ids: Sequence[int], rows: Callable[[int], list[list[object]]]) -> None:
        """Add the rows of one frame.

        Args:
            seconds: of the frame, since 1970.
            frame: its number in the run, from 0.
            ids: of the people in it.
            rows: of the frame, by the number that it has in its table.
        """
        part = self._part_at(seconds)
        if len(ids) and max(ids) > self.ids:
            # Before they are written: an id that was read is never given again.
            self.ids = int(max(ids))
            self._save(seconds)
        number = part.numbered(frame, seconds, self._rate)
        if lines := rows(number):
            part.add(lines)

    def outage(self, what: str, start: float, end: float, seconds: float) -> None:
        """Note that something did not run, or that the clock jumped, from one time of day to another."""
        part = PartFile(self.out / OUTAGES_FILE, OUTAGE_COLUMNS)
        part.add([[what.replace(",", " "), f"{start:.3f}", f"{end:.3f}", f"{seconds:.3f}"]])
        part.close()

    def camera_outage(self, event: CameraOutage) -> None:
        """Note that a camera is back."""
        if event.seconds is not None:
            self.outage(event.name, event.time - event.seconds, event.time, event.seconds)

    def check_clock(self, wall: float, monotonic: float) -> None:
        """Note a jump of the time of day since the last call, and how long nothing ran before the first one."""
        if self._clocks is None:
            if self._last:
                self.outage("the run", self._last, wall, wall - self._last)
        else:
            jump = (wall - self._clocks[0]) - (monotonic - self._clocks[1])
            if abs(jump) > JUMP:
                self.outage("the clock", wall - jump, wall, jump)
        self._clocks = wall, monotonic

    def _part_at(self, seconds: float) -> PartFile:
        key = time.strftime("%Y-%m-%dT%H-%MZ", time.gmtime(seconds // self._seconds * self._seconds))
        if self._part is None or key != self._key:
            if self._part is not None:
                self._part.close()
            self._key, self._part = key, PartFile(self.out / key / self._name, self._columns)
            self._save(seconds)
            self._record("the run goes on")
        return self._part

    def _save(self, seconds: float | None = None) -> None:
        self._last = self._last if seconds is None else seconds
        with whole_file(self.out / LIVE_FILE) as file:
            values = {"ids": self.ids, "time": self._last, "settings": self._settings}
            file.write(json.dumps(values, default=str).encode())

    def _record(self, reason: str) -> None:
        record = RunRecord(self._output.command, self._output.settings, int(self._output.settings.get("seed", 0)))
        record.partial, record.reason = bool(reason), reason
        record.facts = self.facts | {"ids": self.ids, "cameras": [asdict(state) for state in self.states]}
        parts = sorted(path.parent.name for path in self.out.glob(f"*/{self._name}"))
        record.results = dict.fromkeys(parts, self._about)
        record.write(self.out)
