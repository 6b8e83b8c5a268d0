"""`tsuiseki export association`: costs that were learnt through the flow, and the networks that learnt with them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from tsuiseki.tracking.errors import RequestError
from tsuiseki.trainers.association import PLANNED, PLANNED_STEPS, Association
from tsuiseki.trainers.exporting.export import ModelFile, load_module
from tsuiseki.trainers.exporting.written_costs import export_association
from tsuiseki.trainers.exporting.written_networks import write_appearance, write_detector
from tsuiseki.trainers.network_module import load_checkpoint


def export_trained(
    *,
    checkpoint: Path,
    out: Path,
    appearance: Path | None = None,
    detector: Path | None = None,
    training_data: str = "",
    unfinished: bool = False,
    overwrite: bool = False,
) -> float:
    """Write the network of a checkpoint as ONNX, for --affinity, and check that it gives the costs that torch gives.

    Args:
        checkpoint: of `tsuiseki train association`.
        out: the file to write.
        appearance: file for the Siamese network that was trained with it, for --appearance.
        detector: file for the detector whose heads were trained with it, for --detector.
        training_data: what it was trained on, in words; kept in the file.
        unfinished: also take a training that has not run all its epochs.
        overwrite: replace an existing file.

    Returns:
        The largest difference of a cost to torch that the parity check saw.

    Raises:
        RequestError: a missing or foreign file, a training that has not taken a step or has not ended, or one without
            the network that is asked for.
    """
    module = load_module(Association, checkpoint)
    _check_ended(checkpoint, unfinished)
    network = module.network
    if not any(weights.any() for part in network.children() for weights in part.linear.parameters()):
        raise RequestError(f"{checkpoint}: expected a trained network, but it changes no cost; go on with the training")
    if appearance is not None:
        if module.siamese is None:
            raise RequestError(
                f"{checkpoint}: expected a Siamese network, but the training had no --model.appearance.file"
            )
        file = ModelFile(out=appearance, training_data=training_data, overwrite=overwrite)
        write_appearance(module.siamese.network, module.siamese.card, file)
        print(f"{appearance}: the Siamese network")
    if detector is not None:
        if module.detector is None:
            raise RequestError(f"{checkpoint}: expected a detector, but the training had no --model.detector.file")
        # Their scores are as they come, not calibrated again.
        card = replace(module.detector.card, training_data=training_data)
        write_detector(module.detector.network, card, ModelFile(out=detector, overwrite=overwrite))
        print(f"{detector}: the detector")
    worst = export_association(network, out, training_data, overwrite=overwrite)
    print(f"{out}: no cost differs from torch's by more than {worst:.1g}")
    return worst


def _check_ended(checkpoint: Path, unfinished: bool) -> None:
    """Refuse a training that has had fewer epochs, and steps, than it was to have; or tell of it."""
    last = checkpoint.with_name("last.ckpt")
    path = last if last.is_file() else checkpoint
    held = load_checkpoint(path)
    done, epochs, steps = held["epoch"] + 1, held.get(PLANNED, -1), held.get(PLANNED_STEPS, -1)
    if done >= epochs or 0 < steps <= held["global_step"]:
        return
    had = f"that has had {done} of {epochs} epochs"
    if not unfinished:
        raise RequestError(
            f"{checkpoint}: expected a training that has ended, got one {had}; go on with --ckpt_path {path}, or take "
            "it as it is with `unfinished`"
        )
    print(f"{checkpoint}: of a training {had}; --ckpt_path goes on with it")
