"""Networks of other projects that `tsuiseki models get` fetches: where they lie, and under which terms.

The table names files; none of them is part of the toolkit. A sum stands here only where several projects independently
state it for the file at that address. Without one, the sum of the first download is kept, and later ones must agree.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError, hint_at
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.output import whole_file

OBJECTS365 = "Objects365, under the terms of its site"
COCO = "COCO train2017: annotations CC BY 4.0, pictures under the terms of their photographers on Flickr"
_YOLOX = "https://github.com/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0"
_MMPOSE = "https://download.openmmlab.com/mmpose/v1/projects/rtmposev1/onnx_sdk"
_ONNX_COMMUNITY = "https://huggingface.co/onnx-community"
_ZOO = "https://github.com/opencv/opencv_zoo/raw/main/models"


@dataclass(frozen=True)
class CatalogueModel:
    """A network that can be fetched.

    Attributes:
        name: for ``--detector`` or ``--appearance``.
        kind: detector or appearance.
        version: of the project's release, or the revision of the file.
        address: of an ONNX file, or of a zip archive with one.
        licence: of code and weights, as the project states it.
        data: what it learnt from, and the terms of that.
        sha256: of what lies at the address; empty where none is known.
        size: likewise, bytes; 0 where it is not known.
        options: what the file does not tell, by the names of `DetectorOptions`.
    """

    name: str
    kind: str
    version: str
    address: str
    licence: str
    data: str
    sha256: str = ""
    size: int = 0
    options: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        """All that one may want to know before it is fetched, a line each."""
        size = f"{self.size / 1e6:.1f} MB" if self.size else "size not known"
        rows = {
            "address": f"{self.address} ({size})",
            "sha256": self.sha256 or "not known; that of the first download is kept, and later ones must agree",
            "licence": f"{self.licence}, by the project's own statement",
            "learnt from": self.data,
        }
        head = f"{self.name}: {self.kind}, {self.version}{', downloaded' if self.file.is_file() else ''}"
        return "\n".join([head, *(f"  {name:11}  {text}" for name, text in rows.items())])

    @property
    def file(self) -> Path:
        """Where the ONNX file lies, or will."""
        return cache_folder() / f"{self.name}.onnx"

    def record(self) -> dict[str, Any]:
        """What was kept at the download, ``sha256`` of the address and ``file_sha256`` of the ONNX; empty before."""
        try:
            entry = read_json(self.file.with_suffix(".json"), "the record of a download")
        except RequestError:
            return {}
        same = isinstance(entry, dict) and (entry.get("address"), entry.get("version")) == (self.address, self.version)
        return entry if same else {}

    def keep(self, sha256: str) -> None:
        """Write the record of a download whose ONNX file is in its place."""
        entry = {**asdict(self), "sha256": sha256, "file_sha256": file_sum(self.file)}
        with whole_file(self.file.with_suffix(".json")) as file:
            file.write(json.dumps(entry, indent=1).encode() + b"\n")

    def checked(self) -> Path:
        """The ONNX file.

        Raises:
            RequestError: it is not there, or is not what was downloaded.
        """
        again = f"give `tsuiseki models get {self.name}`"
        if not self.file.is_file():
            raise RequestError(f"{self.name} is in the catalogue, but not yet downloaded; {again}")
        packed = self.address.endswith(".zip")
        expected = (not packed and self.sha256) or self.record().get("file_sha256", "of a download that is on record")
        if (got := file_sum(self.file)) != expected:
            raise RequestError(f"{self.file}: expected sha256 {expected}, got {got}; {again} to fetch it anew")
        return self.file


def _yolox(size: str, sha256: str = "", count: int = 0) -> CatalogueModel:
    address = f"{_YOLOX}/yolox_{size}.onnx"
    return CatalogueModel(f"yolox-{size}", "detector", "0.1.1rc0", address, "Apache-2.0", COCO, sha256, count)


def _community(name: str, folder: str, revision: str, sha256: str, size: int, data: str = COCO) -> CatalogueModel:
    address = f"{_ONNX_COMMUNITY}/{folder}/resolve/{revision}/onnx/model.onnx"
    return CatalogueModel(name, "detector", revision[:8], address, "Apache-2.0", data, sha256, size)


def _rtmdet(size: str, file: str) -> CatalogueModel:
    data = f"{COCO}; {OBJECTS365}"
    address, options = f"{_MMPOSE}/{file}.zip", {"person": 0}
    return CatalogueModel(f"rtmdet-{size}", "detector", "rtmposev1", address, "Apache-2.0", data, options=options)


# Networks by other projects that are known to load; sizes in bytes.
CATALOGUE: tuple[CatalogueModel, ...] = (
    _yolox("nano", "c789161ed43c8269fcd4e67c67eeeb4e80c622da2eb296a20bc6007bd18a0b7d", 3_659_407),
    _yolox("tiny", "427cc366d34e27ff7a03e2899b5e3671425c262ea2291f88bb942bc1cc70b0f7", 20_219_662),
    _yolox("s", "c5c2d13e59ae883e6af3b45daea64af4833a4951c92d116ec270d9ddbe998063", 35_858_002),
    _yolox("m"),
    _yolox("l"),
    _yolox("x"),
    _rtmdet("nano", "rtmdet_nano_8xb32-100e_coco-obj365-person-05d8511e"),
    _rtmdet("m", "rtmdet_m_8xb32-100e_coco-obj365-person-235e8209"),
    _community(
        "d-fine-n",
        "dfine_n_coco-ONNX",
        "380d2839c327efaf65dd0fe0c2c10ab7fadd5473",
        "0f684f409618ee8a822410e754a29caa817d1aa16283ce89cad936d0a48e2f35",
        15_258_358,
    ),
    _community(
        "d-fine-s",
        "dfine_s_coco-ONNX",
        "a3cf03147a9b86c78475139115c8ac142577352d",
        "cd8a49a945feda6d28c6304ae8ae85c2759ba1d78a5a83a22c5ce8db82ef7238",
        41_535_197,
    ),
    _community(
        "rf-detr-nano",
        "rfdetr_nano-ONNX",
        "eae21cee0687a91bcf9fa071605c48d7705d2d91",
        "9cbac6b11ce34a03034e4d5a24cfac5f18632fd6761d1311dd640232088d7fee",
        108_074_865,
        f"{COCO}; {OBJECTS365}; the pictures of DINOv2, not published",
    ),
    CatalogueModel(
        "osnet-x1-0",
        "appearance",
        "nnio, op10",
        "https://github.com/FastSense/nnio/raw/master/models/person-reid/osnet_x1_0/osnet_x1_0_op10.onnx",
        "MIT (Torchreid)",
        "people of a re-identification set that the file does not name; all of these are for research only",
    ),
    CatalogueModel(
        "youtu-reid",
        "appearance",
        "2021nov",
        f"{_ZOO}/person_reid_youtureid/person_reid_youtu_2021nov.onnx",
        "Apache-2.0",
        "not published by the project",
        "0579683334d4b9440221606dcb461656dd0dc64143b18f48faedaced9b4f580d",
        106_878_407,
    ),
)


def cache_folder() -> Path:
    """Where downloads are kept: ``models`` in ``$TSUISEKI_CACHE``, by default in the system's place for caches."""
    from platformdirs import user_cache_path

    return Path(os.environ.get("TSUISEKI_CACHE") or user_cache_path("tsuiseki", appauthor=False)) / "models"


def find_model(name: str, kind: str = "") -> CatalogueModel | None:
    """The entry of that name, of that kind where one is given; None where there is none."""
    return next((entry for entry in CATALOGUE if entry.name == name and kind in ("", entry.kind)), None)


def model_named(name: str) -> CatalogueModel:
    """The entry of that name.

    Raises:
        RequestError: there is none.
    """
    entry = find_model(name)
    if entry is None:
        hint = hint_at(name, [entry.name for entry in CATALOGUE])
        raise RequestError(f"the catalogue has no model {name!r}; {hint}")
    return entry


def records_of(values: Iterable[object]) -> dict[str, Any]:
    """What was kept of the downloaded models that some settings name, by name."""
    entries = [entry for value in values if isinstance(value, str | Path) and (entry := find_model(str(value)))]
    return {entry.name: entry.record() or asdict(entry) for entry in entries}


def file_sum(path: Path) -> str:
    """The sha256 of a file, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
