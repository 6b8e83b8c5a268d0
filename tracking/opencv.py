"""Why OpenCV does not load, in one line.

The package ``opencv-python`` needs libraries for windows (libGL), which slim machines do not have. Where another
package brings it, it takes the place of ``opencv-python-headless``, which needs none: the two share their files.
"""

from __future__ import annotations

import re

from tsuiseki.tracking.errors import RunError

ADVICE = (
    "another package has brought opencv-python in the place of opencv-python-headless; give `pip uninstall -y "
    "opencv-python opencv-contrib-python`, then `pip install --force-reinstall --no-deps opencv-python-headless`"
)


def explained(error: ImportError) -> RunError | None:
    """The failure to load OpenCV as an error that says what to do; None where it was something else.

    >>> str(explained(ImportError("libGL.so.1: cannot open shared object file"))).split(";")[0]
    'OpenCV does not load, for libGL.so.1 is not there'
    >>> explained(ImportError("No module named 'tsuiseki.flow'"))
    """
    if error.name == "cv2":
        return RunError("OpenCV is not installed; give `pip install opencv-python-headless`")
    library = re.match(r"(lib[\w.+-]+\.so[\w.]*): cannot open shared object file", str(error))
    if library is None:
        return None
    return RunError(f"OpenCV does not load, for {library[1]} is not there; {ADVICE}")
