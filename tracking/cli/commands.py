"""All commands of `tsuiseki`, each a typed function in the file of its name: `track people` is `people` in
`track/people.py`.

A command's file is imported when the command is chosen, and what it needs when it runs, so that help is quick and the
commands that track never import torch.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeAlias

from tsuiseki.tracking.errors import RequestError

TRAIN_PACKAGES = ("torch", "torchvision", "lightning", "onnx", "onnxscript", "sklearn", "skl2onnx", "tensorboard")


@dataclass(frozen=True)
class Command:
    """A function of the command line.

    Attributes:
        summary: one line for the list of commands.
        place: ``module:function`` inside of `tsuiseki`, or ``module`` where both have one name; by default the file of
            the command's name. What trains or exports stands where the work is done.
        forwarded: the function takes the words as they are, for a parser of its own.
    """

    summary: str
    place: str = ""
    forwarded: bool = False

    def load(self, words: Sequence[str]) -> Callable[..., Any]:
        """The function of the command that is called ``words``, such as track and people.

        Raises:
            RequestError: it needs the `train` extra, which is missing.
        """
        default = ".".join(["tracking.cli", *words]).replace("-", "_")
        module, _, function = (self.place or default).partition(":")
        with needs_train_extra():
            found = importlib.import_module(f"tsuiseki.{module}")
        return getattr(found, function or module.split(".")[-1])  # type: ignore[no-any-return]


@dataclass(frozen=True)
class Experiment(Command):
    """A paper's experiment: ``module`` or ``module:function`` in `tsuiseki.trainers.experiments`."""

    def load(self, words: Sequence[str]) -> Callable[..., Any]:
        """See `Command.load`."""
        from tsuiseki.tracking.cli.reproduce import reproduction

        module, _, function = self.place.partition(":")
        with needs_train_extra():
            found = importlib.import_module(f"tsuiseki.trainers.experiments.{module}")
        return reproduction(words[-1], getattr(found, function or "reproduce"))


@dataclass(frozen=True)
class Group:
    """Commands of one kind."""

    summary: str
    commands: Mapping[str, Command]


Tree: TypeAlias = Mapping[str, Command | Group]

