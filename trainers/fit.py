"""`tsuiseki train detector`, `appearance`, `action`, `association` and `tracker`."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

from jsonargparse import ArgumentError, Namespace
from lightning.fabric.utilities.exceptions import MisconfigurationException

from tsuiseki.tracking.errors import RequestError
from tsuiseki.trainers.exporting.export import load_module
from tsuiseki.trainers.fine_tune import Recipe, compared, complete_options
from tsuiseki.trainers.network_module import load_checkpoint
from tsuiseki.trainers.own_network import check_class, importable_here
from tsuiseki.trainers.refusals import one_line
from tsuiseki.trainers.request import TrainingRequest
from tsuiseki.trainers.task_cli import ACTION, APPEARANCE, ASSOCIATION, DETECTOR, TRACKER, Task, TaskCLI

# What Lightning warns of, and is meant here: one loader process on a small machine, folders that a training goes on in,
# normalisations that stay as they are, and names by which it calls other libraries.
EXPECTED_WARNINGS = (
    ".*does not have many workers.*",
    ".*isinstance.treespec, LeafSpec.*",
    ".*number of training batches.*smaller than the logging interval.*",
    ".*module.s. in eval mode.*",
    ".*overridden `transfer_batch_to_device`.*",
    ".*Checkpoint directory .* exists and is not empty.*",
    # An epoch without a batch is refused.
    ".*Total length of .* across ranks is zero.*",
    ".*WeightAveraging callback, but loading a checkpoint outside.*",
)


def fit(task: Task, arguments: Sequence[str], complete: Callable[[Namespace], None] | None = None) -> Path | None:
    """Run a command of `LightningCLI`: ``fit`` (the default), ``validate``, ``test`` or ``predict``.

    Besides Lightning's options, these are ``--out DIR`` and ``--overwrite``. ``DIR`` gets
    ``checkpoints/{best,last}.ckpt`` (and what a `ModelCheckpoint` among ``--trainer.callbacks`` keeps),
    ``metrics/version_N/{metrics.csv,config.yaml}`` (N counts the sittings), TensorBoard events and ``run.json``.
    Loggers and views of the progress that ``--trainer.*`` gives are taken instead. ``--data FOLDER`` stands for
    ``--data.train FOLDER``, and without a ``--config`` for the options of ``configs/NAME_fine_tune.yaml``, too.

    Args:
        task: what to train.
        arguments: of the command line.
        complete: fills in options that depend on others, before anything is built.

    Returns:
        The best checkpoint; None where there is none, for want of a validation, say.

    Raises:
        RequestError: an unknown key, a wrong type, a missing file, or an output folder that holds a training.
        Interrupted: the user ended it; the checkpoints so far are kept.
    """
    request = TrainingRequest.of(arguments)
    words = request.words(task.name, tuple(TaskCLI.subcommands()))
    with warnings.catch_warnings(), importable_here():
        for message in EXPECTED_WARNINGS:
            warnings.filterwarnings("ignore", message=message)
        # Lightning calls jsonargparse by names that newer versions discourage.
        warnings.filterwarnings("ignore", category=DeprecationWarning, module="lightning.pytorch.cli")
        logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
        if request.network is not None:
            check_class(request.network)
        try:
            return TaskCLI(task, words, complete).best
        except (ArgumentError, MisconfigurationException, ModuleNotFoundError, ValueError) as error:
            if isinstance(error, RequestError):
                raise
            raise RequestError(one_line(error)) from error


def fit_detector(arguments: Sequence[str]) -> Path | None:
    """Train a detector as the command line ``arguments`` say.

    With ``--data FOLDER`` alone it learns from the shipped detector on nine tenths of each video. The last tenth
    chooses the epoch by AP, among them epoch 0, which is the start. That epoch is exported as ``detector.onnx``, and
    scored on the same tenth, which is therefore a little kind to it.

    Returns:
        The best checkpoint; None where there is none.
    """
    from tsuiseki.trainers.detector import Detector
    from tsuiseki.trainers.exporting.written_networks import model_file

    request = TrainingRequest.of(arguments)
    if request.folder is None or not request.by_recipe or request.network is not None:
        return _exported(DETECTOR, arguments)
    folder, recipe = request.folder, list[Recipe]()
    best = fit(DETECTOR, arguments, lambda options: recipe.append(complete_options(options, folder)))
    if best is None:
        return None
    out = best.parent.parent / "detector.onnx"
    learnt_from = f"{folder.name}, {1 - recipe[0].val_share:.0%} of each video"
    difference = load_module(Detector, best).export(out, training_data=learnt_from, overwrite=True)
    model_file(out).report(out, difference)
    chosen = load_checkpoint(best)
    number = chosen["epoch"] + 1 if chosen["global_step"] else 0
    print(compared({"shipped": recipe[0].start, "yours": out}, recipe[0].held_out, recipe[0].classes, number))
    return best


def fit_appearance(arguments: Sequence[str]) -> Path | None:
    """Train an appearance network as the command line ``arguments`` say; see `fit`.

    With ``--data FOLDER`` the shipped one learns on, and ``DIR`` also gets ``appearance.onnx``, the best.
    """
    return _exported(APPEARANCE, arguments)


def fit_action(arguments: Sequence[str]) -> Path | None:
    """Train an action network as the command line ``arguments`` say; see `fit`.

    With ``--data FOLDER`` the shipped one learns on, and ``DIR`` also gets ``action_rgb_local.onnx`` and so on.
    """
    return _exported(ACTION, arguments)


def fit_tracker(arguments: Sequence[str]) -> Path | None:
    """Train a Siamese tracker on generated pairs as the command line ``arguments`` say; see `fit`."""
    return fit(TRACKER, arguments)


def _exported(task: Task, arguments: Sequence[str]) -> Path | None:
    """The best checkpoint; with ``--data FOLDER`` alone also as ONNX."""
    request = TrainingRequest.of(arguments)
    best = fit(task, arguments)
    if best is not None and request.folder is not None and request.by_recipe:
        out = best.parent.parent / f"{task.name}.onnx"
        load_module(task.module_class, best).export(out, training_data=request.folder.name, overwrite=True)
    return best


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
    held = load_checkpoint(best)
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
