"""Networks of pictures as ONNX files, from the network itself and its card."""

from __future__ import annotations

import copy
import dataclasses
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from tsuiseki.models.action import ActionNetwork, FusedProbability, StreamProbability
from tsuiseki.models.detector import AnchorDetector, BranchedDetector, OneClass
from tsuiseki.models.tracker import TEMPLATE_SIDE, SearchPart, TemplatePart, TrackerNetwork
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.action import ActionInput, StreamName
from tsuiseki.tracking.features.exported import Detector
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.tracking.output import check_output_file
from tsuiseki.trainers.detector_labels import LOWEST_SCORE, fit_calibration, matched_scores
from tsuiseki.trainers.exporting.export import ModelFile, ModelFiles, export_onnx
from tsuiseki.trainers.exporting.exported_weights import calibrate as calibrate_weights

OUTPUTS = ("logits", "offsets", "anchors")
# Those of a network that decodes its boxes itself.
DECODED = ("boxes", "scores")
# Closest that a score comes to 0 and 1 where it is calibrated: its logit stays finite in float32.
_SMALLEST_SCORE = 1e-6
# Added to the logit of a score, it leaves nothing of that.
_SILENT = -30.0


class RawHeads(nn.Module):
    """A detector with its anchors as a third output, as the exported file has it.

    Args:
        detector: of one class where scores are calibrated.
        calibration: scale and shift of the logit of its score.
    """

    def __init__(self, detector: AnchorDetector | OneClass, calibration: tuple[float, float] = (1.0, 0.0)) -> None:
        super().__init__()
        self.detector = detector
        self.calibration = calibration

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """``(B, 3, H, W)`` to logits ``(B, A, C + 1)``, offsets ``(B, A, 4)`` and anchors ``(A, 4)``."""
        logits, offsets = self.detector(images)
        scale, shift = self.calibration
        if self.calibration != (1.0, 0.0):
            logits = logits * scale + torch.tensor([0.0, shift])
        return logits, offsets, self.detector.anchors


class Decoded(nn.Module):
    """A `DetectorNetwork` of one's own with its boxes decoded, as the exported file has it.

    Args:
        network: of one class where scores are calibrated.
        calibration: scale and shift of the logit of its score.
    """

    def __init__(self, network: nn.Module, calibration: tuple[float, float] = (1.0, 0.0)) -> None:
        super().__init__()
        self.network: Any = network
        self.calibration = calibration

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """``(B, 3, H, W)`` to boxes ``(B, N, 4)``, input pixels, and scores ``(B, N, C)`` in [0, 1]."""
        boxes, scores = self.network.decode(self.network(images))
        scale, shift = self.calibration
        if self.calibration != (1.0, 0.0):
            margin = scores.clamp(_SMALLEST_SCORE, 1 - _SMALLEST_SCORE)
            scores = ((margin / (1 - margin)).log() * scale + shift).sigmoid()
        return boxes, scores


def model_file(out: str | Path, training_data: str = "", float16: bool = False, overwrite: bool = False) -> ModelFile:
    """The file that a module is exported to."""
    return ModelFile(out=Path(out), training_data=training_data, float16=float16, overwrite=overwrite)


def model_files(out: str | Path, training_data: str = "", float16: bool = False, overwrite: bool = False) -> ModelFiles:
    """The files that a module is exported to, by the name of one."""
    return ModelFiles(out=Path(out), training_data=training_data, float16=float16, overwrite=overwrite)


def copied(network: nn.Module) -> nn.Module:
    """A copy of ``network`` for inference, on the CPU and in the layout that the exporter takes."""
    return copy.deepcopy(network).cpu().float().eval().to(memory_format=torch.contiguous_format)


def write_detector(network: nn.Module, card: ModelCard, output: ModelFile, calibrate: Path | None = None) -> float:
    """Write a detector of anchors with its raw heads, or any `DetectorNetwork` with boxes and scores.

    Scores are calibrated on labelled pictures where there are some; of a detector with a branch, those of the branch.

    Returns:
        The largest relative difference to torch.
    """
    contiguous: Any = copied(network)
    example = torch.zeros(2, 3, card.input_height, card.input_width)
    calibration = (1.0, 0.0)
    of_anchors = isinstance(network, AnchorDetector | OneClass)
    form, outputs = (RawHeads, OUTPUTS) if of_anchors else (Decoded, DECODED)
    if calibrate is not None:
        if len(card.class_names) > 1:
            raise RequestError(f"`calibrate`: expected a detector of one class, got {', '.join(card.class_names)}")
        check_output_file(output.out, output.overwrite)
        branched = isinstance(network, BranchedDetector)
        with tempfile.TemporaryDirectory() as folder:
            raw = Path(folder) / "raw.onnx"
            export_onnx(form(_branch_alone(contiguous) if branched else contiguous), card, raw, example, outputs)
            calibration = fit_calibration(*matched_scores(Detector(raw, LOWEST_SCORE), calibrate))
        said = {"score_calibration": list(calibration)}
        if branched:
            # The scores of the detector of people stay. Those of the branch may have been calibrated before.
            scale, shift = card.settings.get("branch_calibration", (1.0, 0.0))
            said = {"branch_calibration": [calibration[0] * scale, calibration[0] * shift + calibration[1]]}
            calibrate_weights(contiguous.branch.state_dict(), *calibration, len(card.class_names))
            calibration = (1.0, 0.0)
        card = dataclasses.replace(card, settings={**card.settings, **said})
    exported = form(contiguous, calibration)
    return export_onnx(exported, card, output.out, example, outputs, output.float16, output.overwrite)


