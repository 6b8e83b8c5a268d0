"""The manual holds what it promises: its length, its links, the names in it, and the lines to type."""

from __future__ import annotations

import ast
import contextlib
import importlib.util
import io
import json
import os
import re
import subprocess
import sys
import textwrap
import types
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import onnxruntime
import pytest

from benchmarks.papers import __main__ as papers
from benchmarks.papers.records import MARK
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.cli.commands import all_commands
from tsuiseki.tracking.types import Frame, Targets
from tsuiseki.tracking.video.source import LiveSource, open_source
from tsuiseki.tracking.weights import shipped, shipped_names

REPOSITORY = Path(__file__).resolve().parent.parent
DOCS = REPOSITORY / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
NOTEBOOKS = sorted(DOCS.rglob("*.ipynb"))
EVERY_PAGE = [*PAGES, *NOTEBOOKS, REPOSITORY / "README.md", REPOSITORY / "CONTRIBUTING.md"]
LONGEST = {"README.md": 600}
LONGEST_METHOD, LONGEST_MANUAL, LONGEST_SENTENCE, LONGEST_CHANGELOG = 700, 35_000, 25, 40
# Pages whose lines make what they need.
TUTORIALS = [page for page in PAGES if page.parent.name in ("tutorials", "extending") and page.name != "index.md"]
METHODS = [page for page in PAGES if page.parent.name == "methods"]
NETWORKS = [page for page in PAGES if page.parent.name == "networks"]
RESULTS = [page for page in PAGES if page.parent.name == "results" and page.name != "index.md"]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def name_of(page: Path) -> str:
    return page.relative_to(REPOSITORY).as_posix()


def text_of(page: Path) -> str:
    """The text of a file; of a notebook its cells, with code in fences."""
    text = page.read_text(encoding="utf-8")
    if page.suffix != ".ipynb":
        return text
    cells = [(cell["cell_type"], "".join(cell["source"])) for cell in json.loads(text)["cells"]]
    languages = ["" if kind == "markdown" else "sh" if code.startswith("%%bash") else "python" for kind, code in cells]
    codes = [code.removeprefix("%%bash\n") for _, code in cells]
    return "\n\n".join(
        f"```{language}\n{code}\n```" if language else code for language, code in zip(languages, codes, strict=True)
    )


