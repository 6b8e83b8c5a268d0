"""Cameras on loopback that show what a plan says for each moment, pictures that say their number, and who read it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from socket import AF_INET, SO_REUSEADDR, SOCK_STREAM, SOL_SOCKET, socket

import cv2
import numpy as np

from tsuiseki.tracking.types import ImageArray

HEAD = b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=next\r\n\r\n"
# Pixels of a block's side that survives JPEG.
BLOCK = 8
# Blocks of a number, and of it and the camera's.
DIGITS, BLOCKS = 12, 15


def numbered(image: ImageArray, number: int, camera: int = 0) -> ImageArray:
    """A picture with its number and that of its camera in the upper left corner, black and white."""
    bits = (number | camera << DIGITS) >> np.arange(BLOCKS) & 1
    image = image.copy()
    image[:BLOCK, : BLOCK * BLOCKS] = np.repeat(255 * bits, BLOCK).astype(np.uint8)[None, :, None]
    return image


def number_of(image: ImageArray) -> tuple[int, int]:
    """The number of a picture and of its camera."""
    blocks = image[:BLOCK, : BLOCK * BLOCKS].reshape(BLOCK, BLOCKS, BLOCK, 3).mean(axis=(0, 2, 3))
    code = int((blocks > 128) @ (1 << np.arange(BLOCKS)))
    return code % (1 << DIGITS), code >> DIGITS


def jpeg(image: ImageArray) -> bytes:
    return cv2.imencode(".jpg", image[..., ::-1])[1].tobytes()


@dataclass
class Beginning:
    """From when on pictures move: all cameras are read by then."""

    waiting: int
    at: float | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def arrive(self) -> None:
        with self._lock:
            self.waiting -= 1
            if not self.waiting:
                self.at = time.monotonic()

    @property
    def seconds(self) -> float:
        return 0.0 if self.at is None else time.monotonic() - self.at


class PlannedCamera:
    """A camera's server on loopback.

    Args:
        beginning: shared by the cameras of a place.
        shows: the picture, as JPEG, of so many seconds after the beginning; None where the camera is away.
        rate: pictures a second.
        noise: what is sent between two pictures; by the number of the picture.
    """

    def __init__(
        self,
        beginning: Beginning,
        shows: Callable[[float], bytes | None],
        rate: float,
        noise: Callable[[int], bytes] = lambda _: b"",
    ) -> None:
        self.beginning, self.shows, self.rate, self.noise = beginning, shows, rate, noise
        self.connections, self.over = 0, threading.Event()
        # When pictures were sent, seconds since 1970.
        self.sent: list[float] = []
        self.listening = socket(AF_INET, SOCK_STREAM)
        self.listening.setsockopt(SOL_SOCKET, SO_REUSEADDR, 1)
        self.listening.bind(("127.0.0.1", 0))
        self.listening.listen()
        self.address = f"http://127.0.0.1:{self.listening.getsockname()[1]}/camera.mjpg"
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while not self.over.is_set():
            try:
                there, _ = self.listening.accept()
            except OSError:
                return
            # The first one asks whether there is a camera, the second one reads it.
            self.connections += 1
            if self.connections == 2:
                self.beginning.arrive()
            threading.Thread(target=self._send, args=(there,), daemon=True).start()

    def _send(self, there: socket) -> None:
        with there, suppress(OSError):
            there.recv(4096)
            there.sendall(HEAD)
            while not self.over.is_set() and (data := self.shown) is not None:
                head = b"--next\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(data)
                there.sendall(self.noise(len(self.sent)) + head + data + b"\r\n")
                self.sent.append(time.time())
                self.over.wait(1 / self.rate)

    @property
    def shown(self) -> bytes | None:
        """What it shows now."""
        return self.shows(self.beginning.seconds)

    def close(self) -> None:
        self.over.set()
        self.listening.close()


@dataclass(frozen=True)
class LabelReader:
    """Detects and describes by the labels of the picture that a number names.

    Attributes:
        boxes: by camera and number, ``(N, 4)``.
        ids: likewise, ``(N,)``, which begin at 1.
    """

    boxes: Sequence[Sequence[np.ndarray]]
    ids: Sequence[Sequence[np.ndarray]]

    def __call__(self, image: ImageArray) -> np.ndarray:
        number, camera = number_of(image)
        boxes = self.boxes[camera][number]
        return np.column_stack([boxes, np.full(len(boxes), 0.9)])

    def describe(self, image: ImageArray, boxes: np.ndarray) -> np.ndarray:
        """A direction for each person."""
        features = np.zeros((len(boxes), 16))
        features[np.arange(len(boxes)), self.nearest(image, boxes)] = 1.0
        return features

    def nearest(self, image: ImageArray, boxes: np.ndarray) -> np.ndarray:
        """``(N,)`` id of the person whose box lies next to each of these."""
        number, camera = number_of(image)
        apart = np.abs(boxes[:, None] - self.boxes[camera][number][None]).sum(axis=2)
        return self.ids[camera][number][apart.argmin(axis=1)]
