"""All commands of `tsuiseki`, each a typed function: `track people` is `people` in `tracking/cli/track_people.py`.

A command's module is imported when the command is chosen, and what it needs when it runs, so that help is quick and the
commands that track never import torch.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from importlib import metadata
from inspect import signature
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
    "detector": (".fit:fit_detector", "where people are"),
    "appearance": (".fit:fit_appearance", "what they look like"),
    "action": (".fit:fit_action", "what they do"),
    "affinity": (".affinity:fit_affinity", "whether two detections are the same person"),
    "association": (".fit:fit_association", "who follows whom, by whole tracks"),
    "tracker": (".fit:fit_tracker", "one target, whatever it is"),
    "objectness": (".train_objectness:train_objectness", "which boxes look like an object"),
    "body": (".learn_body:train_body", "a body that bends, from silhouettes"),
    "motion": (".learn_motion:train_motion", "how a body that bends moves, from its tracks"),
}
EXPORT = {
    "detector": (".export_networks:export_detector", "from a checkpoint, or from torchvision's COCO weights"),
    "appearance": (".export_networks:export_appearance", "from a checkpoint"),
    "action": (".export_networks:export_action", "from a checkpoint, one file a stream"),
    "tracker": (".export_networks:export_tracker", "from a checkpoint, a file for the template and one for the search"),
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
    "blobs": (".points.run:blobs", "objects of a colour or of a network, or positions from a file"),
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
    "points": "tracked points: OSPA, GOSPA and more",
    "states": "bodies that bend: position, heading, identity",
    "action": "what people do: F1 and average precision",
    "floor": "people on one floor: IDF1, MOTA, HOTA, MODA and more",
}
EXTRA = "(needs the train extra)"
# Place and summary of each command; of a group also what is in it.
COMMANDS: Mapping[str, tuple[str, str] | tuple[str, str, Commands]] = {
    "demo": ("tracking.demo.run:demo", "run the whole path on a generated labelled clip and write a report"),
    "simulate": ("tracking.cli.simulate", "make labelled video with exact truth", SIMULATE),
    "train": ("trainers", "fit a model to labelled video (all but body and motion need the train extra)", TRAIN),
    "adapt": ("trainers.adapt.run:adapt", f"learn a camera from its unlabelled video {EXTRA}"),
    "export": ("trainers.exporting", f"turn a trained model into ONNX {EXTRA}", EXPORT),
    "models": ("tracking.cli.models", "networks of other projects that can be downloaded", MODELS),
    "calibrate": ("tracking.calibrate.run", "calibrate the lens and pose of cameras", CALIBRATE),
    "track": ("tracking", "follow something through a video with exported models", TRACK),
    "detect": ("tracking.cli.detect:detect", "write what a network detects in a video, without tracking"),
    "scene": ("tracking.counts.run:scene", "draw lines and zones to count in, on a page in the browser"),
    "hide": ("tracking.hiding.run:hide_people", "hide people in a video that was tracked"),
    "forget": ("tracking.cli.forget:forget", "delete results that may not be kept any longer"),
    "count": ("tracking.counts.run:count", "who crosses lines and stays in zones, from a finished result"),
    "review": ("tracking.review.run:review", "look through a result on a page in the browser, and correct it"),
    "gallery": ("tracking.linking.gallery:gallery", "keep people by name, to recognise in later results"),
    "link": ("tracking.linking.run:link_results", "the same ids in cameras that do not overlap"),
    "evaluate": ("tracking.cli.evaluate", "score results against labels", EVALUATE),
    "batch": ("tracking.batch.run:BATCH", "a command on many videos, on all cores or on Ray"),
    "convert": ("tracking.cli.convert:convert", "write a result into the file of another program"),
}
# Functions that take the words as they are, for Lightning.
FORWARDED = "trainers.fit:"


def _converted(kind: Any, tokens: Sequence[Any]) -> Any:
    from tsuiseki.tracking.fields import converted

    return converted(kind, tokens)


APP = App(
    PROGRAM,
    help="Track people and objects in video.",
    version=lambda: f"{PROGRAM} {metadata.version(PROGRAM)}",
    result_action="return_value",
    exit_on_error=False,
    print_error=False,
    help_format="plaintext",
    default_parameter=Parameter(negative_iterable=(), allow_repeating=True, converter=_converted),
)


def _grow() -> None:
    """Give `APP` all commands, none of which is loaded."""
    for order, (name, (place, summary, *inside)) in enumerate(COMMANDS.items()):
        if not inside:
            APP.command(f"tsuiseki.{place}", name=name, help=summary, sort_key=order)
            continue
        group = App(name, help=summary, sort_key=order)
        for number, (inner, row) in enumerate(inside[0].items()):
            where, what = (f":{inner}", row) if isinstance(row, str) else row
            forwarded = f"{place}{where}".startswith(FORWARDED)
            flags: dict[str, tuple[()]] = {"help_flags": (), "version_flags": ()} if forwarded else {}
            group.command(f"tsuiseki.{place}{where}", name=inner, help=what, sort_key=number, **flags)
        APP.command(group)


_grow()


def example_of(group: Sequence[str]) -> str:
    """What to type for the help of one of the commands of a group, or of all commands."""
    first = next((words for words in all_commands() if words[:1] == tuple(group)), ("track", "people"))
    demo = "" if group else f" To see it all at work: {PROGRAM} demo"
    return f"`{PROGRAM} {' '.join(first)} --help` lists the options of one.{demo}"


def all_commands() -> Iterator[tuple[str, ...]]:
    """The words of each command."""
    for name, (_, _, *inside) in COMMANDS.items():
        yield from ((name, inner) for inner in inside[0]) if inside else [(name,)]
    yield ("batch", "status")


def command_of(words: Sequence[str]) -> tuple[tuple[str, ...], App]:
    """The command that words begin with."""
    try:
        chain, apps, _ = APP.parse_commands(list(takewhile(lambda word: not word.startswith("-"), words)))
        return chain, apps[-1]
    except ImportError as error:
        # cyclopts wraps what went wrong.
        cause = error.__cause__ or error
    raise cause


def takes_all(command: App) -> bool:
    """Whether a command passes on words that it does not know."""
    parameters = signature(command.default_command).parameters.values() if command.default_command else ()
    return any(parameter.kind is parameter.VAR_POSITIONAL for parameter in parameters)