def script(name: str) -> Any:
    """The module of a file in .ci."""
    spec = importlib.util.spec_from_file_location(name, REPOSITORY / ".ci" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


each_page = pytest.mark.parametrize("page", EVERY_PAGE, ids=name_of)


# ---- Length and language


def test_the_manual_is_short() -> None:
    # Tables that commands write are looked up, not read.
    texts = {name_of(page): MARK.sub("", text_of(page)) for page in [*PAGES, *NOTEBOOKS, REPOSITORY / "README.md"]}
    words = {name: len(text.split()) for name, text in texts.items()}
    assert sum(words.values()) <= LONGEST_MANUAL
    assert [name for name, most in LONGEST.items() if words[name] > most] == []
    assert [name for name, count in words.items() if "/methods/" in name and count > LONGEST_METHOD] == []
    assert len(text_of(REPOSITORY / "CHANGELOG.md").splitlines()) <= LONGEST_CHANGELOG


@each_page
def test_sentences_are_short(page: Path) -> None:
    prose = FENCE.sub("", text_of(page))
    prose = re.sub(r"^(?: {4}|\||#|:::|<!--).*$", "\n", prose, flags=re.MULTILINE)
    prose = re.sub(r"\]\([^)]*\)", "]", prose)
    # A colon ends a sentence before a list, a table or code alone.
    sentences = re.split(r"(?<=[.!?])\s+|(?<=:)\n(?= *[*-] )|\n\n|\n *(?:\*|-|\d\.) ", prose)
    lengths = {sentence: sum(bool(re.search(r"\w", word)) for word in sentence.split()) for sentence in sentences}
    assert [sentence for sentence, words in lengths.items() if words > LONGEST_SENTENCE] == []


# ---- Pages of one kind


@pytest.mark.parametrize("page", METHODS, ids=name_of)
def test_a_method_page_has_its_parts(page: Path) -> None:
    text = text_of(page)
    parts = {part.split("\n", 1)[0]: part for part in re.split(r"^## ", text, flags=re.MULTILINE)[1:]}
    assert {"Idea", "Equations", "Parameters", "When to use it", "Results", "Source"} <= set(parts)
    assert re.search(r"^\|[-|]+\|$", parts["Parameters"], re.MULTILINE)
    assert "Do not" in " ".join(parts["When to use it"].split())
    assert len(re.findall(r"^\|[-|]+\|$", parts["Results"], re.MULTILINE)) == 1
    assert "Ours" not in text


@pytest.mark.parametrize("page", METHODS, ids=name_of)
def test_equations_are_numbered(page: Path) -> None:
    blocks = [block for language, block in FENCE.findall(text_of(page)) if language == "math"]
    assert blocks
    for number, block in enumerate(blocks, 1):
        assert block.count("\n") == 1
        assert block.endswith(f" \\tag{{{number}}}\n")


@pytest.mark.parametrize("page", RESULTS, ids=name_of)
def test_a_results_page_names_command_and_versions(page: Path) -> None:
    assert re.search(r"^ {4}(tsuiseki|python -m benchmarks.(papers|all)) ", text_of(page), re.MULTILINE)
    assert "(index.md#how-to-read-them)" in text_of(page)


@pytest.mark.parametrize("page", NETWORKS, ids=name_of)
def test_a_network_page_has_its_parts_and_the_shipped_files(page: Path) -> None:
    text = text_of(page)
    parts = {part.split("\n", 1)[0]: part for part in re.split(r"^## ", text, flags=re.MULTILINE)[1:]}
    assert {"Inputs and outputs", "Loss", "Data", "Shipped files", "Results", "Licence"} <= set(parts)
    assert f"](../images/network-{page.stem}.svg)" in text
    rows = [row.split(" | ") for row in re.findall(r"^\| `(\w+\.onnx.*) \|$", text, re.MULTILINE)]
    names = [name for name in shipped_names() if name.startswith(f"{page.stem}_")]
    assert sorted(row[0] for row in rows) == [f"{name}.onnx`" for name in names]
    for file, image, outputs, network, training_data in rows:
        session = onnxruntime.InferenceSession(shipped(file.removesuffix(".onnx`")))
        card = json.loads(session.get_modelmeta().custom_metadata_map["tsuiseki"])
        shapes = {place.name: " × ".join(map(str, place.shape[1:])) for place in session.get_outputs()}
        assert image == " × ".join(map(str, session.get_inputs()[0].shape[1:]))
        assert outputs == ", ".join(shape for name, shape in shapes.items() if name != "anchors")
        assert (network, training_data) == (card["name"], card["training_data"])


@pytest.mark.slow
def test_the_pictures_of_networks_have_their_shapes() -> None:
    pytest.importorskip("torch")
    networks = script("networks")
    assert sorted(networks.PICTURES) == [page.stem for page in NETWORKS]
    for name, draw in networks.PICTURES.items():
        assert text_of(DOCS / "images" / f"network-{name}.svg") == draw().svg(), "python .ci/networks.py --write"


# ---- Links and names


@each_page
def test_what_a_page_links_to_exists(page: Path) -> None:
    for name in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", FENCE.sub("", text_of(page))):
        assert "://" in name or (page.parent / name).exists(), name


def test_every_page_and_picture_is_used() -> None:
    used = {
        (page.parent / name).resolve() for page in EVERY_PAGE for name in re.findall(r"\]\(([^)#]+)", text_of(page))
    }
    files = [*(DOCS / "images").iterdir(), *PAGES, *NOTEBOOKS]
    assert [path.name for path in files if path.resolve() not in used] == []


def test_the_gallery_has_ten_pictures_each_with_its_command() -> None:
    shown = re.findall(r"^!\[\w.*\]\(images/(\S+)\)\n`tsuiseki (.+)`$", text_of(DOCS / "gallery.md"), re.MULTILINE)
    assert len(dict(shown)) == 10
    commands = {" ".join(words) for words in all_commands()}
    assert [line for _, line in shown if not {line.split()[0], " ".join(line.split()[:2])} & commands] == []


@each_page
def test_files_that_a_page_names_exist(page: Path) -> None:
    text = text_of(page)
    named = re.findall(
        r"(?<![\w/.-])((?:configs|benchmarks|tracking|trainers|models|datamodules|tests)/[\w./]*)(?=`)", text
    )
    named += re.findall(r"\b((?:configs|benchmarks)/[\w./]+\.(?:yaml|py))", text)
    modules = [module.replace(".", "/") for module in re.findall(r"python -m (benchmarks(?:\.\w+)+)", text)]
    named += [module if (REPOSITORY / module).is_dir() else f"{module}.py" for module in modules]
    assert [name for name in named if not (REPOSITORY / name).exists()] == []


def test_pages_that_the_code_names_exist() -> None:
    folders = ("benchmarks", "configs", "datamodules", "models", "tracking", "trainers")
    files = [path for folder in folders for end in ("py", "yaml") for path in (REPOSITORY / folder).rglob(f"*.{end}")]
    named = {name for path in files for name in re.findall(r"\bdocs/[\w/-]+\.md", text_of(path))}
    assert [name for name in sorted(named) if not (REPOSITORY / name).exists()] == []


def test_the_reference_shows_every_public_name() -> None:
    import tsuiseki

    text = "\n".join(map(text_of, PAGES))
    shown = re.findall(r"^::: tsuiseki\.((?:training\.)?\w+)$", text, re.MULTILINE)
    training = {f"training.{name}" for name in tsuiseki.training.__all__}
    assert sorted(shown) == sorted(set(tsuiseki.__all__) - {"__version__", "training"} | training)


# ---- Commands


def commands_in(text: str) -> Iterator[str]:
    """Everything in ``text`` that begins with ``tsuiseki`` and could be typed."""
    joined = text.replace("\\\n", " ")
    yield from re.findall(r"^\s*(tsuiseki [^\n#]*)", joined, re.MULTILINE)
    yield from re.findall(r"`(tsuiseki [^`]*)`", re.sub(r"```.*?```", "", joined, flags=re.DOTALL))


def printed(words: list[str]) -> str:
    """What ``tsuiseki`` with these words prints; it has to end well."""
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.suppress(SystemExit):
        assert main(words) == 0, words
    return output.getvalue()


@cache
def help_of(command: tuple[str, ...]) -> frozenset[str]:
    """The options of ``command``; none for an unknown one."""
    text = printed([*command, "--help"])
    if "--help-all" in text:
        text += printed([*command, "--help-all"])
    return frozenset(option.replace("_", "-") for option in re.findall(r"(?<![\w-])--[a-zA-Z][\w.-]*", text))


def command_and_options(line: str) -> tuple[tuple[str, ...], list[str]]:
    words = line.split()[1:]
    command: list[str] = []
    while words and len(command) < 2 and re.fullmatch(r"[a-z][a-z-]*", words[0]):
        command.append(words.pop(0))
    # A class that an option names has arguments of its own.
    named = [re.split(r"[=,]|\.class_path|\.init_args", word)[0] for word in words]
    options = [word for word in named if re.match(r"--[a-z]", word)]
    return tuple(command), [option.replace("_", "-") for option in options]


LINES = sorted({(name_of(page), line.strip()) for page in EVERY_PAGE for line in commands_in(text_of(page))})


COMMANDS = sorted({command_and_options(line)[0] for _, line in LINES} - {()})
# Of benchmarks.
OF_OTHERS = frozenset({"--delay"})


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: " ".join(command))
def test_commands_that_pages_name_exist_with_their_options(command: tuple[str, ...]) -> None:
    for page, line in LINES:
        named, options = command_and_options(line)
        if named == command:
            assert set(options) <= help_of(command), f"{page}: {line}"


