"""The commands that make the shipped models fit together."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest
import yaml

from benchmarks import shipped_models
from benchmarks.shipped_models import DRAWN, SHIPPED, commands, make_models
from tsuiseki.tracking.cli.commands import command_of
from tsuiseki.tracking.cli.request import request_of
from tsuiseki.tracking.errors import RequestError


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


def test_missing_assets_are_told_before_anything_is_trained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shipped_models, "commands", lambda *_: pytest.fail("a command was asked for"))
    with pytest.raises(RequestError, match=r"docs/methods/rendered-people\.md says how to get the packages"):
        make_models(tmp_path / "out", tmp_path)
