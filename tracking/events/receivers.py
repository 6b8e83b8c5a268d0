"""Who takes events: a stream or file of lines, a server by HTTP, a broker of MQTT.

Each has one method, ``send(lines)``, which returns when all of them are received and raises OSError where they may not
be; they come again then. So each line is received at least once.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Protocol
from urllib.parse import unquote, urlsplit

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.events.event import public_name

if TYPE_CHECKING:
    from paho.mqtt.client import Client

# The program's output, whatever `sys.stdout` stands for.
STDOUT = 1
# Seconds to connect.
CONNECT = 5.0
# Seconds to wait for an answer.
ANSWER = 15.0
# What the lines are called in HTTP.
NDJSON = "application/x-ndjson"
# Of messages, where the address has none.
TOPIC = "tsuiseki/events"
# Of MQTT: each message is acknowledged, and may come twice.
AT_LEAST_ONCE = 1
# Registered ports, where the address has none.
MQTT_PORTS = {"mqtt": 1883, "mqtts": 8883}


class Receiver(Protocol):
    """Takes lines of events.

    Attributes:
        name: for people to read, without passwords.
        spooled: whether lines wait on disk for it.
    """

    name: str
    spooled: bool

    def send(self, lines: Sequence[str]) -> None:
        """Send lines; raises OSError where they may not all be received."""

    def close(self) -> None:
        """Let go of it."""


def receiver_of(address: str) -> Receiver:
    """The receiver that ``-``, a file's name or an address names; it is not asked yet.

    Raises:
        RequestError: the address is of another kind or incomplete, a package is missing, or the file cannot be written.
    """
    scheme = address.partition("://")[0] if "://" in address else ""
    if address == "-":
        return Lines(open(STDOUT, "wb", buffering=0, closefd=False))
    if not scheme:
        return LinesInFile(Path(address))
    try:
        parts = urlsplit(address)
        complete = bool(parts.hostname) and parts.port != 0
    except ValueError:
        complete = False
    if scheme not in ("http", "https", *MQTT_PORTS) or not complete:
        expected = "-, a file, or an address http://…, https://…, mqtt://… or mqtts://…"
        raise RequestError(f"`events`: expected {expected}, got {public_name(address)}")
    return Http(address) if scheme in ("http", "https") else Mqtt(address)


class Lines:
    """Writes lines to a stream, such as that of the program."""

    spooled = False

    def __init__(self, stream: IO[bytes], name: str = "-") -> None:
        self.name, self._stream = name, stream

    def send(self, lines: Sequence[str]) -> None:
        """Write lines; raises OSError where that fails."""
        text = memoryview(_joined(lines))
        while text:
            text = text[self._stream.write(text) :]

    def close(self) -> None:
        """The stream stays open: it is the program's."""


class LinesInFile:
    """Appends lines to a file; half a line of a process that was killed is cut off.

    Raises:
        RequestError: the file cannot be written.
    """

    spooled = False

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._number = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
            self._size = whole_lines(self._number)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise RequestError(f"`events`: cannot write {path}: {reason}; choose another file") from error

    def send(self, lines: Sequence[str]) -> None:
        """Write lines, or nothing of them; raises OSError then."""
        text = memoryview(_joined(lines))
        try:
            written = 0
            while written < len(text):
                written += os.pwrite(self._number, text[written:], self._size + written)
            self._size += written
        except OSError:
            with suppress(OSError):
                os.ftruncate(self._number, self._size)
            raise

    def close(self) -> None:
        """Nothing is added to the file any more."""
        os.close(self._number)


def whole_lines(number: int) -> int:
    """Bytes up to the end of the last whole line of an open file, where it is cut."""
    size = end = os.fstat(number).st_size
    while end > 0:
        start = max(0, end - 4096)
        newline = os.pread(number, end - start, start).rfind(b"\n")
        if newline >= 0:
            end = start + newline + 1
            break
        end = start
    if end < size:
        os.ftruncate(number, end)
    return end


class Http:
    """Posts lines to a server, as newline-delimited JSON; any status of 200 to 299 says that it has them."""

    spooled = True

    def __init__(self, address: str) -> None:
        import requests

        self.name, self._address, self._session = public_name(address), address, requests.Session()

    def send(self, lines: Sequence[str]) -> None:
        """Post lines; raises OSError where no answer comes, or one that is no success."""
        answer = self._session.post(
            self._address,
            data=_joined(lines),
            headers={"Content-Type": NDJSON},
            timeout=(CONNECT, ANSWER),
            allow_redirects=False,
        )
        if not 200 <= answer.status_code < 300:
            raise OSError(f"it answers {answer.status_code} {answer.reason}".rstrip())

    def close(self) -> None:
        """Close the connection."""
        self._session.close()


class Mqtt:
    """Publishes each line as a message that the broker acknowledges; the topic is the path of the address.

    Raises:
        RequestError: paho-mqtt is not installed, or the topic is none to publish to.
    """

    spooled = True

    def __init__(self, address: str) -> None:
        try:
            from paho.mqtt import client
        except ImportError as error:
            raise RequestError("mqtt needs paho-mqtt; install the extra: pip install 'tsuiseki[events]'") from error
        parts = urlsplit(address)
        self.name, self._paho, self._parts = public_name(address), client, parts
        self._client: Client | None = None
        self._topic = unquote(parts.path.strip("/")) or TOPIC
        if {"+", "#"} & {*self._topic, *address}:
            raise RequestError(f"`events`: expected a topic without + and #, got {self.name}")

    def send(self, lines: Sequence[str]) -> None:
        """Publish lines; raises OSError where the broker does not acknowledge all of them in time."""
        try:
            client = self._client = self._client or self._connected()
            messages = [client.publish(self._topic, line.encode(), qos=AT_LEAST_ONCE) for line in lines]
            for message in messages:
                message.wait_for_publish(ANSWER)
                if not message.is_published():
                    raise TimeoutError("it does not acknowledge what it gets")
        except (OSError, RuntimeError, ValueError) as error:
            # What it has not acknowledged comes again, by a new connection.
            self.close()
            raise error if isinstance(error, OSError) else OSError(str(error)) from error

    def close(self) -> None:
        """Close the connection."""
        client, self._client = self._client, None
        if client is not None:
            client.disconnect()
            client.loop_stop()

    def _connected(self) -> Client:
        """A connection that the broker has accepted."""
        import threading

        from paho.mqtt.enums import CallbackAPIVersion

        parts, answered, refusals = self._parts, threading.Event(), list[str]()
        client = self._paho.Client(CallbackAPIVersion.VERSION2)

        def hear(_client: object, _data: object, _flags: object, reason: object, _properties: object) -> None:
            if getattr(reason, "is_failure", False):
                refusals.append(str(reason))
            answered.set()

        client.on_connect = hear
        client.connect_timeout = CONNECT
        if parts.username is not None:
            client.username_pw_set(unquote(parts.username), None if parts.password is None else unquote(parts.password))
        if parts.scheme == "mqtts":
            client.tls_set()
        client.connect(parts.hostname or "", parts.port or MQTT_PORTS[parts.scheme])
        client.loop_start()
        if not answered.wait(ANSWER) or refusals:
            client.disconnect()
            client.loop_stop()
            raise ConnectionError(f"it answers: {refusals[0]}" if refusals else "it does not answer")
        return client


def _joined(lines: Sequence[str]) -> bytes:
    return "".join(f"{line}\n" for line in lines).encode()