def _branch_alone(network: BranchedDetector) -> BranchedDetector:
    """A copy whose detector of people is silent."""
    alone = copy.deepcopy(network)
    heads = {name: value for name, value in alone.state_dict().items() if name.startswith("class_heads")}
    calibrate_weights(heads, 1.0, _SILENT, network.classes)
    return alone


def write_appearance(network: nn.Module, card: ModelCard, output: ModelFile) -> float:
    """Write an appearance network; the largest relative difference to torch."""
    card = dataclasses.replace(card, training_data=output.training_data, licence=output.licence)
    example = torch.zeros(2, 3, card.input_height, card.input_width)
    return export_onnx(copied(network), card, output.out, example, ("features",), output.float16, output.overwrite)


def write_tracker(network: TrackerNetwork, card: ModelCard, output: ModelFiles) -> dict[Path, float]:
    """Write a tracker, a file for the template and one for the search picture.

    Args:
        network: whole.
        card: of it.
        output: ``tracker.onnx`` becomes ``tracker_template.onnx`` and ``tracker_search.onnx``.

    Returns:
        Of each file the largest relative difference to torch.
    """
    paths = {part: output.out.with_name(f"{output.out.stem}_{part}.onnx") for part in ("template", "search")}
    for path in paths.values():
        check_output_file(path, output.overwrite)
    contiguous: Any = copied(network)
    template, search = (
        torch.zeros(2, 3, TEMPLATE_SIDE, TEMPLATE_SIDE),
        torch.zeros(2, 3, card.input_height, card.input_width),
    )
    with torch.no_grad():
        features = contiguous.describe(template)
    forms: dict[str, tuple[nn.Module, dict[str, Tensor], Sequence[str]]] = {
        "template": (TemplatePart(contiguous), {"template": template}, ("features",)),
        "search": (SearchPart(contiguous), {"features": features, "search": search}, ("scores", "boxes")),
    }
    written = {}
    for part, (form, examples, outputs) in forms.items():
        side = next(reversed(examples.values())).shape[-1]
        settings = {**card.settings, "part": part}
        own = dataclasses.replace(card, input_height=side, input_width=side, settings=settings)
        own = dataclasses.replace(own, training_data=output.training_data, licence=output.licence)
        # Cells of features have length 1.
        spread = [network.channels**-0.5, 1.0][-len(examples) :]
        how = output.float16, output.overwrite, spread
        written[paths[part]] = export_onnx(form, own, paths[part], examples, outputs, *how)
    return written


def write_streams(
    network: ActionNetwork,
    inputs: Mapping[StreamName, ActionInput],
    card_of: Callable[[StreamName], ModelCard],
    fused: bool,
    output: ModelFiles,
) -> dict[Path, float]:
    """Write the streams of an action network, a file each.

    Args:
        network: of all streams.
        inputs: what each stream takes.
        card_of: what the file of a stream says about itself.
        fused: the streams were trained jointly, and get one file more, which takes the crops of all.
        output: ``action.onnx`` becomes ``action_rgb_local.onnx`` and so on, and ``action_fused.onnx``.

    Returns:
        Of each file the largest relative difference to torch.
    """
    groups: dict[str, tuple[StreamName, ...]] = {name: (name,) for name in inputs}
    groups |= {"fused": tuple(inputs)} if fused else {}
    paths = {name: output.out.with_name(f"{output.out.stem}_{name}.onnx") for name in groups}
    for path in paths.values():
        check_output_file(path, output.overwrite)
    network = copied(network)  # type: ignore[assignment]
    written = {}
    for group, streams in groups.items():
        stream, path = streams[0], paths[group]
        card = dataclasses.replace(card_of(stream), training_data=output.training_data, licence=output.licence)
        if group == "fused":
            # The inputs are called as the streams, and each has settings of its own.
            card = dataclasses.replace(card, settings={"streams": [card_of(name).settings for name in streams]})
        side = card.input_height
        examples: dict[str, Tensor] = {name: torch.zeros(2, inputs[name].channels, side, side) for name in streams}
        # Flow is nearly nothing nearly everywhere; noise as strong as in colours would saturate every sigmoid.
        spread: Sequence[float] = [0.1 if inputs[name].is_flow else 1.0 for name in streams]
        exported: nn.Module = FusedProbability(network)
        if group != "fused":
            examples = {"images": examples[stream]}
            exported = StreamProbability(network.streams[stream])  # type: ignore[arg-type]
        how = output.float16, output.overwrite, spread
        written[path] = export_onnx(exported, card, path, examples, ("probability",), *how)
    return written
