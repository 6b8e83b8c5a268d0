"""All commands of `tsuiseki`, each a typed function: `track people` is `people` in `tracking/people/run.py`.

A command's module is imported when the command is chosen, and what it needs when it runs, so that help is quick and the
commands that track never import torch.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from importlib import metadata
from itertools import takewhile
from typing import Any, TypeAlias

from cyclopts import App, Parameter

PROGRAM = "tsuiseki"
# Commands by name: the place of its function below that of the group, and the summary; or the summary of the function
# of that name there.
Commands: TypeAlias = Mapping[str, str | tuple[str, str]]

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
EXTRA = "(needs the train extra)"
DIRECT = {
    "demo": ("tracking.demo.run:demo", "run the whole path on a generated labelled clip and write a report"),
    "adapt": ("trainers.adapt.run:adapt", f"learn a camera from its unlabelled video {EXTRA}"),
    "detect": ("tracking.cli.detect:detect", "write what a network detects in a video, without tracking"),
    "scene": ("tracking.counts.run:scene", "draw lines and zones to count in, on a page in the browser"),
    "hide": ("tracking.hiding.run:hide_people", "hide people in a video that was tracked"),
    "count": ("tracking.counts.run:count", "who crosses lines and stays in zones, from a finished result"),
    "review": ("tracking.review.run:review", "look through a result on a page in the browser, and correct it"),
    "link": ("tracking.linking.run:link_results", "the same ids in cameras that do not overlap"),
    "convert": ("tracking.cli.convert:convert", "write a result into the file of another program"),
}
GROUPS: Mapping[str, tuple[str, str, Commands]] = {
    "simulate": ("make labelled video with exact truth", "tracking.cli.simulate", SIMULATE),
    "train": ("fit a model to labelled video (all but body and motion need the train extra)", "trainers", TRAIN),
    "export": (f"turn a trained model into ONNX {EXTRA}", "trainers.exporting", EXPORT),
    "models": ("networks of other projects that can be downloaded", "tracking.cli.models", MODELS),
    "calibrate": ("calibrate the lens and pose of cameras", "tracking.calibrate.run", CALIBRATE),
    "track": ("follow something through a video with exported models", "tracking", TRACK),
    "evaluate": ("score results against labels", "tracking.cli.evaluate", EVALUATE),
    "batch": ("a command on many videos, on all cores or on Ray", "tracking.batch", BATCH),
}
ORDER = [
    "demo",
    "simulate",
    "train",
    "adapt",
    "export",
    "models",
    "calibrate",
    "track",
    "detect",
    "scene",
    "hide",
    "count",
    "review",
    "link",
    "evaluate",
    "batch",
    "convert",
]
# Functions that take the words as they are, for Lightning.
FORWARDED = "trainers.networks.fit:"


def _add(app: App, base: str, commands: Commands) -> None:
    for number, (name, row) in enumerate(commands.items()):
        place, summary = (f":{name}", row) if isinstance(row, str) else row
        flags: Mapping[str, tuple[()]] = (
            {"help_flags": (), "version_flags": ()} if f"{base}{place}".startswith(FORWARDED) else {}
        )
        order = ORDER.index(name) if app is APP else number
        app.command(f"tsuiseki.{base}{place}", name=name, help=summary, sort_key=order, help_epilogue="", **flags)


def _converted(kind: Any, tokens: Sequence[Any]) -> Any:
    from tsuiseki.tracking.fields import converted

    return converted(kind, tokens)


APP = App(
    PROGRAM,
    help="Track people and objects in video.",
    help_epilogue="`tsuiseki track people --help` lists the options of one. To see it all at work: tsuiseki demo",
    version=lambda: f"{PROGRAM} {metadata.version(PROGRAM)}",
    result_action="return_value",
    exit_on_error=False,
    print_error=False,
    help_format="plaintext",
    default_parameter=Parameter(negative_iterable=(), allow_repeating=True, converter=_converted),
)
_add(APP, "", DIRECT)
for _name, (_summary, _base, _commands) in GROUPS.items():
    _example = f"`{PROGRAM} {_name} {next(iter(_commands))} --help` lists the options of one."
    _group = App(_name, help=_summary, help_epilogue=_example, sort_key=ORDER.index(_name))
    _add(_group, _base, _commands)
    APP.command(_group)


def all_commands() -> Iterator[tuple[str, ...]]:
    """The words of each command."""
    yield from ((name,) for name in DIRECT)
    yield from ((group, name) for group, (_, _, commands) in GROUPS.items() for name in commands)


def command_of(words: Sequence[str]) -> tuple[tuple[str, ...], App]:
    """The command that words begin with."""
    try:
        chain, apps, _ = APP.parse_commands(list(takewhile(lambda word: not word.startswith("-"), words)))
    except ImportError as error:
        # cyclopts wraps what went wrong.
        raise error.__cause__ or error from None
    return chain, apps[-1]


def takes_all(command: App) -> bool:
    """Whether a command passes on words that it does not know."""
    return command.default_command is not None and any(
        argument.is_var_positional() for argument in command.assemble_argument_collection(parse_docstring=False)
    )
