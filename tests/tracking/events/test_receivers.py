"""Who takes events: addresses, a broker of MQTT, and events as a table."""

from __future__ import annotations

import asyncio
import csv
import json
import socket
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.tracking.events.test_delivery import delivering, event
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.events.event import Event
from tsuiseki.tracking.events.receivers import TOPIC, Http, Lines, LinesInFile, Mqtt, receiver_of
from tsuiseki.tracking.events.table import read_events


@pytest.mark.parametrize(
    ("address", "kind"),
    [("-", Lines), ("http://h:8080/x", Http), ("https://h/x", Http), ("mqtt://h/a/b", Mqtt), ("mqtts://h", Mqtt)],
)
def test_an_address_names_its_receiver(address: str, kind: type) -> None:
    assert isinstance(receiver_of(address), kind)


def test_a_name_without_a_scheme_is_a_file(tmp_path: Path) -> None:
    receiver = receiver_of(str(tmp_path / "new/events.jsonl"))
    assert isinstance(receiver, LinesInFile)
    receiver.close()


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("ftp://h/x", "got ftp://h/x"),
        ("http://", "got http://"),
        ("http://u:secret@h:99999/x", "got http://h:99999/x"),
        ("mqtt://h/a/#", "a topic without + and #, got mqtt://h/a/#"),
    ],
)
def test_an_address_of_another_kind_is_refused_in_a_line(address: str, words: str) -> None:
    with pytest.raises(RequestError) as caught:
        receiver_of(address)
    assert str(caught.value).startswith("`events`: expected ")
    assert str(caught.value).endswith(words)


def test_a_file_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for path in (tmp_path, tmp_path / "file/events"):
        with pytest.raises(RequestError, match="cannot write"):
            receiver_of(str(path))


def test_without_paho_mqtt_a_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "paho.mqtt", None)
    with pytest.raises(RequestError, match=r"pip install 'tsuiseki\[events\]'"):
        receiver_of("mqtt://h")


class Broker:
    """A broker of MQTT on a port of this computer, and what a subscriber to all of it gets.

    Attributes:
        messages: topic and text of each message that came.
    """

    def __init__(self, for_anybody: bool = True) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = int(free.getsockname()[1])
        self.messages: list[tuple[str, str]] = []
        self._open = for_anybody
        self._up, self._loop = threading.Event(), asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_until_complete, args=(self._serve(),), daemon=True)
        self._thread.start()
        assert self._up.wait(20)

    async def _serve(self) -> None:
        from amqtt.broker import Broker as AmqttBroker
        from amqtt.client import MQTTClient

        self._end = asyncio.Event()
        broker = AmqttBroker(
            {
                "listeners": {"default": {"type": "tcp", "bind": f"127.0.0.1:{self.port}"}},
                "plugins": {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": self._open}},
            }
        )
        await broker.start()
        subscriber = None
        if self._open:
            subscriber = MQTTClient(config={"auto_reconnect": False})
            await subscriber.connect(f"mqtt://127.0.0.1:{self.port}/")
            await subscriber.subscribe([("#", 1)])
        self._up.set()
        while not self._end.is_set():
            if subscriber is None:
                await self._end.wait()
                continue
            try:
                message = await subscriber.deliver_message(timeout_duration=0.2)
            except TimeoutError:
                continue
            if message is not None:
                self.messages.append((message.topic, bytes(message.data).decode()))
        if subscriber is not None:
            await subscriber.disconnect()
        await broker.shutdown()

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(10)


@pytest.fixture
def broker() -> Iterator[Broker]:
    pytest.importorskip("amqtt", reason="no amqtt; install the extra dev")
    broker = Broker()
    yield broker
    broker.close()


def test_a_broker_gets_each_event_as_a_message(broker: Broker, tmp_path: Path) -> None:
    with delivering(Mqtt(f"mqtt://127.0.0.1:{broker.port}/site/gate"), tmp_path / "spool") as delivery:
        for number in range(250):
            delivery.put([event(number)])
    broker.close()
    assert {topic for topic, _ in broker.messages} == {"site/gate"}
    assert [json.loads(text)["id"] for _, text in broker.messages] == [event(n).id for n in range(250)]


def test_a_broker_that_is_not_there_or_refuses_is_a_line() -> None:
    pytest.importorskip("amqtt", reason="no amqtt; install the extra dev")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        receiver = Mqtt(f"mqtt://127.0.0.1:{free.getsockname()[1]}")
        with pytest.raises(ConnectionRefusedError):
            receiver.send(["{}"])
    refusing = Broker(for_anybody=False)
    try:
        with pytest.raises(OSError, match="it answers: "):
            Mqtt(f"mqtt://127.0.0.1:{refusing.port}").send(["{}"])
    finally:
        refusing.close()
    assert Mqtt("mqtt://h")._topic == TOPIC


def test_events_become_a_table_without_doubles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    crossed = {"frame": 3, "seconds": 0.2, "person": 7, "box": [1, 2, 3, 4], "line": "door", "direction": "in"}
    events = [Event("a-1", "Tor ü", "crossed", crossed, 1e9), event(2), event(2)]
    path = tmp_path / "events.jsonl"
    path.write_text("".join(e.line + "\n" for e in events) + '{"specv', encoding="utf-8")
    with pytest.warns(InputWarning, match="last line breaks off"):
        assert [row["id"] for row in read_events(path)] == ["a-1", "run-2"]
    assert main(["convert", str(path), "--to", "csv", "--out", str(tmp_path / "t.csv")]) == 0
    assert "2 events: " in capsys.readouterr().out
    first, second = csv.DictReader((tmp_path / "t.csv").read_text(encoding="utf-8").splitlines())
    assert (first["camera"], first["type"], first["line"], first["x2"]) == ("Tor ü", "crossed", "door", "3")
    assert (first["time"], second["gap"], second["line"]) == ("2001-09-09T01:46:40.000Z", "2.0", "")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("events:1", "events:2"), ":2: expected events of urn:tsuiseki:events:1, got urn:tsuiseki:events:2"),
        (
            ("tsuiseki.camera_back", "tsuiseki.waved"),
            ":2: expected events of tsuiseki, a line each, got another object",
        ),
        (('"data":', '"date":'), ":2: expected events of tsuiseki, a line each, got another object"),
        (('"data":', '"data"'), ":2: expected events of tsuiseki, a line each, got no JSON"),
    ],
)
def test_a_line_that_is_no_event_of_this_version_is_refused(
    change: tuple[str, str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "events.jsonl"
    path.write_text(f"{event(1).line}\n{event(2).line.replace(*change)}\n")
    assert main(["convert", str(path), "--to", "csv", "--out", str(tmp_path / "t.csv")]) == 2
    line = capsys.readouterr().err
    assert words in line
    assert line.count("\n") == 1
    assert not (tmp_path / "t.csv").exists()


def test_events_go_into_csv_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "events.jsonl"
    path.write_text(event(1).line + "\n")
    assert main(["convert", str(path), "--to", "coco", "--out", str(tmp_path / "t.json")]) == 2
    assert "events go into csv" in capsys.readouterr().err
