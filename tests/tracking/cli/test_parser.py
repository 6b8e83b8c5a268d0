"""Options from function signatures: values arrive typed, from words and from YAML, and mistakes get one line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pytest

from tsuiseki.tracking.cli.parser import help_text as help_of
from tsuiseki.tracking.cli.parser import options_of, parse
from tsuiseki.tracking.errors import RequestError


@dataclass(frozen=True)
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
            raise ValueError(f"expected a gain of at least 0, got {self.gain}")


FILTER = Filter()


def command(
    source: str,
    results: list[Path],
    /,
    out: Path,
    method: Literal["fast", "good"] = "good",
    seed: int = 0,
    score_range: tuple[float, float] = (0.0, 1.0),
    dry_run: bool = False,
    model: Path | None = None,
    limit: float | None = None,
    filter: Filter = FILTER,
) -> None:
    """Do something.

    Args:
        source: what with.
        results: what else.
        out: folder to write to.
        method: how.
        seed: of chance.
        score_range: limits.
        dry_run: only say it.
        model: a file.
        limit: at most.
        filter: settings of the filter.
    """


def parsed(*words: str) -> dict[str, Any]:
    return parse("tsuiseki do", command, words)


def test_words_become_typed_values() -> None:
    values = parsed(
        *[
            "in",
            "a.txt",
            "b.txt",
            "--out",
            "o",
            "--seed",
            "7",
            "--dry-run",
            "--score-range",
            "-1,2.5",
            "--filter.max-age",
            "9",
            "--model=m.onnx",
        ]
    )
    assert values == {
        "source": "in",
        "results": [Path("a.txt"), Path("b.txt")],
        "out": Path("o"),
        "method": "good",
        "seed": 7,
        "score_range": (-1.0, 2.5),
        "dry_run": True,
        "model": Path("m.onnx"),
        "limit": None,
        "filter": Filter(max_age=9),
    }


def test_dashes_and_underscores_are_the_same() -> None:
    assert parsed(*["in", "a", "--out", "o", "--dry_run", "--filter.max_age=2"]) == parsed(
        *["in", "a", "--out", "o", "--dry-run", "--filter.max-age", "2"]
    )


def test_every_option_also_comes_from_yaml_and_words_win(tmp_path: Path) -> None:
    config = tmp_path / "c.yaml"
    config.write_text(
        "source: in\nresults: [a]\nout: o\nseed: 5\nmethod: fast\ndry_run: true\nscore_range: [0, 9]\n"
        "filter:\n  max_age: 8\n  gain: 0.25\n"
    )
    values = parsed("--config", str(config), "--seed", "6")
    assert (values["source"], values["results"], values["out"]) == ("in", [Path("a")], Path("o"))
    assert (values["seed"], values["method"], values["dry_run"]) == (6, "fast", True)
    assert (values["score_range"], values["filter"]) == ((0.0, 9.0), Filter(8, 0.25))


def test_the_printed_configuration_can_be_read_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["in", "a", "--out", "o", "--seed", "4", "--filter.gain", "0.75"]
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
        ("in a --out o --seed four", "--seed: expected a whole number, got 'four'"),
        ("in a --out o --seed 1.5", "--seed: expected a whole number, got '1.5'"),
        ("in a --out o --limit low", "--limit: expected a number, got 'low'"),
        ("in a --out o --seed", "argument --seed: expected one argument"),
        ("in a --out o --method best", "--method: expected one of 'fast', 'good', got 'best'"),
        ("in a --out o --score-range 1", "--score-range: expected 2 numbers separated by commas"),
        ("in a --out o --dry-run=perhaps", "--dry-run: expected True or False, got 'perhaps'"),
        ("in a --out o --filter.max-ag 1", "unknown option --filter.max-ag; did you mean --filter.max-age?"),
        ("in a --out o --filter.gain much", "--filter.gain: expected a number, got 'much'"),
        ("in a --out o --filter.gain -1", "--filter.gain: expected a gain of at least 0, got -1.0"),
        ("in a --out o --config missing.yaml", "`config`: cannot read missing.yaml"),
        ("in", "missing: RESULTS, --out"),
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
        ("seed: four", "--seed: expected a whole number, got 'four'"),
        ("filter: 3", "filter: expected options of its own below it, got 3"),
        ("seed: [1", "`config`: expected YAML of options"),
        ("- 1\n- 2", "`config`: expected YAML of options"),
        ("method: best", "--method: expected one of 'fast', 'good', got 'best'"),
    ],
)
def test_mistakes_in_yaml_get_one_line(tmp_path: Path, yaml: str, line: str) -> None:
    config = tmp_path / "c.yaml"
    config.write_text(yaml)
    with pytest.raises(RequestError) as caught:
        parsed("in", "a", "--out", "o", "--config", str(config))
    assert str(caught.value).startswith(line)
    assert "\n" not in str(caught.value)


def help_text(*words: str) -> str:
    """The help as one line."""
    text = help_of("tsuiseki do", "Do something.", options_of(command), every_option=bool(words))
    return " ".join(text.split())


def test_help_names_every_option_with_its_default() -> None:
    text = help_text()
    assert text.startswith("usage: tsuiseki do SOURCE RESULTS … --out DIR [options] Do something.")
    for part in ("SOURCE what with", "--out DIR folder to write to (required)", "--seed N of chance (default: 0)"):
        assert part in text
    for part in ("--dry-run only say it --", "--score-range X,X limits (default: 0.0,1.0)", "--help-all"):
        assert part in text
    assert "type:" not in text
    assert "null" not in text


def test_settings_are_shown_when_everything_is_asked_for() -> None:
    assert "--filter.max-age" not in help_text()
    assert "--filter.max-age N frames (default: 3)" in help_text("--help-all")
    assert "--filter.smooth also smooth (on by default; =false turns it off)" in help_text("--help-all")
    assert parsed("video", "result", "--out", "o", "--filter.smooth=false")["filter"].smooth is False
    with pytest.raises(SystemExit):
        parsed("--help-all")