@cache
def help_of_paper(name: str) -> frozenset[str]:
    """The options of ``python -m benchmarks.papers NAME``."""
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        assert papers.main([name, "--help"]) == 0
    return frozenset(re.findall(r"(?<![\w-])--[a-z][\w-]*", output.getvalue()))


@pytest.mark.slow
def test_experiments_that_pages_name_exist_with_their_options() -> None:
    for page in PAGES:
        for line in re.findall(r"^ *python -m benchmarks\.papers ([^\n#]*)", text_of(page), re.MULTILINE):
            name, *words = line.split()
            assert {word for word in words if word.startswith("--")} <= help_of_paper(name), f"{name_of(page)}: {line}"


@pytest.mark.slow
def test_options_that_pages_name_alone_exist() -> None:
    known = frozenset().union(*map(help_of, COMMANDS), *map(help_of_paper, papers.EXPERIMENTS))
    text = "\n".join(FENCE.sub("", text_of(page)) for page in EVERY_PAGE)
    named = {option.replace("_", "-") for option in re.findall(r"`(--[a-z][\w.-]*[\w])[^`]*`", text)}
    assert sorted(named - known - OF_OTHERS) == []


# ---- Lines that run


# Commands that need the train extra; all others run on a machine without it.
TRAINING = re.compile(r"^\s*tsuiseki (train|export|adapt) ", re.MULTILINE)
# Seconds that the lines of a block may take on a busy machine.
LONGEST_BLOCK = 240


