"""`tsuiseki demo` leaves what it promises."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.cli.commands import command_of
from tsuiseki.tracking.cli.request import request_of
from tsuiseki.tracking.evaluation.result_files import read_truths
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.video.source import open_source
from tsuiseki.trainers.shipped_models import DRAWN, SHIPPED, commands


@pytest.fixture
def small_models(inputs: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The small models of these tests in place of the shipped ones."""
    monkeypatch.setattr("tsuiseki.tracking.weights.shipped", lambda name: getattr(inputs, name.split("_")[0]))


@pytest.mark.slow
@pytest.mark.usefixtures("small_models")
def test_demo_leaves_a_result_for_each_method_and_a_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "demo"
    assert main(["demo", "--frames", "8", "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    for method, name in (("sort", "SORT"), ("deepsort", "DeepSORT"), ("flow", "Min-cost flow")):
        assert len(read_tracks(out / method / "tracks.txt")) == 1
        record = json.loads((out / method / "run.json").read_text())
        assert record["settings"]["method"] == method
        assert name in shown
    assert len(list(open_source(out / "overlay.webm").frames())) == 8
    assert read_truths(out / "street")[0].length == 8
    page = (out / "report.html").read_text()
    assert "data:video/webm;base64," in page
    assert "Min-cost flow" in page
    assert main(["demo", "--out", str(out)]) == 2
    assert "already holds" in capsys.readouterr().err


@pytest.mark.slow
def test_demo_with_the_shipped_models(tmp_path: Path) -> None:
    """Some of the people are found, and followed."""
    assert main(["demo", "--frames", "20", "--out", str(tmp_path / "demo")]) == 0
    assert main(["evaluate", "people", str(tmp_path / "demo" / "street"), str(tmp_path / "demo" / "flow"),
                 "--json", str(tmp_path / "s.json")]) == 0  # fmt: skip
    scores = json.loads((tmp_path / "s.json").read_text())["flow"]["combined"]
    assert scores["recall"] > 0.5
    assert scores["precision"] > 0.7


@pytest.mark.parametrize("rendered", [False, True])
def test_the_commands_that_make_the_shipped_models_are_sound(tmp_path: Path, rendered: bool) -> None:
    """Their configurations exist, their options are known, and every shipped file comes out."""
    made = set()
    for kind, what, *words in commands(tmp_path, tmp_path if rendered else None):
        for option, value in itertools.pairwise(words):
            assert option != "--config" or Path(value).is_file()
            made |= {Path(value).name} if option == "--out" else set()
        if command_of([kind, what])[1].help_flags:
            request_of([kind, what, *words])
    assert set((SHIPPED if rendered else DRAWN).values()) <= made
    assert "detector_street.onnx" in made
    assert ("detector_figures.onnx" in made) == rendered


@pytest.mark.parametrize("rendered", [False, True])
def test_each_command_that_makes_the_shipped_models_finds_what_it_needs(tmp_path: Path, rendered: bool) -> None:
    """Every file that a command reads is given, or an earlier command has written it under that very name."""
    there = {str(tmp_path), str(tmp_path / "photographs")}
    for kind, what, *words in commands(tmp_path, tmp_path if rendered else None):
        options = dict(itertools.pairwise(words))
        config = yaml.safe_load(Path(options["--config"]).read_text()) if "--config" in options else {}
        needed = [options[o] for o in ("--checkpoint", "--blend", "--calibrate", "--detector", "--appearance",
                                       "--folders", "--assets", "--model.start", "--model.teacher.file")
                  if options.get(o, "null") != "null"]  # fmt: skip
        sources = [
            source
            for part in ("train", "val")
            for source in yaml.safe_load(options.get(f"--data.{part}", "null")) or config.get("data", {}).get(part, [])
        ]
        needed += [source[of] for source in sources for of in ("sprites", "photographs") if source.get(of)]
        for path in needed:
            assert path in there, f"{kind} {what} needs {path}, which nothing before it has made"
        there |= {source["folder"] for source in sources if source.get("generate")}
        out = Path(options["--out"])
        there |= {str(out)} | ({str(out.parent)} if kind == "simulate" else set())
        if kind == "train":
            epochs = int(options.get("--trainer.max_epochs", config["trainer"]["max_epochs"])) if config else 0
            saved = [c["init_args"] for c in config.get("trainer", {}).get("callbacks", [])
                     if c["class_path"].endswith("ModelCheckpoint")]  # fmt: skip
            there |= {str(out / "checkpoints" / f"{name}.ckpt") for name in ("best", "last")}
            there |= {
                str(out / "checkpoints" / f"epoch={n - 1}.ckpt")
                for each in saved
                for n in range(each["every_n_epochs"], epochs + 1, each["every_n_epochs"])
            }


def test_missing_assets_are_told_before_anything_is_trained(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tsuiseki.trainers.shipped_models.commands", lambda *_: pytest.fail("a command was asked for"))
    words = ["demo", "--train", "--assets", str(tmp_path), "--out", str(tmp_path / "out")]
    assert main(words) == 2
    assert "docs/methods/rendered-people.md says how to get the packages" in capsys.readouterr().err


def test_assets_are_for_training(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["demo", "--assets", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "which renders people of it; leave it out otherwise" in capsys.readouterr().err
