"""The house: the direction of imports, its sizes, and that tracking runs without torch."""

from __future__ import annotations

import ast
import collections
import doctest
import importlib
import pkgutil
import re
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
FOLDERS = ("models", "datamodules", "trainers", "tracking")
LAYERS = tuple(
    sorted(
        path.stem
        for path in (REPOSITORY / "tracking").iterdir()
        if (path.is_dir() or path.suffix == ".py") and not path.stem.startswith("__")
    )
)


def storeys() -> list[set[str]]:
    """What `tracking` has, storey by storey from the bottom, as the table of CONTRIBUTING.md says.

    What stands in no row of that table lies at the bottom.
    """
    text = (REPOSITORY / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = text.partition("| storey | folders |\n|---|---|\n")[2].partition("\n\n")[0].splitlines()
    above = [set(re.findall(r"`(\w+)`", row.split("|")[2])) for row in rows[-2::-1]]
    return [set(LAYERS).difference(*above), *above]


STOREYS = storeys()
ALLOWED = {
    "models": {"models"},
    "tracking": {"tracking"},
    "datamodules": {"datamodules", *(f"tracking.{layer}" for storey in STOREYS[:2] for layer in storey)},
    "trainers": {"trainers", "models", "datamodules", "tracking"},
    "configs": set(),
}
# Networks that `tsuiseki.training` fits and `tsuiseki` runs, by one name.
TRAINED_AND_RUN = {"Appearance", "Detector"}
# Calls that list all options of a command as keywords, each with its line.
LISTING = ("track_people", "follow_people")
TORCH_FREE = ("tracking", "datamodules/scenes", *(f"datamodules/{name}.py" for name in (
    "labelled_images", "identity_crops", "action_crops", "training_images", "video_pictures")))  # fmt: skip


def source_files(folder: str) -> list[Path]:
    place = REPOSITORY / folder
    found = [place] if place.suffix == ".py" else sorted(place.rglob("*.py"))
    assert found, f"nothing to look at in {folder}"
    return found


def imported_modules(path: Path) -> set[str]:
    """Full names of what a file imports, at its top level and inside functions."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def starts_with(module: str, prefixes: set[str]) -> bool:
    return any(module == prefix or module.startswith(prefix + ".") for prefix in prefixes)


def test_functions_and_constructors_are_short_and_a_class_name_stands_once():
    names: collections.Counter[str] = collections.Counter()
    for path in (file for folder in FOLDERS for file in source_files(folder)):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            parameters: list[str] = []
            if isinstance(node, ast.FunctionDef):
                given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                parameters = [one.arg for one in given if one.arg not in ("self", "cls")]
                assert node.end_lineno is not None
                if node.name in LISTING:
                    continue
                assert node.end_lineno - node.lineno < 60, f"{path}: {node.name} is too long"
            elif isinstance(node, ast.ClassDef):
                names[node.name] += 1
                fields = [one for one in node.body if isinstance(one, ast.AnnAssign)]
                if any("dataclass" in ast.unparse(one) for one in node.decorator_list):
                    parameters = [ast.unparse(one) for one in fields if "ClassVar" not in ast.unparse(one.annotation)]
            assert len(parameters) <= 15, f"{path}: {node.name} takes too many parameters"
    assert {name for name, count in names.items() if count > 1} == TRAINED_AND_RUN


@pytest.mark.parametrize("folder", sorted(ALLOWED))
def test_imports_flow_one_way(folder):
    allowed = {f"tsuiseki.{name}" for name in ALLOWED[folder]} | {"tsuiseki"}
    for path in source_files(folder):
        if any(path.is_relative_to(REPOSITORY / "tracking" / name) for name in ("cli", "demo")):
            continue  # the command line and its demo alone may reach up, inside functions
        ours = {name for name in imported_modules(path) if name.startswith("tsuiseki.")}
        parents = {f"tsuiseki.{name.split('.')[0]}" for name in ALLOWED[folder]}
        wrong = {name for name in ours if not starts_with(name, allowed - {"tsuiseki"}) and name not in parents}
        assert not wrong, f"{path.relative_to(REPOSITORY)} imports {sorted(wrong)}"


@pytest.mark.parametrize("layer", LAYERS)
def test_tracking_has_no_back_arrow(layer):
    (place,) = [number for number, storey in enumerate(STOREYS) if layer in storey]
    above = {name for storey in STOREYS[place + 1 :] for name in storey}
    wrong = sorted(imported_layers(layer) & above)
    assert not wrong, f"tracking/{layer} imports {wrong}, which stand above it in the table of CONTRIBUTING.md"


def imported_layers(layer: str) -> set[str]:
    """What a folder or module of `tracking` imports of the others."""
    place = f"tracking/{layer}" if (REPOSITORY / "tracking" / layer).is_dir() else f"tracking/{layer}.py"
    modules = {module for path in source_files(place) for module in imported_modules(path)}
    return {name for name in LAYERS if any(starts_with(m, {f"tsuiseki.tracking.{name}"}) for m in modules)} - {layer}


def test_the_table_of_storeys_names_what_there_is():
    listed = [layer for storey in STOREYS for layer in storey]
    assert sorted(listed) == sorted(LAYERS)
    assert len(STOREYS) == 6


def test_folders_of_tracking_import_each_other_in_no_circle():
    TopologicalSorter({layer: imported_layers(layer) for layer in LAYERS}).prepare()


def test_modules_import_each_other_in_no_circle():
    """Over all folders, imports inside functions and those for type checkers included."""
    paths = [path for folder in FOLDERS for path in source_files(folder)]
    places = {path: path.parent if path.stem == "__init__" else path.with_suffix("") for path in paths}
    names = {path: ".".join(["tsuiseki", *place.relative_to(REPOSITORY).parts]) for path, place in places.items()}
    needs = {names[path]: imported_modules(path) & ({*names.values()} - {names[path]}) for path in paths}
    TopologicalSorter(needs).prepare()


@pytest.mark.parametrize("folder", TORCH_FREE)
def test_no_file_names_torch(folder):
    for path in source_files(folder):
        assert not {n for n in imported_modules(path) if starts_with(n, {"torch", "lightning", "torchvision"})}, path


def modules_of(package: str) -> list[str]:
    root = importlib.import_module(package)
    return [package, *(info.name for info in pkgutil.walk_packages(root.__path__, prefix=f"{package}."))]


def test_importing_all_of_tracking_leaves_torch_out():
    code = (
        "import importlib, pkgutil, sys, tsuiseki.tracking as root\n"
        "for info in pkgutil.walk_packages(root.__path__, prefix='tsuiseki.tracking.'):\n"
        "    if not info.name.endswith('__main__'): importlib.import_module(info.name)\n"
        "sys.exit(' '.join({'torch', 'lightning', 'torchvision', 'sklearn', 'pandas'} & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    "package", ["tsuiseki.tracking", "tsuiseki.datamodules", "tsuiseki.models", "tsuiseki.trainers"]
)
def test_examples_in_docstrings_run(package):
    for name in modules_of(package):
        if not name.endswith("__main__"):
            assert doctest.testmod(importlib.import_module(name)).failed == 0, name


def test_tracking_people_starts_without_what_it_needs_late():
    """SciPy loads its parts on first use; loaded at the start they would take as long as ten frames."""
    late = ("scipy.optimize", "scipy.ndimage", "scipy.sparse", "scipy.fft", "rich")
    program = (
        "import sys, tsuiseki.tracking.cli.track_people, tsuiseki.tracking.counts.page; "
        f"print([name for name in {late} if name in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert found.strip() == "[]"
