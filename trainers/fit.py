"""`tsuiseki train` for networks: LightningCLI with the toolkit's checkpoints, logs and errors."""

from __future__ import annotations

import importlib
import json
import logging
import re
import sys
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import lightning
import torch
from jsonargparse import ArgumentError
from lightning.fabric.utilities.exceptions import MisconfigurationException
from lightning.pytorch.callbacks import Callback, LearningRateMonitor, ModelCheckpoint
from lightning.pytorch.cli import LightningArgumentParser, LightningCLI
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger

from tsuiseki.tracking.cli.config import named_config
from tsuiseki.tracking.errors import Interrupted, RequestError, RunError, lacks_memory
from tsuiseki.tracking.output import RunRecord
from tsuiseki.trainers.fine_tune import fine_tune, folder_of
from tsuiseki.trainers.network_module import interruptible


@dataclass(frozen=True)
class Task:
    """What `fit` trains.

    Attributes:
        name: of the sub-command.
        model: ``module:class`` of its LightningModule.
        data: likewise of its LightningDataModule.
        monitor: the validation metric whose largest value makes the best checkpoint.
        links: arguments of the model that the data takes over, and what they are called there.
        folders: argument of the data for what ``--data FOLDER`` names; empty where there is none.
    """

    name: str
    model: str
    data: str
    monitor: str
    links: Mapping[str, str] = field(default_factory=dict)
    folders: str = ""


DETECTOR = Task(
    "detector",
    "trainers.detector:Detector",
    "datamodules.detector:DetectionData",
    "val/ap50",
    {"classes": "classes", "height": "height", "width": "width", "resize": "resize"},
)
APPEARANCE = Task(
    "appearance",
    "trainers.appearance:Appearance",
    "datamodules.appearance:AppearanceData",
    "val/map",
    {"height": "height", "width": "width"},
    "train_folders",
)
ACTION = Task(
    "action",
    "trainers.action:Action",
    "datamodules.action:ActionData",
    "val/map",
    {"streams": "streams", "size": "cutting.size", "flow": "cutting.flow"},
)
ASSOCIATION = Task(
    "association",
    "trainers.association:Association",
    "trainers.flow.windows:AssociationData",
    "val/agreement",
    folders="train",
)
# Packages of Lightning's loggers whose own errors end a training.
LOGGING = ("wandb", "mlflow", "comet_ml", "neptune")
CONFIG = ("--config", "-c")
# What a training that goes on needs of a checkpoint.
CHECKPOINT_PARTS = {"state_dict", "optimizer_states", "lr_schedulers", "loops", "pytorch-lightning_version"}
# How torch says that weights, or what moves them, are another network's.
FOREIGN_WEIGHTS = ("Error(s) in loading state_dict", "loaded state dict")
SCORING = ("validate", "test")


def fit_detector(arguments: Sequence[str]) -> Path | None:
    """Train a detector as the command line ``arguments`` say.

    With --data FOLDER a shipped detector learns from labelled video; see `fine_tune`.

    Returns:
        The best checkpoint; None where `fit` gives none.
    """
    folder, words = folder_of(arguments)
    return fit(DETECTOR, words) if folder is None else fine_tune(words, folder, partial(fit, DETECTOR))


def fit_appearance(arguments: Sequence[str]) -> Path | None:
    """Train an appearance network as the command line ``arguments`` say; see `fit`."""
    return fit(APPEARANCE, arguments)


def fit_action(arguments: Sequence[str]) -> Path | None:
    """Train an action network as the command line ``arguments`` say; see `fit`."""
    return fit(ACTION, arguments)


