"""The commands of `tsuiseki train` for networks: LightningCLI with the toolkit's checkpoints, logs and errors."""

from __future__ import annotations

import importlib
import json
import re
import sys
import time
from argparse import Action
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import lightning
from jsonargparse import DefaultHelpFormatter, Namespace
from lightning.pytorch.callbacks import Callback, LearningRateMonitor, ModelCheckpoint
from lightning.pytorch.cli import LightningArgumentParser, LightningCLI
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger

from tsuiseki.tracking.errors import Interrupted, RequestError, RunError
from tsuiseki.tracking.output import RunRecord
from tsuiseki.trainers.best_epoch import BestEpoch
from tsuiseki.trainers.epoch_lines import EpochLines
from tsuiseki.trainers.network_module import interruptible
from tsuiseki.trainers.refusals import check_checkpoint, in_one_line, one_line


@dataclass(frozen=True)
class Task:
    """A network to train.

    Attributes:
        name: of the command.
        module: ``module:class`` of its LightningModule, one of `tsuiseki.training`.
        data: likewise of its LightningDataModule.
        monitor: the validation metric whose largest value makes the best checkpoint.
    """

    name: str
    module: str
    data: str
    monitor: str

    @property
    def module_class(self) -> Any:
        """The LightningModule."""
        return _class(self.module)


DETECTOR = Task("detector", "trainers.detector:Detector", "datamodules.detector:DetectionData", "val/ap")
APPEARANCE = Task("appearance", "trainers.appearance:Appearance", "datamodules.appearance:AppearanceData", "val/map")
ACTION = Task("action", "trainers.action:Action", "datamodules.action:ActionData", "val/map")
ASSOCIATION = Task(
    "association", "trainers.association:Association", "trainers.flow.windows:AssociationData", "val/agreement"
)
TRACKER = Task("tracker", "trainers.tracker:Tracker", "datamodules.tracker:TrackerData", "val/overlap")
# Of the help of ``fit``, which is the default.
DESCRIPTION = """Train by the options of Lightning's CLI. `tsuiseki train {name} --config NAME --out DIR` takes a file
of configs/; for all but tracker, `--data FOLDER --out DIR` fine-tunes on labelled video."""
# Packages of Lightning's loggers whose own errors end a training.
LOGGING = ("wandb", "mlflow", "comet_ml", "neptune")


class ShortHelp(DefaultHelpFormatter):
    """Help without the long lists of subclasses: those of ``nn.Module`` are all of torchvision."""

    def _get_help_string(self, action: Action) -> str:
        return re.sub(r", known subclasses: (?:[^,]*,){12}.*$", ")", str(super()._get_help_string(action)))


