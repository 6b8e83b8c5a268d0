"""`tsuiseki export detector`, `appearance`, `action` and `tracker`: networks of pictures, as ONNX."""

from __future__ import annotations

import dataclasses
import pickle
import tempfile
from pathlib import Path
from typing import Annotated, Literal, cast

import torch
from pydantic import PositiveInt

from tsuiseki.models.backbones import TrunkName
from tsuiseki.models.detector import AnchorDetector, BranchedDetector, OneClass
from tsuiseki.models.ssd import CocoArchitecture, coco_person_detector
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.fields import HIDDEN
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.trainers.action import Action
from tsuiseki.trainers.appearance import Appearance
from tsuiseki.trainers.detector import Detector
from tsuiseki.trainers.detector_network import (
    COCO_NORMALISATIONS,
    FIXED_SIDES,
    OF_BRANCH,
    build_detector,
    detector_card,
    take_over,
)
from tsuiseki.trainers.exporting.export import ModelFile, ModelFiles, export_onnx, load_module
from tsuiseki.trainers.exporting.exported_weights import exported_weights, fold_normalisations, layout_of
from tsuiseki.trainers.exporting.written_networks import (
    OUTPUTS,
    RawHeads,
    write_appearance,
    write_detector,
    write_tracker,
)
from tsuiseki.trainers.tracker import Tracker


def export_detector(
    output: ModelFile,
    checkpoint: Path | None = None,
    weights: Literal["coco"] | None = None,
    architecture: Annotated[CocoArchitecture, HIDDEN] = "ssdlite320",
    state: Annotated[Path | None, HIDDEN] = None,
    calibrate: Path | None = None,
    height: PositiveInt | None = None,
    width: PositiveInt | None = None,
    blend: Path | None = None,
) -> float:
    """Write a detector as ONNX, and check that it gives what torch gives.

    Either from a checkpoint of your own, or from torchvision's COCO-trained weights, of which the person class is kept:
    with those, your own street video works on the first day.

    Args:
        checkpoint: best.ckpt of tsuiseki train detector; or a detector that was exported from one (.onnx), for another
            input size or a blend.
        weights: coco downloads torchvision's weights.
        architecture: of the COCO weights.
        state: file of those weights, for a machine that cannot download them.
        calibrate: MOTChallenge folder of labelled pictures; scores become probabilities of a person there.
        height: of the input, pixels, where another than in training; with --width.
        width: likewise; a larger input finds smaller people and takes longer.
        blend: exported detector of the same structure, such as the one that the training started from; each weight
            becomes the mean of both (Wortsman et al., Robust fine-tuning of zero-shot models, 2022).

    Returns:
        The largest relative difference to torch that the parity check saw.

    Raises:
        RequestError: not exactly one of checkpoint and weights, a missing or foreign file, no connection.
        RunError: the exported file does not give what torch gives.
    """
    if (height is None) != (width is None):
        raise RequestError("expected `height` and `width` together, got one of them")
    if (checkpoint is None) == (weights is None):
        raise RequestError("expected either one of `checkpoint` and `weights`")
    if blend is not None and checkpoint is None:
        raise RequestError("expected `blend` with `checkpoint`, got it alone")
    size = None if height is None or width is None else (height, width)
    network, card = _coco(architecture, state) if checkpoint is None else _trained(checkpoint, size)
    if blend is not None:
        blend_weights(network, card, blend)
        # That of neither is that of the mean.
        settings = {name: value for name, value in card.settings.items() if name != "branch_calibration"}
        card = dataclasses.replace(card, settings=settings)
    data, licence = output.training_data or card.training_data, output.licence or card.licence
    card = dataclasses.replace(card, training_data=data, licence=licence)
    difference = write_detector(network, card, output, calibrate)
    output.report(output.out, difference)
    return difference


def write_checkpoint(checkpoint: Path, out: Path) -> None:
    """Write the detector of a training as ONNX; errors are those of `export_detector`."""
    network, card = _trained(checkpoint, None)
    write_detector(network, card, ModelFile(out=out))


def _trained(checkpoint: Path, size: tuple[int, int] | None) -> tuple[AnchorDetector | OneClass, ModelCard]:
    try:
        if checkpoint.suffix == ".onnx":
            return _exported(checkpoint, size)
        module = load_module(Detector, checkpoint, size)
    except ValueError as error:  # the network does not take this size
        raise RequestError(str(error)) from error
    return module.network, module.card


