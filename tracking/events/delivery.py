"""Events on their way: they wait in a spool, and a thread sends them in order, again and again until received.

After a failure it pauses, each time twice as long, up to `LONGEST_PAUSE`. One line says that a receiver refuses, and
another that it takes events again; the run goes on meanwhile.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from tsuiseki.tracking.events.event import Event
from tsuiseki.tracking.events.receivers import Receiver
from tsuiseki.tracking.events.spool import Spool

# Events that are sent together.
BATCH = 200
# Seconds before the first attempt to send again.
PAUSE = 0.5
# Seconds before every later one at most.
LONGEST_PAUSE = 30.0
# Seconds that the end of a run waits for events to be received.
GOODBYE = 10.0


class Delivery:
    """Sends events to a receiver; `put` neither fails nor waits.

    Args:
        receiver: who gets them.
        spool: file in which they wait, where the receiver is one that they wait on disk for.
        new_id: gives the id of the event that says that others were dropped.
        complain: gets a line where something goes wrong, and where it is right again.
        goodbye: seconds that `close` waits.
    """

    def __init__(
        self,
        receiver: Receiver,
        spool: Path,
        new_id: Callable[[], str],
        complain: Callable[[str], object],
        goodbye: float = GOODBYE,
    ) -> None:
        self._receiver, self._new_id, self._complain, self._goodbye = receiver, new_id, complain, goodbye
        self.spool = Spool(spool if receiver.spooled else None, complain)
        self._awake, self._ended, self._deadline = threading.Event(), threading.Event(), float("inf")
        self._gone = False
        self._thread = threading.Thread(target=self._run, name="tsuiseki-events", daemon=True)
        self._thread.start()

    def put(self, events: Sequence[Event]) -> None:
        """Take events to send."""
        if self._gone or not events:
            return
        if dropped := self.spool.put([event.line for event in events]):
            self.spool.put([Event(self._new_id(), "", "dropped", {"events": dropped}, time.time()).line])
        self._awake.set()

    def close(self) -> None:
        """Send what waits, for a bounded time; what remains on disk is sent by the next run into the same folder."""
        self._deadline = time.monotonic() + self._goodbye
        self._ended.set()
        self._awake.set()
        self._thread.join(self._goodbye)
        if remaining := len(self.spool):
            place = f"in {self.spool.path}; the same command sends them" if self.spool.path else "and are lost"
            self._complain(f"note: {remaining} events were not received by {self._receiver.name}, {place}")
        self.spool.close()

    def _run(self) -> None:
        failures, pause = 0, PAUSE
        while time.monotonic() < self._deadline:
            lines = self.spool.first(BATCH)
            if not lines:
                if self._ended.is_set():
                    break
                self._awake.wait()
                self._awake.clear()
                continue
            try:
                self._receiver.send(lines)
            except OSError as error:
                if isinstance(error, BrokenPipeError) and not self._receiver.spooled:
                    self._complain("note: nobody reads the events any more; they end")
                    self._gone = True
                    self.spool.remove(len(self.spool))
                    break
                if not failures:
                    self._complain(f"note: {self._receiver.name} does not take events ({reason_of(error)}); they wait")
                failures += 1
                self._ended.wait(min(pause, max(0.0, self._deadline - time.monotonic())))
                if self._ended.is_set():
                    time.sleep(min(PAUSE, self._goodbye / 10))
                pause = min(2 * pause, LONGEST_PAUSE)
                continue
            self.spool.remove(len(lines))
            if failures:
                self._complain(f"note: {self._receiver.name} takes events again")
            failures, pause = 0, PAUSE
        self._receiver.close()


def reason_of(error: OSError) -> str:
    """What went wrong with a connection, in short."""
    # Libraries wrap the cause, and speak of objects of theirs.
    inner: BaseException | None = error
    while inner is not None:
        if isinstance(inner, OSError) and inner.strerror:
            return inner.strerror
        inner = inner.__cause__ or inner.__context__
    return " ".join(str(error).split())[:200] or type(error).__name__
