"""Settings: what their bounds mean does not depend on who makes them first."""

import importlib
import inspect
import pkgutil
import subprocess
import sys

from pydantic.dataclasses import is_pydantic_dataclass

import tsuiseki


def settings_classes() -> list[type]:
    """All classes of settings, each once."""
    modules = [importlib.import_module(info.name) for info in pkgutil.walk_packages(tsuiseki.__path__, "tsuiseki.")]
    members = [member for module in modules for member in vars(module).values() if inspect.isclass(member)]
    return sorted({member for member in members if is_pydantic_dataclass(member)}, key=lambda kind: kind.__qualname__)


def test_settings_are_complete_once_imported():
    """Pydantic would complete a class at its first use, and resolve `PositiveInt` by the names of the caller."""
    classes = settings_classes()
    assert len(classes) > 80
    assert [kind.__name__ for kind in classes if not kind.__pydantic_complete__] == []


def test_names_of_a_script_do_not_loosen_the_bounds():
    code = (
        "PositiveInt = int\n"
        "from tsuiseki.datamodules.scenes.blob_clip import BlobSceneSettings\n"
        "BlobSceneSettings(objects=0)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert run.returncode == 1
    assert "Input should be greater than 0" in run.stderr
