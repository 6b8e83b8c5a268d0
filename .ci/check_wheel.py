"""Build the wheel and check it: one top level, every package, the shipped models and configurations; then import it."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
FOLDERS = ("configs", "datamodules", "models", "tracking", "trainers")
MOST_MODEL_BYTES = 40 * 2**20


def expected_files() -> set[str]:
    """The files of the repository that must be in the wheel, by their path there."""
    suffixes = {".py", ".onnx", ".json", ".yaml", ".html", ".css", ".j2", ".js", ".svg"}
    found = (path for folder in FOLDERS for path in (REPOSITORY / folder).rglob("*") if path.suffix in suffixes)
    source = REPOSITORY / "src"
    own = [path for pattern in ("*", "training/*") for path in (source / "tsuiseki").glob(pattern) if path.is_file()]
    top = {path.relative_to(source).as_posix() for path in own}
    return top | {f"tsuiseki/{path.relative_to(REPOSITORY).as_posix()}" for path in found if path.is_file()}


def build(folder: Path) -> Path:
    """The wheel, built into ``folder``."""
    command = [sys.executable, "-m", "build", "--wheel", "--outdir", str(folder), str(REPOSITORY)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return next(folder.glob("*.whl"))


def problems(wheel: Path) -> list[str]:
    """What is wrong with the wheel, one line each."""
    with zipfile.ZipFile(wheel) as archive:
        sizes = {info.filename: info.file_size for info in archive.infolist()}
    found = {name for name in sizes if ".dist-info/" not in name}
    lines = [f"missing: {name}" for name in sorted(expected_files() - found)]
    lines += [f"not expected: {name}" for name in sorted(found - expected_files())]
    models = sum(size for name, size in sizes.items() if name.endswith(".onnx"))
    if not 0 < models <= MOST_MODEL_BYTES:
        lines.append(f"models take {models} bytes; expected some, at most {MOST_MODEL_BYTES}")
    if not any(name.endswith("licenses/LICENSE") for name in sizes):
        lines.append("missing: LICENSE")
    return lines


USE = """
import sys, tsuiseki
heavy = {"numpy", "cv2", "torch", "scipy", "onnxruntime", "matplotlib"} & set(sys.modules)
assert not heavy, f"import tsuiseki brings {heavy}"
assert tsuiseki.__file__.startswith(sys.argv[1]), tsuiseki.__file__
for name in tsuiseki.__all__:
    getattr(tsuiseki, name)
people = tsuiseki.Sort().update([[0, 0, 10, 20, 0.9]])
import tsuiseki.configs, tsuiseki.tracking.cli
assert tsuiseki.tracking.cli.main(["--version"]) == 0
"""


def failure_of_use(wheel: Path, folder: Path) -> list[str]:
    """What goes wrong where the wheel, installed into ``folder``, is imported and used; nothing if all is well."""
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(folder), str(wheel)]
    subprocess.run(pip, check=True)
    environment = os.environ | {"PYTHONPATH": str(folder)}
    command = [sys.executable, "-c", USE, str(folder)]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    return [] if done.returncode == 0 else [f"the installed wheel does not work: {done.stderr.strip()}"]


def main() -> int:
    """Build, check, and say what is wrong."""
    with tempfile.TemporaryDirectory() as folder:
        wheel = build(Path(folder))
        lines = problems(wheel) + failure_of_use(wheel, Path(folder) / "installed")
        print(f"{wheel.name}: {wheel.stat().st_size / 2**20:.1f} MiB", *(lines or ["contents as expected"]), sep="\n")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())