def fit_association(arguments: Sequence[str]) -> Path | None:
    """Train an association network as the command line ``arguments`` say, and export it; see `fit`.

    ``DIR`` also gets ``association.onnx``, the best network as the tracker takes it, and ``appearance.onnx`` and
    ``detector.onnx`` where the Siamese network and the detector's heads were trained with it.
    """
    from tsuiseki.trainers.exporting.export_costs import export_trained

    best = fit(ASSOCIATION, arguments)
    if best is None:
        return None
    out = best.parent.parent
    held = torch.load(best, map_location="cpu", weights_only=True)
    appearance, detector = (
        out / f"{name}.onnx" if held.get(part) is not None else None
        for name, part in (("appearance", "siamese"), ("detector", "detector"))
    )
    # A training that was stopped by a callback or by the time has ended as it was asked to.
    export_trained(
        checkpoint=best,
        out=out / "association.onnx",
        appearance=appearance,
        detector=detector,
        unfinished=True,
        overwrite=True,
    )
    return best


def fit(task: Task, arguments: Sequence[str]) -> Path | None:
    """Train as the command line ``arguments`` say.

    Besides ``--config FILE``, ``--data FOLDER``, ``--trainer.*``, ``--model.*`` and ``--data.*`` these are
    ``--out DIR``, ``--ckpt_path FILE`` (go on from there) and ``--overwrite``.

    ``DIR`` gets ``checkpoints/{best,last}.ckpt`` (and what a `ModelCheckpoint` among ``--trainer.callbacks`` keeps),
    ``metrics/version_N/{metrics.csv,config.yaml}`` (N counts the sittings), TensorBoard events and ``run.json``.
    Loggers and views of the progress that ``--trainer.*`` gives are taken instead. With ``validate`` or ``test`` as the
    first word, the checkpoint is only scored.

    Returns:
        The best checkpoint; None where this training kept none, for want of a validation, say.

    Raises:
        RequestError: an unknown key, a wrong type, a missing file, or an output folder that holds a training.
        Interrupted: the user ended it; the checkpoints so far are kept.
    """
    with warnings.catch_warnings():
        # Lightning advises more loader processes than a small machine has cores for.
        warnings.filterwarnings("ignore", message=".*does not have many workers.*")
        warnings.filterwarnings("ignore", message=".*isinstance.treespec, LeafSpec.*")
        warnings.filterwarnings("ignore", message=".*number of training batches.*smaller than the logging interval.*")
        # The Siamese network keeps its normalisations as they are.
        warnings.filterwarnings("ignore", message=".*module.s. in eval mode.*")
        warnings.filterwarnings("ignore", message=".*overridden `transfer_batch_to_device`.*")
        warnings.filterwarnings("ignore", message=".*Checkpoint directory .* exists and is not empty.*")
        # An epoch without a batch is refused.
        warnings.filterwarnings("ignore", message=".*Total length of .* across ranks is zero.*")
        warnings.filterwarnings("ignore", message=".*WeightAveraging callback, but loading a checkpoint outside.*")
        # Lightning calls jsonargparse by names that newer versions discourage.
        warnings.filterwarnings("ignore", category=DeprecationWarning, module="lightning.pytorch.cli")
        logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
        scoring = arguments[0] if arguments and arguments[0] in SCORING else None
        cli = _parse(task, arguments if scoring is None else arguments[1:])
        if scoring is not None:
            _score(cli, scoring)
            return None
        _fit(task, cli)
    checkpoint = next(
        (c for c in cli.trainer.checkpoint_callbacks if getattr(c, "monitor", None) == task.monitor), None
    )
    best = (
        Path(checkpoint.best_model_path)
        if isinstance(checkpoint, ModelCheckpoint) and checkpoint.best_model_path
        else None
    )
    if cli.trainer.is_global_zero:
        print("no best checkpoint was kept" if best is None else f"best checkpoint: {best}")
    return best


def _score(cli: TaskCLI, scoring: str) -> None:
    """Validate or test the checkpoint; Lightning prints the scores."""
    checkpoint = cli.config.ckpt_path
    if checkpoint is None:
        raise RequestError(f"{scoring}: expected --ckpt_path, the checkpoint to score")
    try:
        getattr(cli.trainer, scoring)(
            cli.model, datamodule=cli.datamodule, ckpt_path=str(checkpoint), weights_only=True
        )
    except MisconfigurationException as error:
        raise RequestError(one_line(error)) from error


