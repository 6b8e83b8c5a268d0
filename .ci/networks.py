"""The pictures of networks in the manual, with the shapes that the shipped networks have.

python .ci/networks.py --write
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

import torch
from torch import Tensor

from tsuiseki.tracking.association.evidence import DETECTION_FEATURES, JOIN_FEATURES, LINK_FEATURES
from tsuiseki.training import Action, Appearance, Detector

IMAGES = Path(__file__).resolve().parent.parent / "docs" / "images"
# Pixels of a box, of the gap to the next column or row, and of the margin.
WIDTH, HEIGHT, ACROSS, DOWN, MARGIN = 148, 48, 28, 18, 6
# The site follows the system's colours, as this does.
STYLE = """
rect { fill: #e0f2f1; stroke: #00796b; } text { fill: #1b1b1b; font: 14px sans-serif; text-anchor: middle; }
.shape { font: 13px monospace; } path { stroke: #00796b; fill: none; } marker path { fill: #00796b; stroke: none; }
@media (prefers-color-scheme: dark) {
rect { fill: #1d3634; stroke: #4db6ac; } text { fill: #eceff1; } path { stroke: #4db6ac; }
marker path { fill: #4db6ac; } }
"""


@dataclass
class Picture:
    """Boxes in columns, by column and row, and arrows between them.

    Attributes:
        about: what it shows, for who does not see it.
        boxes: two lines of each, by place.
        arrows: from place to place.
    """

    about: str
    boxes: dict[tuple[int, float], tuple[str, str]] = field(default_factory=dict)
    arrows: list[tuple[tuple[int, float], tuple[int, float]]] = field(default_factory=list)

    def add(self, column: int, row: float, title: str, shape: str, *sources: tuple[int, float]) -> tuple[int, float]:
        """A box with its name and shape, and an arrow from each of its sources."""
        place = (column, row)
        self.boxes[place] = (title, shape)
        self.arrows += [(source, place) for source in sources]
        return place

    def svg(self) -> str:
        """The picture as text."""
        columns, rows = (max(place[axis] for place in self.boxes) + 1 for axis in (0, 1))
        size = (columns * (WIDTH + ACROSS) - ACROSS + 2 * MARGIN, rows * (HEIGHT + DOWN) - DOWN + 2 * MARGIN)
        lines = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]:g} {size[1]:g}" role="img">',
            f"<title>{escape(self.about)}</title>",
            f"<style>{STYLE}</style>",
            '<marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
            '<path d="M0 0L8 4L0 8z"/></marker>',
        ]
        for (column, row), (title, shape) in self.boxes.items():
            x, y = _corner((column, row))
            lines += [
                f'<rect x="{x:g}" y="{y:g}" width="{WIDTH}" height="{HEIGHT}" rx="5"/>',
                f'<text x="{x + WIDTH / 2:g}" y="{y + 20:g}">{escape(title)}</text>',
                f'<text class="shape" x="{x + WIDTH / 2:g}" y="{y + 38:g}">{escape(shape)}</text>',
            ]
        lines += [f'<path d="{_line(*arrow)}" marker-end="url(#tip)"/>' for arrow in self.arrows]
        return "\n".join([*lines, "</svg>", ""])


def _corner(place: tuple[int, float]) -> tuple[float, float]:
    return MARGIN + place[0] * (WIDTH + ACROSS), MARGIN + place[1] * (HEIGHT + DOWN)


def _line(start: tuple[int, float], end: tuple[int, float]) -> str:
    """Right out of a box into the next column, or straight up or down in one."""
    (x1, y1), (x2, y2) = _corner(start), _corner(end)
    if start[0] == end[0]:
        out, into = (y1 + HEIGHT, y2) if y2 > y1 else (y1, y2 + HEIGHT)
        return f"M{x1 + WIDTH / 2:g} {out:g}V{into:g}"
    x1, y1, y2, middle = x1 + WIDTH, y1 + HEIGHT / 2, y2 + HEIGHT / 2, x2 - ACROSS / 2
    return f"M{x1:g} {y1:g}H{middle:g}V{y2:g}H{x2:g}"


def _by(values: Sequence[int]) -> str:
    return " × ".join(map(str, values))


def _map(values: Tensor) -> str:
    """Shape of a sample of a batch."""
    return _by(values.shape[1:])


@torch.no_grad()
def detector() -> Picture:
    """The shipped ``detector_people.onnx``, trunk to heads, and its branch."""
    network = Detector(start="people", architecture="branched").network.eval()
    image = torch.zeros(1, 3, *network.size)
    stages = network.features.trunk(image)
    merged = network.features.merged(stages)
    logits, offsets = network(image)
    picture = Picture(
        "An image runs through a trunk of three stages, a top-down path and a head on each map. From the first map a "
        "branch with stages, path and heads of its own sets out at half the resolution"
    )
    before = picture.add(0, 0, "image", _map(image))
    for row, (stage, level) in enumerate(zip(stages, merged, strict=True)):
        shapes = network.class_heads[row][-1].out_channels // (network.classes + 1)
        before = picture.add(1, row, f"trunk, stride {network.features.trunk.strides[row]}", _map(stage), before)
        lateral = picture.add(2, row, "1 × 1, and coarser", _map(level), before)
        smooth = picture.add(3, row, "separable 3 × 3", _map(level), lateral)
        per_cell = f"{shapes} × ({network.classes + 1} + 4)"
        head = picture.add(4, row, f"heads, {shapes} anchors", per_cell, smooth)
        picture.arrows.append((head, (5, 0.5)))
        picture.arrows.append((head, (5, 1.5)))
    picture.arrows += [((2, 2), (2, 1)), ((2, 1), (2, 0))]
    first = network.halved(stages[0])
    halved = picture.add(2, 3, "3 × 3, stride 2", _map(first), (1, 0))
    maps = network.branch.features.merged([first, *network.branch.features.trunk(first)])
    path = picture.add(3, 3, "branch: stages, path", f"{_map(maps[0])} …", halved)
    count = sum(head[-1].out_channels // 2 for head in network.branch.class_heads)
    head = picture.add(4, 3, f"heads, {count} anchors", f"{count} × ({network.classes + 1} + 4)", path)
    picture.arrows += [(head, (5, 0.5)), (head, (5, 1.5))]
    picture.add(5, 0.5, "logits", _map(logits))
    picture.add(5, 1.5, "offsets", _map(offsets))
    return picture


@torch.no_grad()
def appearance() -> Picture:
    """The shipped ``appearance_people.onnx``."""
    model = Appearance(start="people")
    network = model.network.eval()
    image = torch.zeros(1, 3, model.card.input_height, model.card.input_width)
    picture = Picture("A crop runs through a trunk; stripes of its three maps are averaged, joined and projected")
    before, stripes = picture.add(0, 0, "crop", _map(image)), 4
    pooled = network.head[0].num_features
    for row, stage in enumerate(network.trunk(image)):
        before = picture.add(1, row, f"trunk, stride {network.trunk.strides[row]}", _map(stage), before)
        mean = picture.add(2, row, f"mean of {stripes} stripes", f"{stripes} × {stage.shape[1]}", before)
        picture.arrows.append((mean, (3, 1)))
    assert pooled == stripes * sum(network.trunk.channels)
    picture.add(3, 1, "joined, normalised", str(pooled))
    projected = picture.add(4, 1, "linear, normalised", str(network.feature_length), (3, 1))
    picture.add(5, 1, "unit length", _map(network(image)), projected)
    return picture


@torch.no_grad()
def action() -> Picture:
    """The four shipped streams."""
    network = Action(start="drone").network.eval()
    picture = Picture("Four crops run through a trunk and a linear layer each; their probabilities are averaged")
    for row, (name, stream) in enumerate(network.streams.items()):
        channels = next(module for module in stream.modules() if isinstance(module, torch.nn.Conv2d)).in_channels
        crop = torch.zeros(1, channels, 64, 64)
        last = stream.trunk(crop)[-1]
        start = picture.add(0, row, name, _map(crop))
        trunk = picture.add(1, row, "trunk, stride 32", _map(last), start)
        mean = picture.add(2, row, "mean over the map", str(last.shape[1]), trunk)
        out = picture.add(3, row, "linear, sigmoid", _map(stream(crop)), mean)
        picture.arrows.append((out, (4, 1.5)))
    picture.add(4, 1.5, "mean of the streams", str(stream.classifier.out_features))
    return picture


def association() -> Picture:
    """The changes of costs."""
    picture = Picture("Features of links, detections and joins become changes of the costs of the flow")
    rows = (
        ("links", "P", LINK_FEATURES, 1),
        ("detections", "N", DETECTION_FEATURES, 3),
        ("joins", "J", JOIN_FEATURES, 1),
    )
    for row, (name, count, features, changes) in enumerate(rows):
        start = picture.add(0, row, f"features of {name}", f"{count} × {len(features)}")
        standard = picture.add(1, row, "standardised, ±5", f"{count} × {len(features)}", start)
        linear = picture.add(2, row, "linear", f"{count} × {changes}", standard)
        bounded = picture.add(3, row, "8 tanh(· / 8)", f"{count} × {changes}", linear)
        picture.arrows.append((bounded, (4, 1)))
    picture.add(4, 1, "+ the flow's costs", "3 N + P, and J")
    picture.add(5, 1, "cheapest flow", "tracks", (4, 1))
    return picture


PICTURES: dict[str, Callable[[], Picture]] = {
    "detector": detector,
    "appearance": appearance,
    "action": action,
    "association": association,
}

if __name__ == "__main__":
    for network_name, draw in PICTURES.items():
        if "--write" in sys.argv:
            (IMAGES / f"network-{network_name}.svg").write_text(draw().svg(), encoding="utf-8")
