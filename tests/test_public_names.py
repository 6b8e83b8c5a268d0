"""`import tsuiseki`: light, the same names for people, programs and type checkers, and each of them loads."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

import tsuiseki

STUB = Path(tsuiseki.__file__).with_suffix(".pyi")


def test_every_public_name_loads() -> None:
    for name in tsuiseki.__all__:
        assert getattr(tsuiseki, name) is not None
    assert sorted(dir(tsuiseki)) == sorted(tsuiseki.__all__)
    assert tsuiseki.__version__ == metadata.version("tsuiseki")


def test_every_tracker_and_every_function_that_tracks_takes_a_seed() -> None:
    public = {name: getattr(tsuiseki, name) for name in tsuiseki.__all__}
    trackers = [kind for kind in public.values() if hasattr(kind, "update") and hasattr(kind, "tracks")]
    functions = [call for name, call in public.items() if name.startswith(("track_", "follow"))]
    assert len(trackers) >= 6
    assert len(functions) >= 10
    for call in (*trackers, *functions):
        assert inspect.signature(call).parameters["seed"].default == 0, call


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="attribute track_peeple"):
        tsuiseki.track_peeple  # noqa: B018


def test_type_checkers_see_the_names_that_there_are() -> None:
    imports = [node for node in ast.parse(STUB.read_text(encoding="utf-8")).body if isinstance(node, ast.ImportFrom)]
    # Only `import A as A` hands a name on, for a type checker.
    assert all(alias.asname == alias.name for node in imports for alias in node.names)
    assert set(tsuiseki.__all__) == {alias.name for node in imports for alias in node.names}


def test_importing_it_is_light() -> None:
    heavy = {"numpy", "scipy", "cv2", "av", "torch", "yaml", "pydantic"}
    code = f"import sys, tsuiseki; sys.exit(' '.join({heavy} & set(sys.modules)) or 0)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_its_trackers_need_no_opencv() -> None:
    code = "import sys; sys.modules['cv2'] = None\nimport tsuiseki; tsuiseki.Sort().update([]); tsuiseki.DeepSort()"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