def _fit(task: Task, cli: TaskCLI) -> None:
    """Train, and say in ``run.json`` how; an interrupt leaves the checkpoints so far.

    Raises:
        Interrupted: the user ended the training.
        RunError: a logger of another project failed, as without an account.
    """
    checkpoint, start = cli.config.ckpt_path, time.perf_counter()
    settings = json.loads(json.dumps(cli.config.as_dict(), default=str))
    record = RunRecord(["tsuiseki", "train", task.name], settings, seed=int(settings.get("seed_everything") or 0))
    try:
        with interruptible():
            path = None if checkpoint is None else str(checkpoint)
            cli.trainer.fit(cli.model, datamodule=cli.datamodule, ckpt_path=path, weights_only=True)
        if cli.trainer.num_training_batches == 0:
            raise RequestError("an epoch has no batch; give a smaller --data.batch_size, or more to learn from")
    except Interrupted as error:
        record.partial, record.reason = True, "interrupted"
        last = cli.out / "checkpoints" / "last.ckpt"
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
        if cli.trainer.is_global_zero and cli.out.is_dir():
            record.seconds = {"training": time.perf_counter() - start}
            record.write(cli.out)


def check_checkpoint(path: Path) -> None:
    """Refuse a file that is no checkpoint of a training; nothing but tensors and plain values is unpickled.

    Raises:
        RequestError: it is none.
    """
    try:
        held = torch.load(path, map_location="meta", weights_only=True)
    except Exception as error:  # torch reads bytes as orders, so that a foreign file may end in any error
        if lacks_memory(error):
            raise
        raise RequestError(f"{path}: expected a checkpoint of a training, got something else") from error
    missing = sorted(CHECKPOINT_PARTS - set(held)) if isinstance(held, dict) else ["parts of a training"]
    if missing:
        raise RequestError(f"{path}: expected a checkpoint of a training, found no {missing[0]} in it")


def in_one_line(error: Exception) -> RequestError | None:
    """What a training refused in a process that prepares images, or of a checkpoint; None where it is neither."""
    text = str(error)
    if isinstance(error, RequestError) and "\n" in text:
        # Torch puts the trace of the process before the message.
        return RequestError(text.rpartition("RequestError: ")[2].strip())
    if text.startswith(FOREIGN_WEIGHTS):
        return RequestError(f"--ckpt_path: expected a checkpoint of this network, got another: {one_line(error)[:200]}")
    return None


