"""What `tsuiseki train` takes beside the options of LightningCLI: names of files of options, and ``--data FOLDER``.

jsonargparse knows neither a default subcommand nor an option that brings other options along. So the standard library's
`parse_known_args` takes these few words out, and all others go to LightningCLI as they are.
"""

from __future__ import annotations

from argparse import ArgumentError, ArgumentParser
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tsuiseki.tracking.cli.config import named_config
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.yolo import ABOUT


@dataclass(frozen=True)
class TrainingRequest:
    """The words of a command.

    Attributes:
        configs: files of options; a later one wins over those before it.
        data: file of options of the data module; None without.
        folder: of labelled video to learn from, in its place; None without. YOLO's ``data.yaml`` stands for its folder.
        network: class of the user's own network; None without.
        others: all other words. They win over the files.
    """

    configs: tuple[Path, ...]
    data: Path | None
    folder: Path | None
    network: str | None
    others: tuple[str, ...]

    @classmethod
    def of(cls, arguments: Sequence[str]) -> TrainingRequest:
        """The request of a command line.

        Raises:
            RequestError: a configuration is unknown, or ``--data`` names no folder.
        """
        parser = ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
        parser.add_argument("--config", "-c", action="append", default=[])
        parser.add_argument("--data", nargs="?", const="")
        parser.add_argument("--model.network", "--model.network.class_path", dest="network")
        try:
            options, others = parser.parse_known_args(arguments)
        except ArgumentError as error:
            raise RequestError(str(error)) from error
        data, folder = (None, None) if options.data is None else _data_or_folder(options.data)
        return cls(tuple(map(named_config, options.config)), data, folder, options.network, tuple(others))

    @property
    def by_recipe(self) -> bool:
        """Whether the training is the default one of a folder of labelled video."""
        return self.folder is not None and not self.configs

    def words(self, name: str, commands: Sequence[str]) -> list[str]:
        """The words for LightningCLI, whose subcommand is ``fit`` where none of the ``commands`` comes first.

        Args:
            name: of the network, whose recipe ``configs/NAME_fine_tune.yaml`` or ``configs/NAME_own.yaml`` is taken
                where the training is the default one.
            commands: subcommands of LightningCLI.
        """
        recipe = f"{name}_fine_tune" if self.network is None else f"{name}_own"
        configs = [named_config(recipe)] if self.by_recipe else self.configs
        words = [f"--config={config}" for config in configs]
        words += [] if self.data is None else [f"--data={self.data}"]
        words += [] if self.folder is None else [f"--data.train={self.folder}"]
        words += [] if self.network is None else [f"--model.network={self.network}"]
        command = self.others[:1] if self.others[:1] in [(command,) for command in commands] else ()
        return [*(command or ("fit",)), *words, *self.others[len(command) :]]


def _data_or_folder(value: str) -> tuple[Path | None, Path | None]:
    """The file of options, or the folder of labelled video, that ``--data`` names."""
    if not value:
        raise RequestError("expected a folder of labelled video after `data`, got nothing")
    path = Path(value)
    if path.name != ABOUT and path.suffix in (".yaml", ".yml"):
        return path, None
    folder = path.parent if path.name == ABOUT else path
    if not folder.exists():
        raise RequestError(f"expected labelled video at {folder}, found none")
    return None, folder
