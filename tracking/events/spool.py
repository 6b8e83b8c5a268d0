"""Events that wait for their receiver: on disk, where they outlive the process, or in memory.

SQLite keeps them, in its write-ahead log: what was put stays through a kill of the process. A commit is not waited for
on the disk, so that a loss of power may take the last ones. Where the disk refuses more, they wait in memory until it
takes them again. Both are bounded: the oldest go first.
"""

from __future__ import annotations

import sqlite3
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from pathlib import Path

# Events on disk: about 100 MB, or half a day of ten people that move.
MOST_ON_DISK = 250_000
# Events in memory: about 10 MB.
MOST_IN_MEMORY = 20_000
# Seconds that one process waits for another's transaction.
BUSY = 2.0
# Seconds after which a disk that refused is asked again.
AGAIN = 1.0


class Spool:
    """A queue of lines, in the order in which they were put; any thread may use it.

    Args:
        path: of the file; None for memory alone.
        complain: gets a line where the disk refuses events, and where it takes them again.
        most: lines that wait on disk.
        most_in_memory: lines that wait in memory.
    """

    def __init__(
        self,
        path: Path | None,
        complain: Callable[[str], object],
        most: int = MOST_ON_DISK,
        most_in_memory: int = MOST_IN_MEMORY,
    ) -> None:
        self.path, self._complain, self._most, self._most_in_memory = path, complain, most, most_in_memory
        self._lock = threading.Lock()
        self._memory: deque[str] = deque()
        self._refused, self._dropped, self._asked_again = False, 0, 0.0
        # Numbers of rows: the last one that was received, and how many wait.
        self._received, self._on_disk = 0, 0
        self._database = None if path is None else self._opened(path)

    def __len__(self) -> int:
        with self._lock:
            return self._on_disk + len(self._memory)

    def put(self, lines: Sequence[str]) -> int:
        """Add lines; returns how many of the oldest had to go for them."""
        with self._lock:
            self._memory.extend(lines)
            self._move_to_disk()
            dropped = max(0, len(self._memory) - self._most_in_memory)
            for _ in range(dropped):
                self._memory.popleft()
            dropped, self._dropped = dropped + self._dropped, 0
            return dropped

    def first(self, count: int) -> list[str]:
        """The oldest lines, up to so many; they stay until they are received."""
        with self._lock:
            if self._database is not None and self._on_disk:
                query = "SELECT line FROM events WHERE number > ? ORDER BY number LIMIT ?"
                return [line for (line,) in self._database.execute(query, (self._received, count))]
            return [*self._memory][:count]

    def remove(self, count: int) -> None:
        """So many of the oldest lines are received."""
        with self._lock:
            if self._database is None or not self._on_disk:
                for _ in range(min(count, len(self._memory))):
                    self._memory.popleft()
                return
            query = "SELECT max(number) FROM (SELECT number FROM events WHERE number > ? ORDER BY number LIMIT ?)"
            (self._received,) = self._database.execute(query, (self._received, count)).fetchone()
            self._on_disk = max(0, self._on_disk - count)
            # Where the disk is too full even for that, they are passed over until it is not.
            with suppress(sqlite3.Error), self._database:
                self._database.execute("DELETE FROM events WHERE number <= ?", (self._received,))
            self._move_to_disk()

    def close(self) -> None:
        """Nothing is put any more; an empty file is removed."""
        with self._lock:
            if self._database is None or self.path is None:
                return
            self._asked_again = 0.0
            self._move_to_disk()
            with suppress(sqlite3.Error):
                self._database.close()
            if not self._on_disk and not self._memory:
                for suffix in ("", "-wal", "-shm"):
                    self.path.with_name(self.path.name + suffix).unlink(missing_ok=True)

    def _opened(self, path: Path) -> sqlite3.Connection | None:
        """The database, with what an earlier run has left in it; None where there can be none."""
        for attempt in ("first", "anew"):
            try:
                database = sqlite3.connect(path, timeout=BUSY, check_same_thread=False)
                database.execute("PRAGMA journal_mode = WAL")
                database.execute("PRAGMA synchronous = NORMAL")
                database.execute(
                    "CREATE TABLE IF NOT EXISTS events (number INTEGER PRIMARY KEY AUTOINCREMENT, line TEXT)"
                )
                with closing(database.execute("SELECT count(*) FROM events")) as rows:
                    (self._on_disk,) = rows.fetchone()
                return database
            except sqlite3.OperationalError as error:
                self._refuse(error)
                return None
            except sqlite3.DatabaseError:
                if attempt == "anew":
                    raise
                self._complain(f"note: {path} is no spool of events; it is kept as {path.name}.broken")
                path.replace(path.with_name(f"{path.name}.broken"))
        return None

    def _move_to_disk(self) -> None:
        """Put what waits in memory on disk, as far as that takes it."""
        if self._database is None or not self._memory or time.monotonic() < self._asked_again:
            return
        excess = max(0, self._on_disk + len(self._memory) - self._most)
        oldest = (
            "DELETE FROM events WHERE number IN (SELECT number FROM events WHERE number > ? ORDER BY number LIMIT ?)"
        )
        try:
            with self._database:
                self._database.executemany("INSERT INTO events (line) VALUES (?)", [(line,) for line in self._memory])
                if excess:
                    self._database.execute(oldest, (self._received, excess))
        except sqlite3.Error as error:
            self._refuse(error)
            return
        self._on_disk += len(self._memory) - excess
        self._dropped += excess
        self._memory.clear()
        if self._refused:
            self._refused = False
            self._complain("note: the disk takes events again")

    def _refuse(self, error: sqlite3.Error) -> None:
        self._asked_again = time.monotonic() + AGAIN
        if not self._refused:
            self._refused = True
            most = f"up to {self._most_in_memory} wait in memory, the oldest go first; make room"
            self._complain(f"note: the spool of events {self.path} cannot be written ({error}); {most}")
