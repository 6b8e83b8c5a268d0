"""NumPy's files of arrays (``.npz``), bounded: see the head of the folder. Nothing in them is unpickled."""

from __future__ import annotations

from math import prod
from pathlib import Path
from typing import Any, BinaryIO
from zipfile import ZipFile, ZipInfo

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import RequestError

# Bytes of all arrays together, which a few packed bytes may stand for: 100 million boxes.
MOST_BYTES = 2**32
# Characters of a reader's reason, which may quote 65,535 bytes of a name.
LONGEST_REASON = 200


def read_arrays(path: Path, what: str, content: BinaryIO | None = None) -> dict[str, NDArray[Any]]:
    """The arrays of a file by name; of its ``content``, where that is open.

    Raises:
        RequestError: there is no such file of ``what``, it is cut short or changed, an array holds objects, its size
            is not what it says, or all are beyond `MOST_BYTES`.
    """
    if content is None and not path.is_file():
        raise RequestError(f"expected {what} at {path}, found no such file")
    try:
        with ZipFile(path if content is None else content) as file:
            members = file.infolist()
            if len({member.filename for member in members}) != len(members):
                raise ValueError("a name twice")
            if sum(member.file_size for member in members) > MOST_BYTES:
                raise ValueError(f"arrays of over {MOST_BYTES} bytes")
            return {member.filename.removesuffix(".npy"): _array(file, member) for member in members}
    except MemoryError:
        raise
    # The readers of archives and of headers raise whatever the bytes lead them to, syntax errors included.
    except Exception as error:
        reason = str(error)[:LONGEST_REASON]
        raise RequestError(f"{path}: expected {what}, got something else ({reason})") from error


def _array(file: ZipFile, member: ZipInfo) -> NDArray[Any]:
    with file.open(member) as stream:
        version = np.lib.format.read_magic(stream)
        reader = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = reader(stream)
        # Room for an array is made before its values are read.
        if dtype.hasobject or min(shape, default=0) < 0 or prod(shape) * dtype.itemsize > member.file_size:
            raise ValueError(f"{member.filename} is not of the size that it says, or no plain array")
    with file.open(member) as stream:
        array: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
        return array