def _exported(path: Path, size: tuple[int, int] | None) -> tuple[AnchorDetector, ModelCard]:
    """What was written to ``path``, the calibration of its scores folded into its weights."""
    layout = layout_of(path, people=False, branched=True)
    card = layout.card
    height, width = layout.size if size is None else size
    parts = cast(TrunkName, layout.trunk), None, (height, width), layout.anchors, layout.channels
    network = build_detector(layout.architecture, *parts, len(card.class_names))
    if missing := take_over(network, path):
        raise RequestError(f"{path}: expected a trained detector, got no weights for {', '.join(missing[:3])}")
    fold_normalisations(network)
    settings = {name: value for name, value in card.settings.items() if name != "score_calibration"}
    return network.eval(), dataclasses.replace(card, input_height=height, input_width=width, settings=settings)


def blend_weights(network: AnchorDetector | OneClass, card: ModelCard, path: Path) -> None:
    """Make the weights of ``network`` the means of its own and of those in the exported detector at ``path``.

    Exported weights have the normalisations folded into them, so both are in the same form.
    """
    if not isinstance(network, AnchorDetector | OneClass):
        raise RequestError(f"`blend`: expected a detector with heads at anchors in `checkpoint`, got {card.name}")
    with tempfile.TemporaryDirectory() as folder:
        checkpoint_file = Path(folder) / "own.onnx"
        export_onnx(
            RawHeads(network), card, checkpoint_file, torch.zeros(2, 3, card.input_height, card.input_width), OUTPUTS
        )
        first, second = (
            {name: values for name, values in exported_weights(file).items() if name != "anchors"}
            for file in (checkpoint_file, path)
        )
    if not isinstance(network, BranchedDetector):
        # Of a detector with a branch that of people is taken.
        second = {name: values for name, values in second.items() if not name.startswith(OF_BRANCH)}
    if {name: values.shape for name, values in first.items()} != {
        name: values.shape for name, values in second.items()
    }:
        raise RequestError(f"`blend`: expected a detector of the structure of `checkpoint`, got another in {path}")
    network.load_state_dict({name: (values + second[name]) / 2 for name, values in first.items()}, strict=False)
    fold_normalisations(network)


def _coco(architecture: CocoArchitecture, state: Path | None) -> tuple[AnchorDetector | OneClass, ModelCard]:
    if state is not None and not state.is_file():
        raise RequestError(f"expected a state dict at {state}, found none")
    try:
        network = coco_person_detector(architecture, state)
    except (ConnectionError, ValueError, pickle.UnpicklingError) as error:
        raise RequestError(str(error)) from error
    side = FIXED_SIDES[architecture]
    card = detector_card(f"{architecture}-coco", (side, side), "stretch", COCO_NORMALISATIONS[architecture])
    return network.eval(), dataclasses.replace(card, training_data="COCO 2017, torchvision's weights")


def export_appearance(output: ModelFile, checkpoint: Path) -> float:
    """Write an appearance network as ONNX, and check that it gives what torch gives.

    Args:
        checkpoint: best.ckpt of tsuiseki train appearance.

    Returns:
        The largest relative difference to torch that the parity check saw.

    Raises:
        RequestError: a missing or foreign file.
        RunError: the exported file does not give what torch gives.
    """
    module = load_module(Appearance, checkpoint)
    difference = write_appearance(module.network, module.card, output)
    output.report(output.out, difference)
    return difference


def export_action(output: ModelFiles, checkpoint: Path) -> dict[Path, float]:
    """Write the streams of an action network as ONNX, a file each, and check that they give what torch gives.

    Streams that were trained jointly (model.fused) are written into one file more, which takes the crops of all.

    Args:
        output.out: ONNX file to write; action.onnx becomes action_rgb_local.onnx, action_rgb_global.onnx and so on, and
            action_fused.onnx.
        checkpoint: best.ckpt of tsuiseki train action.

    Returns:
        Of each file that was written the largest relative difference to torch that the parity check saw.

    Raises:
        RequestError: a missing or foreign file.
        RunError: an exported file does not give what torch gives.
    """
    written = load_module(Action, checkpoint).write(output)
    for path, difference in written.items():
        output.report(path, difference)
    return written


def export_tracker(output: ModelFiles, checkpoint: Path) -> dict[Path, float]:
    """Write a Siamese tracker as ONNX, two files, and check that they give what torch gives.

    Args:
        output.out: ONNX file to write; tracker.onnx becomes tracker_template.onnx and tracker_search.onnx.
        checkpoint: best.ckpt of tsuiseki train tracker.

    Returns:
        Of each file that was written the largest relative difference to torch that the parity check saw.

    Raises:
        RequestError: a missing or foreign file.
        RunError: an exported file does not give what torch gives.
    """
    module = load_module(Tracker, checkpoint)
    written = write_tracker(module.network, module.card, output)
    for path, difference in written.items():
        output.report(path, difference)
    return written
