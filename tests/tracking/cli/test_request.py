"""Options from function signatures: values arrive typed, from words and from YAML, and mistakes get one line."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import Field
from pydantic.dataclasses import dataclass
from rich.console import Console

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.cli.commands import APP, all_commands, command_of
from tsuiseki.tracking.cli.request import request_of
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.fields import Commas, Options, Rows


@dataclass(frozen=True, config=SETTINGS)
class Filter:
    """Settings of the filter.

    Attributes:
        max_age: frames.
        gain: of it.
        smooth: also smooth.
    """

    max_age: int = 3
    gain: float = 0.5
    smooth: bool = True

    def __post_init__(self) -> None:
        if self.gain < 0:
            raise RequestError(f"`gain`: expected at least 0, got {self.gain}")


FILTER = Filter(gain=0.4)


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class Limits(Options):
    """Limits.

    Attributes:
        score_range: limits.
        init: starts.
        limit: at most.
    """

    score_range: Commas[tuple[float, float]] = (0.0, 1.0)
    init: Rows[list[list[float]] | None] = None
    limit: Annotated[float, Field(gt=0)] | None = None


LIMITS = Limits()


def command(
    source: str,
    results: list[Path],
    *,
    out: Path,
    limits: Limits = LIMITS,
    method: Literal["fast", "good"] = "good",
    seed: int = 0,
    names: Commas[list[str] | None] = None,
    dry_run: bool = False,
    model: Path | None = None,
    filter: Filter = FILTER,
) -> None:
    """Do something.

    Args:
        source: what with.
        results: what else.
        out: folder to write to.
        limits.limit: no more.
        method: how.
        seed: of chance.
        names: of results.
        dry_run: only say it.
        model: a file.
        filter: settings of the filter.
    """


@pytest.fixture(autouse=True)
def _command() -> Iterator[None]:
    APP.command(command, name="do")
    yield
    del APP["do"]


def parsed(*words: str) -> dict[str, Any]:
    return dict(request_of(["do", *words]).arguments.arguments)


def test_words_become_typed_values() -> None:
    words = "in a.txt b.txt --out o --seed 7 --dry-run --score-range -1,2.5 --filter.max-age 9 --model=m.onnx"
    assert parsed(*words.split(), "--init", "-1,2", "--init", "3,4", "--names", "x,y") == {
        "source": "in",
        "results": [Path("a.txt"), Path("b.txt")],
        "out": Path("o"),
        "limits": Limits(score_range=(-1.0, 2.5), init=[[-1.0, 2.0], [3.0, 4.0]]),
        "method": "good",
        "seed": 7,
        "names": ["x", "y"],
        "dry_run": True,
        "model": Path("m.onnx"),
        # What is not given keeps the default of the command.
        "filter": Filter(max_age=9, gain=0.4),
    }


def test_dashes_and_underscores_are_the_same() -> None:
    words = ["in", "a", "--out", "o"]
    assert parsed(*words, "--dry_run", "--filter.max_age=2") == parsed(*words, "--dry-run", "--filter.max-age", "2")


def test_every_option_also_comes_from_yaml_and_words_win(tmp_path: Path) -> None:
    config = tmp_path / "c.yaml"
    config.write_text(
        "source: in\nresults: [a]\nout: o\nseed: 5\nmethod: fast\ndry_run: true\nscore_range: [0, 9]\n"
        "init: [[1, 2], [3, 4]]\nmodel: null\nfilter:\n  max_age: 8\n  gain: 0.25\n"
    )
    values = parsed("--config", str(config), "--seed", "6")
    assert (values["source"], values["results"], values["out"]) == ("in", [Path("a")], Path("o"))
    assert (values["seed"], values["method"], values["dry_run"], values["model"]) == (6, "fast", True, None)
    assert values["limits"] == Limits(score_range=(0.0, 9.0), init=[[1.0, 2.0], [3.0, 4.0]])
    assert values["filter"] == Filter(8, 0.25)


def test_of_two_files_the_later_one_wins(tmp_path: Path) -> None:
    for name, text in (("a", "seed: 1\nmethod: fast"), ("b", "seed: 2")):
        (tmp_path / f"{name}.yaml").write_text(text)
    files = [f"--config={tmp_path / name}.yaml" for name in "ab"]
    values = parsed("in", "a", "--out", "o", *files)
    assert (values["seed"], values["method"]) == (2, "fast")


def test_the_printed_configuration_can_be_read_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["in", "a", "--out", "o", "--seed", "4", "--filter.gain", "0.75", "--score-range", "0,5", "--names", "x"]
    with pytest.raises(SystemExit):
        parsed(*words, "--print-config")
    config = tmp_path / "c.yaml"
    config.write_text(capsys.readouterr().out)
    assert parsed("--config", str(config)) == parsed(*words)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("in a --out o --sed 4", "unknown option --sed; did you mean --seed?"),
        ("in a --out o --zzzzz", "unknown option --zzzzz; --help lists them"),
        (
            "in a --out o --seed four",
            "`seed`: expected a valid integer, unable to parse string as an integer, got 'four'",
        ),
        ("in a --out o --seed 1.5", "`seed`: expected a valid integer"),
        ("in a --out o --limit low", "`limit`: expected a valid number"),
        ("in a --out o --limit 0", "`limit`: expected a number greater than 0, got '0'"),
        ("in a --out o --seed", "`seed`: expected a value after it"),
        ("in a --out o --method best", "`method`: expected 'fast' or 'good', got 'best'"),
        ("in a --out o --score-range 1", "`score_range`: "),
        (
            "in a --out o --dry-run=perhaps",
            "`dry_run`: expected bool, got 'perhaps'",
        ),
        ("in a --out o --filter.max-ag 1", "unknown option --filter.max-ag; did you mean --filter.max-age?"),
        ("in a --out o --filter.gain much", "`filter.gain`: expected a valid number"),
        ("in a --out o --filter.gain -1", "`filter.gain`: expected at least 0, got -1.0"),
        (
            "in a --out o --config missing.yaml",
            "`config`: expected YAML of options, name: value at missing.yaml, found no such file",
        ),
        ("in a --out o --config", "--config: expected a file, got nothing"),
        ("in", "missing: RESULTS"),
        ("in a", "missing: `out`"),
    ],
)
def test_mistakes_in_words_get_one_line(words: str, line: str) -> None:
    with pytest.raises(RequestError) as caught:
        parsed(*words.split())
    assert str(caught.value).startswith(line)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("yaml", "line"),
    [
        ("sed: 4", "unknown option --sed; did you mean --seed?"),
        ("filter:\n  age: 4", "unknown option --filter.age"),
        ("seed: four", "`seed`: expected a valid integer, unable to parse string as an integer, got 'four'"),
        ("seed: null", "`seed`: expected a valid integer"),
        ("filter: 3", "`filter`: expected"),
        ("filter:\n  gain: [1]", "`filter.gain`: expected"),
        ("seed: [1", "`config`: {}: expected YAML of options"),
        ("- 1\n- 2", "`config`: {}: expected YAML of options"),
        (
            "seed: 1\nmethod: good\nseed: 2",
            "`config`: {}: expected YAML of options, name: value, got seed twice, line 3",
        ),
        ("a: &a [*a]", "`config`: {}: expected YAML of options, name: value, got an alias of what it stands in"),
        ("method: best", "`method`: expected 'fast' or 'good', got 'best'"),
    ],
)
def test_mistakes_in_yaml_get_one_line(tmp_path: Path, yaml: str, line: str) -> None:
    config = tmp_path / "c.yaml"
    config.write_text(yaml)
    with pytest.raises(RequestError) as caught:
        parsed("in", "a", "--out", "o", "--config", str(config))
    assert str(caught.value).startswith(line.format(config))
    assert "\n" not in str(caught.value)


def help_text(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """The help as one line."""
    assert main(["do", *words]) == 0
    return " ".join(capsys.readouterr().out.split())


def test_help_names_every_option_with_its_default(capsys: pytest.CaptureFixture[str]) -> None:
    text = help_text(capsys, "--help")
    assert text.startswith("usage: tsuiseki do SOURCE RESULTS... [OPTIONS] Do something.")
    for part in ("SOURCE what with", "--out PATH folder to write to (required)", "--seed INT of chance (default: 0)"):
        assert part in text
    for part in ("--dry-run only say it --", "--score-range FLOAT,FLOAT limits (default: 0.0,1.0)", "--help-all"):
        assert part in text
    assert "--limit FLOAT no more" in text
    assert "--filter.max-age" not in text


def test_settings_are_shown_when_everything_is_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    text = help_text(capsys, "--help-all")
    assert "--filter.max-age INT frames (default: 3)" in text
    assert "--filter.smooth also smooth (on by default; --filter.no-smooth turns it off)" in text
    for word in ("--filter.smooth=false", "--filter.no-smooth"):
        assert parsed("video", "result", "--out", "o", word)["filter"].smooth is False


@pytest.mark.parametrize("words", ["CLIP --config DEVICE", "CLIP --config PIPE", "CLIP --detections PIPE", "PIPE"])
def test_devices_and_pipes_are_refused(words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pipe, out = tmp_path / "pipe", tmp_path / "o"
    os.mkfifo(pipe)
    named = words.replace("PIPE", str(pipe)).replace("CLIP", str(tmp_path)).replace("DEVICE", "/dev/zero")
    assert main(["track", "people", *named.split(), "--out", str(out)]) == 2
    assert "expected a file or a folder, but /" in capsys.readouterr().err
    assert not out.exists()


def options_of(words: tuple[str, ...]) -> list[str]:
    """Names of the options of a command, those of its groups too."""
    arguments = command_of(words)[1].assemble_argument_collection(parse_docstring=False)
    return [argument.name for argument in arguments if argument.show]


def test_the_command_line_stays_small() -> None:
    commands = list(all_commands())
    assert len(commands) <= 60
    # Lightning has the options of its trainings itself.
    own = [words for words in commands if command_of(words)[1].help_flags]
    assert sum(len(options_of(words)) for words in own) <= 640


# Of two screens of 24 lines.
SCREENS = 48


# The options of Lightning are its own.
@pytest.mark.parametrize("words", [w for w in all_commands() if command_of(w)[1].help_flags], ids=" ".join)
def test_the_help_of_each_command_fits_two_screens(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # A command keeps the console of its first use, and that the width it began with.
    monkeypatch.setattr(Console, "width", 100)
    assert main([*words, "--help"]) == 0
    assert capsys.readouterr().out.count("\n") <= SCREENS


def group_of(name: str) -> str:
    """The group of settings that an option stands in."""
    return name.rpartition(".")[0]


@pytest.mark.parametrize("words", list(all_commands()), ids=" ".join)
def test_every_option_is_described(words: tuple[str, ...]) -> None:
    arguments = command_of(words)[1].assemble_argument_collection(parse_docstring=True)
    shown = [argument for argument in arguments if argument.show and argument.name not in ("--arguments", "ARGUMENTS")]
    help_of = {argument.name: argument.parameter.help for argument in arguments}
    # An option without a line of its own gets that of its group.
    assert [name for name in (a.name for a in shown) if help_of[name] in (None, "", help_of.get(group_of(name)))] == []
