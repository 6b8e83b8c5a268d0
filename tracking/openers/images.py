"""The opener of image files: OpenCV decodes their bytes, so that no name is too strange for it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import lacks_memory


def decoded_image(path: str | Path, flags: int = cv2.IMREAD_COLOR) -> NDArray[Any] | None:
    """The image in the file at ``path``, as OpenCV has it: BGR or grey; None where it is none.

    Args:
        path: of the file; its name may be of any bytes, which `cv2.imread` does not take.
        flags: OpenCV's, such as ``cv2.IMREAD_UNCHANGED``.

    Raises:
        MemoryError: the image needs more than there is.
    """
    try:
        return cv2.imdecode(np.fromfile(path, dtype=np.uint8), flags)
    except (OSError, cv2.error) as error:
        if lacks_memory(error):
            raise MemoryError(f"{path} needs more") from error
        return None