@pytest.fixture(scope="module")
def without_torch(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """An environment whose Python has neither torch nor lightning, as after ``pip install .``."""
    folder = tmp_path_factory.mktemp("without_torch")
    for name in ("torch", "torchvision", "lightning"):
        (folder / f"{name}.py").write_text(f"raise ModuleNotFoundError('no {name} on this machine', name='{name}')\n")
    path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | {"PYTHONPATH": path}
    hidden = subprocess.run([sys.executable, "-c", "import torch"], env=environment, capture_output=True, text=True)
    assert "no torch on this machine" in hidden.stderr
    return environment


@pytest.mark.slow
@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_a_tutorial_runs(
    page: Path, tmp_path: Path, without_torch: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    names: dict[str, Any] = {}
    if "from torchvision" in text_of(page):
        pytest.importorskip("torchvision", reason="the page's example is a network of torchvision")
    for language, block in FENCE.findall(text_of(page)):
        if language == "sh":
            environment = (os.environ if TRAINING.search(block) else without_torch) | {"PATH": path}
            bash = ["bash", "-euo", "pipefail", "-c", block]
            subprocess.run(bash, check=True, env=environment, timeout=LONGEST_BLOCK)
        elif language == "python":
            exec(compile(block, f"{page.name}", "exec"), names)
            # A block that begins with the name of a file is that file.
            if (name := re.match(r"# (\w+\.py)\n", block)) is not None:
                Path(name[1]).write_text(block)


# Seconds of a cell on a busy machine.
LONGEST_CELL = 600


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    notebook = nbformat.read(path, as_version=4)
    place = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(notebook, timeout=LONGEST_CELL, kernel_name="python3", resources=place).execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_small_and_has_no_outputs(path: Path) -> None:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    assert len(cells) <= 15
    assert [cell["id"] for cell in cells if cell.get("outputs") or cell.get("execution_count") is not None] == []


def test_the_notebook_of_training_has_the_code_of_its_page() -> None:
    [notebook] = [FENCE.findall(text_of(path)) for path in NOTEBOOKS if path.stem == "train-in-python"]
    page = FENCE.findall(text_of(DOCS / "tutorials" / "train-in-python.md"))[: len(notebook)]
    assert [language for language, _ in notebook] == [language for language, _ in page]
    # A notebook shows its last picture.
    assert all(cell.startswith(block) for (_, cell), (_, block) in zip(notebook, page, strict=True))


# A folder of pictures may be called as a video is.
CLIPS = """
street --frames 12 --seed 100 --out street.mp4
blobs --frames 8 --width 320 --height 240 --objects 3 --seed 1 --out balls.mp4
goldfish --frames 4 --count 1 --seed 4 --out fish
drone --frames 6 --width 320 --height 240 --people 3 --seed 3 --out flight
sphere --frames 3 --out ball
"""


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the pages name: street.mp4, balls.mp4, fish, flight, ball."""
    folder = tmp_path_factory.mktemp("clips")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for line in CLIPS.split("\n")[1:-1]:
            assert main(["simulate", *line.split()]) == 0
    return folder


@pytest.fixture
def webcam(clips: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A webcam that shows six frames of the street and is unplugged."""
    images = [frame.image for frame in open_source(clips / "street.mp4").frames()][:6]

    def frames(_: Any) -> Iterator[Frame]:
        yield from (Frame(number, number / 25, image) for number, image in enumerate(images))

    def opened(address: str, name: str, wanted: Any, stream: int | None) -> LiveSource:
        return LiveSource(address=address, name=name, frames_wanted=wanted, stream=stream or 1)

    monkeypatch.setattr(LiveSource, "open", staticmethod(opened))
    monkeypatch.setattr(LiveSource, "frames", frames)


@pytest.mark.slow
@pytest.mark.usefixtures("webcam")
@pytest.mark.parametrize("name", ["README.md", "docs/how-to/python.md"])
def test_the_python_lines_run(
    name: str, clips: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(clips)
    names: dict[str, Any] = {}
    for language, block in FENCE.findall(text_of(REPOSITORY / name)):
        if language == "python":
            exec(compile(textwrap.dedent(block), name, "exec"), names)
    assert len(names["tracks"]) > 0
    assert isinstance(names["people"], Targets)
    assert "tracking" in capsys.readouterr().out


SENSOR = """
sensor: {deviation: 2}
clutter: 1
region: [[0, 320], [0, 240]]
births: {rate: 0.1, speed: 5}
"""


@pytest.mark.slow
def test_the_lines_for_users_of_other_trackers_run(clips: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(clips)
    monkeypatch.setitem(sys.modules, "supervision", types.SimpleNamespace(Detections=dict))
    Path("det.txt").write_text("".join(f"{t},-1,{100 + 4 * t},80,40,100,0.9\n" for t in range(1, 13)))
    Path("points.csv").write_text("time,x,y\n" + "".join(f"{t},{50 + 3 * t},60\n" for t in range(12)))
    Path("sensor.yaml").write_text(SENSOR)
    [(_, block)] = FENCE.findall(text_of(DOCS / "how-to" / "which-tracker.md"))
    names: dict[str, Any] = {"model": lambda *_, **__: [[[100, 80, 140, 180, 0.9]]]}
    exec(compile(block, "which-tracker.md", "exec"), names)
    assert len(names["tracks"]) == len(names["targets"]) == 1
    assert len(names["frames"]) == 12


@pytest.mark.parametrize("name", ["README.md", "docs/how-to/python.md"])
def test_type_checkers_see_the_python_lines(name: str) -> None:
    """`make lint` checks the page of calls, which has each block of Python in a function."""
    functions = ast.parse(text_of(REPOSITORY / "tests/typing/readme_calls.py")).body
    checked = [[ast.dump(line) for line in part.body] for part in functions if isinstance(part, ast.FunctionDef)]
    for language, block in FENCE.findall(text_of(REPOSITORY / name)):
        if language == "python":
            lines = [line for line in ast.parse(block).body if not isinstance(line, ast.Import)]
            assert [ast.dump(line) for line in lines] in checked, block


def test_the_readme_shows_people_in_ten_lines() -> None:
    blocks = [block for language, block in FENCE.findall(text_of(REPOSITORY / "README.md")) if language == "python"]
    lines = [line for block in blocks for line in block.splitlines() if line]
    assert 0 < len(lines) <= 10


# ---- Equations


@pytest.mark.slow
def test_the_table_of_equations_is_current_and_says_what_computes_each() -> None:
    equations = script("equations")
    assert text_of(equations.PAGE) == equations.page(), "give `python .ci/equations.py --write`"
    for paper, numbers in equations.PAPERS.items():
        for number, files in equations.mentions(numbers).items():
            assert files, f"no docstring names {paper} ({number})"
            assert len(files) == 1 or not files[0].only_named, f"no docstring says Eq. ({number}) of {paper}: {files}"
    assert "| 2.14 | `tracking/association/learnt_costs.py`" in equations.page()
