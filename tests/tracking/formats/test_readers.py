"""datumaro, which CVAT uses, opens what is exported for it; it has an environment of its own (make test-readers)."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.formats.cvat import write_cvat
from tsuiseki.tracking.formats.tracked_video import TrackedVideo
from tsuiseki.tracking.types import Track

PYTHON = Path(__file__).resolve().parents[3] / ".venv/readers/bin/python"
READ = """
import sys, json, datumaro
opened = datumaro.Dataset.import_from(sys.argv[1], "cvat")
boxes = [[item.attributes["frame"], box.attributes, box.get_bbox()] for item in opened for box in item.annotations]
print(json.dumps(boxes))
"""


@pytest.mark.skipif(not PYTHON.is_file(), reason="datumaro is not installed: make test-readers")
def test_cvats_reader_opens_its_file(tmp_path: Path) -> None:
    path, boxes = tmp_path / "street.xml", np.array([[10.0, 20, 40, 90], [12, 20, 42, 90], [14, 21, 44, 91]])
    seen = {2: (0, 1, 2), 5: (1, 2, 4)}
    tracks = [Track(n, np.array(frames), boxes + 9 * n, np.full(3, 0.9)) for n, frames in seen.items()]
    write_cvat(path, TrackedVideo(tracks, "street.mp4", 25.0, (640, 480), 6))
    opened = subprocess.run([PYTHON, "-c", READ, str(path)], capture_output=True, text=True, check=True)
    found = {(n, of["track_id"]): place for n, of, place in json.loads(opened.stdout) if not of["outside"]}
    assert found.keys() == {(frame, number) for number, frames in seen.items() for frame in frames}
    np.testing.assert_allclose(found[4, 5], [59, 66, 30, 70], atol=0.01)
