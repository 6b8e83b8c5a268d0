"""All commands of `tsuiseki`, each a typed function: `track people` is `people` in `tracking/cli/track_people.py`.

A command's module is imported when the command is chosen, and what it needs when it runs, so that help is quick and the
commands that track never import torch.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias


@dataclass(frozen=True)
class Command:
    """A function of the command line.

    Attributes:
        place: ``module:function`` inside of `tsuiseki`.
        summary: one line for the list of commands.
    """

    place: str
    summary: str

    @property
    def forwarded(self) -> bool:
        """Whether the function takes the words as they are, for a parser of its own."""
        return self.place.startswith(("trainers.networks.fit:", "tracking.batch.run:"))

    def load(self) -> Callable[..., Any]:
        """The function of the command."""
        module, _, function = self.place.partition(":")
        found: Callable[..., Any] = getattr(importlib.import_module(f"tsuiseki.{module}"), function)
        return found


class Group:
    """Commands of one kind.

    Args:
        summary: one line for the list of groups.
        base: where their functions are, inside of `tsuiseki`.
        rows: by name, the place below that and the summary; or the summary of the function of that name there.
    """

    def __init__(self, summary: str, base: str, rows: Mapping[str, str | tuple[str, str]]) -> None:
        self.summary = summary
        placed = {name: (f":{name}", row) if isinstance(row, str) else row for name, row in rows.items()}
        self.commands = {name: Command(base + place, text) for name, (place, text) in placed.items()}


Tree: TypeAlias = Mapping[str, Command | Group]

SIMULATE = {
    "street": "people on a street before a fixed camera",
    "sphere": "a ball carried through a room before several cameras",
    "blobs": "coloured objects over natural clutter",
    "goldfish": "fish that bend, or balls that squash",
    "drone": "people who act, before a drone's camera",
    "fisheye": "people in a room, under ceiling fisheye cameras",
    "floor": "people on one floor, before several cameras of both kinds",
    "sprites": "people rendered from body meshes, for the pictures that detectors learn from",
}
TRAIN = {
    "detector": (".networks.fit:fit_detector", "where people are"),
    "appearance": (".networks.fit:fit_appearance", "what they look like"),
    "action": (".networks.fit:fit_action", "what they do"),
    "affinity": (".association.affinity_fit:fit_affinity", "whether two detections are the same person"),
    "affinity-drone": (
        ".association.action_cost_fit:fit_action_costs",
        "what differences of actions cost under a drone",
    ),
    "association": (".networks.fit:fit_association", "who follows whom, by whole tracks"),
    "objectness": (".train_objectness:train_objectness", "which boxes look like an object"),
    "body": (".learn_body:train_body", "a body that bends, from silhouettes"),
    "motion": (".learn_motion:train_motion", "how a body that bends moves, from its tracks"),
}
EXPORT = {
    "detector": (".export_networks:export_detector", "from a checkpoint, or from torchvision's COCO weights"),
    "appearance": (".export_networks:export_appearance", "from a checkpoint"),
    "action": (".export_networks:export_action", "from a checkpoint, one file a stream"),
    "association": (".export_costs:export_trained", "costs of the flow, from a checkpoint"),
}
MODELS = {
    "list": (":list_models", "what there is, and under which terms"),
    "get": (":get", "download one into the user's cache"),
}
CALIBRATE = {
    "points": "from known points in space",
    "checkerboard": "a camera's focal length and lens, from pictures of a board",
    "convert": "a fisheye calibration in another program's format",
    "pose": "over a floor, from height and tilt or from points",
    "people": "from the people who walk in them",
}
TRACK = {
    "people": (".cli.track_people:people", "everyone in view, each with an id"),
    "single": (".single.run:single", "one target, from its box in the first frame"),
    "sphere": (".sphere.run:sphere", "a ball in space, from calibrated cameras"),
    "drone": (".drone.run:drone", "people seen from a drone, and what they do"),
    "blobs": (".points.run:blobs", "objects of a colour, or measured points"),
    "points": (".points.measured:points", "targets from the measurements of a sensor"),
    "deformable": (".bodies.run:deformable", "bodies that bend, such as fish from above"),
    "animals": (".animals.run:animals", "several animals before a fixed camera"),
    "floor": (".floor.run:floor", "people on one floor that several cameras see"),
    "fisheye": (".fisheye.run:fisheye", "people under ceiling cameras, and where on the floor"),
}
EVALUATE = {
    "people": "tracks: HOTA, MOTA, IDF1 and more",
    "detection": "detections: average precision",
    "appearance": "appearance networks: ranks and average precision of finding a person again",
    "single": "one target: success and precision",
    "coverage": "tracks of many on one labelled person: coverage and switches",
    "points": "tracked points: OSPA, GOSPA and more",
    "states": "bodies that bend: position, heading, identity",
    "action": "what people do: F1 and average precision",
    "floor": "people on one floor: IDF1, MOTA, HOTA, MODA and more",
}
BATCH = {
    "track": (".run:track", "track what is in each of many videos"),
    "count": (".run:count", "answers of many results"),
    "evaluate": (".run:evaluate", "scores of many results"),
    "status": (".schedule:status", "how far a batch is"),
}
FIT = "fit a model to labelled video (all but body and motion need the train extra)"
EXTRA = "(needs the train extra)"
COMMANDS: Tree = {
    "demo": Command("tracking.demo.run:demo", "run the whole path on a generated labelled clip and write a report"),
    "simulate": Group("make labelled video with exact truth", "tracking.cli.simulate", SIMULATE),
    "train": Group(FIT, "trainers", TRAIN),
    "adapt": Command("trainers.adapt.run:adapt", f"learn a camera from its unlabelled video {EXTRA}"),
    "export": Group(f"turn a trained model into ONNX {EXTRA}", "trainers.exporting", EXPORT),
    "models": Group("networks of other projects that can be downloaded", "tracking.cli.models", MODELS),
    "calibrate": Group("calibrate the lens and pose of cameras", "tracking.calibrate.run", CALIBRATE),
    "track": Group("follow something through a video with exported models", "tracking", TRACK),
    "detect": Command("tracking.cli.detect:detect", "write what a network detects in a video, without tracking"),
    "scene": Command("tracking.counts.run:scene", "draw lines and zones to count in, on a page in the browser"),
    "hide": Command("tracking.hiding.run:hide_people", "hide people in a video that was tracked"),
    "count": Command("tracking.counts.run:count", "who crosses lines and stays in zones, from a finished result"),
    "review": Command("tracking.review.run:review", "look through a result on a page in the browser, and correct it"),
    "link": Command("tracking.linking.run:link_results", "the same ids in cameras that do not overlap"),
    "evaluate": Group("score results against labels", "tracking.cli.evaluate", EVALUATE),
    "batch": Group("a command on many videos, on all cores or on Ray", "tracking.batch", BATCH),
    "convert": Command("tracking.cli.convert:convert", "write a result into the file of another program"),
}