class TaskCLI(LightningCLI):
    """The commands of a task; see `fit`, without ``run`` it only builds module, data and Trainer."""

    def __init__(
        self,
        task: Task,
        arguments: Sequence[str],
        complete: Callable[[Namespace], None] | None = None,
        run: bool = True,
    ) -> None:
        self.task, self.complete = task, complete
        self.best: Path | None = None
        super().__init__(
            task.module_class,
            _class(task.data),
            seed_everything_default=0,
            parser_kwargs={
                "exit_on_error": False,
                "prog": f"tsuiseki train {task.name}",
                "description": None,
                "formatter_class": ShortHelp,
                "fit": {"description": DESCRIPTION.format(name=task.name)},
            },
            save_config_kwargs={"overwrite": True},
            args=list(arguments),
            run=run,
            auto_configure_optimizers=False,
        )

    @property
    def options(self) -> Namespace:
        """Of the command."""
        options: Namespace = self.config.get(str(self.subcommand), self.config)
        return options

    @property
    def out(self) -> Path:
        """The folder of results."""
        return Path(self.options.out or "")

    def add_arguments_to_parser(self, parser: LightningArgumentParser) -> None:
        """The arguments that are not Lightning's."""
        parser.add_argument("--out", type=str | None, default=None, help="folder for checkpoints and logs")
        parser.add_argument("--overwrite", type=bool, default=False, help="replace a training in the folder")

    def parse_arguments(self, parser: LightningArgumentParser, args: object) -> None:
        """As LightningCLI does, whatever else stands on the command line."""
        assert isinstance(args, list)
        self.config = parser.parse_args(args)

    def _parse_ckpt_path(self) -> None:
        # A training goes on as it is asked to; its checkpoint does not hold what it started from. To score one, the
        # checkpoint says all of its network.
        if self.config.get("subcommand") not in (None, "fit"):
            super()._parse_ckpt_path()

    def before_instantiate_classes(self) -> None:
        """Refuse what would fail only after minutes of preparation."""
        options, command = self.options, self.subcommand or "fit"
        checkpoint = options.get("ckpt_path")
        if checkpoint is None and command != "fit":
            raise RequestError(f"{command}: expected --ckpt_path, the checkpoint to score")
        if checkpoint is not None and not Path(checkpoint).is_file():
            raise RequestError(f"expected a checkpoint at {checkpoint}, found none; give last.ckpt of a training")
        if checkpoint is not None:
            check_checkpoint(Path(checkpoint))
        if options.out is None and command == "fit":
            raise RequestError("expected --out DIR, the folder for checkpoints and logs")
        if options.out is not None and not options.out.strip():
            raise RequestError("expected --out to be a folder, got an empty name")
        if "weights_only" in options:
            # Of what others made, nothing but tensors and plain values is unpickled.
            options.weights_only = True
        if options.out and self.out.exists() and not self.out.is_dir():
            raise RequestError(f"expected --out to be a folder, but {self.out} is a file")
        occupied = command == "fit" and (self.out / "checkpoints").exists()
        if occupied and checkpoint is None and not options.overwrite:
            raise RequestError(
                f"{self.out} already holds a training; go on with --ckpt_path {self.out}/checkpoints/last.ckpt, "
                "or start anew with --overwrite true"
            )
        if self.complete is not None:
            self.complete(options)

    def instantiate_trainer(self, **kwargs: object) -> lightning.Trainer:
        """The configured trainer; a training gets our callbacks, and our loggers where no others are given."""
        if self.subcommand not in (None, "fit"):
            self.save_config_callback = None
            options = self.options.trainer
            kwargs |= {name: False for name in ("logger", "enable_checkpointing") if options[name] is None}
            return super().instantiate_trainer(**kwargs)
        out, options, on_terminal = str(self.out), self.options.trainer, sys.stdout.isatty()
        ours: dict[str, Any] = {
            "logger": [CSVLogger(out, name="metrics"), TensorBoardLogger(out, name="", version="tensorboard")],
            "default_root_dir": out,
            "enable_progress_bar": on_terminal,
            "enable_model_summary": on_terminal,
        }
        callbacks: list[Callback] = []
        if options.enable_checkpointing is not False:
            best: dict[str, Any] = {"filename": "best", "monitor": self.task.monitor, "mode": "max"}
            # The last by itself: save_last of the best would only follow the best.
            callbacks += [
                kind(self.out / "checkpoints", enable_version_counter=False, **how)
                for kind, how in ((BestEpoch, best), (ModelCheckpoint, {"filename": "last"}))
            ]
        if options.logger is None or options.logger:
            callbacks.append(LearningRateMonitor(logging_interval="epoch"))
        if not (on_terminal or options.enable_progress_bar):
            callbacks.append(EpochLines())
        self.trainer_defaults["callbacks"] = callbacks
        kwargs |= {name: value for name, value in ours.items() if options[name] is None}
        trainer = super().instantiate_trainer(**kwargs)
        for callback in trainer.checkpoint_callbacks:
            # Lightning would put them into the folder of this sitting, where a training that goes on does not search.
            if isinstance(callback, ModelCheckpoint) and callback.dirpath is None:
                callback.dirpath = str(self.out / "checkpoints")
        return trainer

    def fit(self, ckpt_path: Path | str | None = None, **arguments: Any) -> None:
        """Train, and say in ``run.json`` how; an interrupt leaves the checkpoints so far.

        Raises:
            Interrupted: the user ended the training.
            RunError: a logger of another project failed, as without an account.
        """
        start, settings = time.perf_counter(), json.loads(json.dumps(self.options.as_dict(), default=str))
        record = RunRecord(["tsuiseki", "train", self.task.name], settings, seed=int(settings["seed_everything"] or 0))
        try:
            with interruptible():
                self.trainer.fit(ckpt_path=ckpt_path, **arguments)
            if self.trainer.num_training_batches == 0:
                raise RequestError("an epoch has no batch; give a smaller --data.batch_size, or more to learn from")
        except Interrupted as error:
            record.partial, record.reason = True, "interrupted"
            last = self.out / "checkpoints" / "last.ckpt"
            advice = f"go on with --ckpt_path {last}" if last.is_file() else "no epoch was finished"
            raise Interrupted(error.number, advice) from error
        except Exception as error:
            record.partial, record.reason = True, one_line(error)
            if type(error).__module__.partition(".")[0] in LOGGING:
                raise RunError(f"the logger could not go on: {record.reason}") from error
            if (refused := in_one_line(error)) is not None:
                record.reason = str(refused)
                raise refused from error
            raise
        finally:
            if self.trainer.is_global_zero and self.out.is_dir():
                record.seconds = {"training": time.perf_counter() - start}
                record.write(self.out)

    def after_fit(self) -> None:
        """Name the best checkpoint."""
        paths = [
            callback.best_model_path
            for callback in self.trainer.checkpoint_callbacks
            if isinstance(callback, ModelCheckpoint) and callback.monitor == self.task.monitor
        ]
        self.best = Path(paths[0]) if paths and paths[0] else None
        if self.trainer.is_global_zero:
            print("no best checkpoint was kept" if self.best is None else f"best checkpoint: {self.best}")


def _class(place: str) -> Any:
    module, _, name = place.partition(":")
    return getattr(importlib.import_module(f"tsuiseki.{module}"), name)