class TaskCLI(LightningCLI):
    """Parses, builds model, data and trainer; `fit` runs them."""

    def __init__(self, task: Task, arguments: Sequence[str]) -> None:
        self.task = task
        super().__init__(
            _class(task.model),
            _class(task.data),
            seed_everything_default=0,
            parser_kwargs={"exit_on_error": False, "prog": f"tsuiseki train {task.name}", "description": None},
            save_config_kwargs={"overwrite": True},
            args=_with_named_configs(arguments),
            run=False,
            auto_configure_optimizers=False,
        )

    @property
    def out(self) -> Path:
        """The folder of results."""
        return Path(self.config.out)

    def add_arguments_to_parser(self, parser: LightningArgumentParser) -> None:
        """The arguments that are not Lightning's."""
        parser.add_argument("--out", type=str, required=True, help="folder for checkpoints and logs")
        parser.add_argument("--ckpt_path", type=Path | None, default=None, help="checkpoint to go on from")
        parser.add_argument("--overwrite", type=bool, default=False, help="replace a training in the folder")
        for ours, theirs in self.task.links.items():
            parser.link_arguments(f"model.{ours}", f"data.{theirs}")

    def parse_arguments(self, parser: LightningArgumentParser, args: object) -> None:
        """As LightningCLI does, whatever else stands on the command line."""
        assert isinstance(args, list)
        self.config = parser.parse_args(args)

    def before_instantiate_classes(self) -> None:
        """Refuse what would fail only after minutes of preparation."""
        checkpoint = self.config.ckpt_path
        if checkpoint is not None and not checkpoint.is_file():
            raise RequestError(f"expected a checkpoint at {checkpoint}, found none; give last.ckpt of a training")
        if checkpoint is not None:
            check_checkpoint(checkpoint)
        if not self.config.out.strip():
            raise RequestError("expected --out to be a folder, got an empty name")
        if self.out.exists() and not self.out.is_dir():
            raise RequestError(f"expected --out to be a folder, but {self.out} is a file")
        occupied = (self.out / "checkpoints").exists()
        if occupied and checkpoint is None and not self.config.overwrite:
            raise RequestError(
                f"{self.out} already holds a training; go on with --ckpt_path {self.out}/checkpoints/last.ckpt, "
                "or start anew with --overwrite true"
            )

    def instantiate_trainer(self, **kwargs: object) -> lightning.Trainer:
        """The configured trainer with our callbacks added, and our loggers where no others are given."""
        out, options, on_terminal = str(self.out), self.config.trainer, sys.stdout.isatty()
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
                ModelCheckpoint(self.out / "checkpoints", enable_version_counter=False, **how)
                for how in (best, {"filename": "last"})
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


class EpochLines(Callback):
    """One plain line an epoch, for logs and wherever there is no terminal."""

    def __init__(self) -> None:
        self._start = 0.0
        self._trained = 0.0

    def on_train_epoch_start(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        del trainer, pl_module
        self._start, self._trained = time.perf_counter(), 0.0

    def on_validation_start(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        del trainer, pl_module
        self._trained = time.perf_counter() - self._start

    def on_train_epoch_end(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        """Print the metrics of the epoch."""
        del pl_module
        if not trainer.is_global_zero:
            return
        values = "  ".join(f"{k} {float(v):.4g}" for k, v in sorted(trainer.callback_metrics.items()))
        trained = self._trained or time.perf_counter() - self._start
        pace = f"{trainer.num_training_batches / max(trained, 1e-9):.2f} batches/s"
        print(f"epoch {trainer.current_epoch + 1}/{trainer.max_epochs}  {values}  {pace}", flush=True)


def _with_named_configs(arguments: Sequence[str]) -> list[str]:
    """The arguments with the paths of configurations that are given by name."""
    words = list(arguments)
    for number, word in enumerate(words):
        if number and words[number - 1] in CONFIG:
            words[number] = str(named_config(word))
        elif word.startswith("--config="):
            words[number] = f"--config={named_config(word.partition('=')[2])}"
    return words


def _class(place: str) -> Any:
    module, _, name = place.partition(":")
    return getattr(importlib.import_module(f"tsuiseki.{module}"), name)


def _parse(task: Task, arguments: Sequence[str]) -> TaskCLI:
    folder, words = folder_of(arguments) if task.folders else (None, arguments)
    if folder is not None:
        if not folder.exists():
            raise RequestError(f"expected labelled video at {folder}, found none")
        arguments = [*words, f"--data.{task.folders}={json.dumps([str(folder)])}"]
    try:
        return TaskCLI(task, arguments)
    except (ArgumentError, MisconfigurationException, ModuleNotFoundError, ValueError) as error:
        if isinstance(error, RequestError):
            raise
        raise RequestError(one_line(error)) from error


def one_line(error: Exception) -> str:
    """The message of a parser's ``error`` without its line breaks, and without the types that were not meant."""
    reason = re.search(r"^  - (.+(?:\n    +.+)*)", str(error), re.MULTILINE)
    return " ".join((str(error) if reason is None else reason[1]).split())