COMMANDS: Tree = {
    "demo": Command("run the whole path on a generated labelled clip and write a report", "tracking.demo.run:demo"),
    "simulate": Group(
        "make labelled video with exact truth",
        {
            "street": Command("people on a street before a fixed camera", "tracking.cli.simulate:street"),
            "sphere": Command("a ball carried through a room before several cameras", "tracking.cli.simulate:sphere"),
            "blobs": Command("coloured objects over natural clutter", "tracking.cli.simulate:blobs"),
            "goldfish": Command("fish that bend, or balls that squash", "tracking.cli.simulate:goldfish"),
            "drone": Command("people who act, before a drone's camera", "tracking.cli.simulate:drone"),
            "fisheye": Command("people in a room, under ceiling fisheye cameras", "tracking.cli.simulate:fisheye"),
            "sprites": Command(
                "people rendered from body meshes, for the pictures that detectors learn from",
                "tracking.cli.simulate:sprites",
            ),
        },
    ),
    "train": Group(
        "fit a model to labelled video (all but body and motion need the train extra)",
        {
            "detector": Command("where people are", "trainers.networks.fit:fit_detector", forwarded=True),
            "appearance": Command("what they look like", "trainers.networks.fit:fit_appearance", forwarded=True),
            "action": Command("what they do", "trainers.networks.fit:fit_action", forwarded=True),
            "affinity": Command(
                "whether two detections are the same person", "trainers.association.affinity_fit:fit_affinity"
            ),
            "affinity-drone": Command(
                "what differences of actions cost, seen from a drone",
                "trainers.association.action_cost_fit:fit_action_costs",
            ),
            "association": Command(
                "who follows whom, by whole tracks", "trainers.networks.fit:fit_association", forwarded=True
            ),
            "objectness": Command("which boxes look like an object", "trainers.train_objectness"),
            "body": Command("a body that bends, from silhouettes", "trainers.learn_body:train_body"),
            "motion": Command("how a body that bends moves, from its tracks", "trainers.learn_motion:train_motion"),
        },
    ),
    "adapt": Command("learn a camera from its unlabelled video (needs the train extra)"),
    "export": Group(
        "turn a trained model into ONNX (needs the train extra)",
        {
            "detector": Command(
                "from a checkpoint, or from torchvision's COCO weights",
                "trainers.exporting.export_networks:export_detector",
            ),
            "appearance": Command("from a checkpoint", "trainers.exporting.export_networks:export_appearance"),
            "action": Command(
                "from a checkpoint, one file a stream", "trainers.exporting.export_networks:export_action"
            ),
            "association": Command(
                "costs of the flow, from a checkpoint", "trainers.exporting.export_costs:export_trained"
            ),
        },
    ),
    "models": Group(
        "networks of other projects that can be downloaded",
        {
            "list": Command("what there is, and under which terms", "tracking.cli.models:list_models"),
            "get": Command("download one into the user's cache", "tracking.cli.models:get"),
        },
    ),
    "calibrate": Group(
        "find out where cameras are and how they see",
        {
            "points": Command("from known points in space", "tracking.calibrate.run:points"),
            "checkerboard": Command(
                "a camera's focal length and lens, from pictures of a board", "tracking.calibrate.run:checkerboard"
            ),
            "convert": Command("a fisheye calibration in another program's format", "tracking.calibrate.run:convert"),
            "pose": Command("over a floor, from height and tilt or from points", "tracking.calibrate.run:pose"),
        },
    ),
    "track": Group(
        "follow something through a video with exported models",
        {
            "people": Command("everyone in view, each with an id", "tracking.people.run:people"),
            "single": Command("one target, from its box in the first frame", "tracking.single.run:single"),
            "sphere": Command("a ball in space, from calibrated cameras", "tracking.sphere.run:sphere"),
            "drone": Command("people seen from a drone, and what they do", "tracking.drone.run:drone"),
            "blobs": Command("objects of a colour, or measured points", "tracking.points.run:blobs"),
            "points": Command("targets from the measurements of a sensor", "tracking.points.run:points"),
            "deformable": Command("bodies that bend, such as fish from above", "tracking.bodies.run:deformable"),
            "animals": Command("several animals before a fixed camera", "tracking.animals.run:animals"),
            "fisheye": Command("people under ceiling cameras, and where on the floor", "tracking.fisheye.run:fisheye"),
        },
    ),
    "evaluate": Group(
        "score results against labels",
        {
            "people": Command("tracks: HOTA, MOTA, IDF1 and more", "tracking.cli.evaluate:people"),
            "detection": Command("detections: average precision", "tracking.cli.evaluate:detection"),
            "single": Command("one target: success and precision", "tracking.cli.evaluate:single"),
            "coverage": Command(
                "tracks of many on one labelled person: coverage and switches", "tracking.cli.evaluate:coverage"
            ),
            "points": Command("tracked points: OSPA, GOSPA and more", "tracking.cli.evaluate:points"),
            "states": Command("bodies that bend: position, heading, identity", "tracking.cli.evaluate:states"),
            "action": Command("what people do: F1 and average precision", "tracking.cli.evaluate:action"),
        },
    ),
    "reproduce": Group(
        "a paper's table or figure: paper and here, plus the plot (needs the train extra)",
        {
            "multi-correlation-filter": Experiment(
                "correlation filters selected by a particle filter", "single_target"
            ),
            "phd": Experiment("finite-set filters on the standard scenarios", "finite_sets"),
            "pca-particle-filter": Experiment("how many particles a goldfish needs", "goldfish"),
            "drone-action-features": Experiment("tracks and actions from a drone improve each other", "drone_actions"),
            "phd-unseen": Experiment("a sensor's measurements on new scenarios, with peers", "sensed"),
            "blobs": Experiment("coloured objects, beside components and SORT", "coloured:blobs"),
            "phd-equalisation": Experiment("equal likelihoods keep the weak target", "coloured:equalisation"),
            "association": Experiment("people and cars linked on given detections, with peers", "association"),
            "end-to-end": Experiment("costs learnt through the flow", "end_to_end"),
            "omnidirectional": Experiment("people under ceiling fisheye cameras", "fisheye"),
            "stereo-sphere": Experiment("a ball in space from two cameras", "sphere"),
            "sphere-points": Experiment("a thrown ball from its measured pixels", "sphere_points"),
        },
    ),
}


@contextmanager
def needs_train_extra() -> Iterator[None]:
    """Import what trains within the ``with`` block.

    Raises:
        RequestError: a package of the extra is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] not in TRAIN_PACKAGES:
            raise
        raise RequestError(
            f"training needs {error.name}, which is not installed; install the extra: pip install 'tsuiseki[train]'"
        ) from error
