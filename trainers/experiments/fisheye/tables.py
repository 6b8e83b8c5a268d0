"""Tables 4.3, 4.4 and 4.5 beside the thesis's, and the lines below them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tsuiseki.trainers.experiments import intervals
from tsuiseki.trainers.experiments.experiment import Table
from tsuiseki.trainers.experiments.fisheye.observations import STAGES

# MOTA of Table 4.3 at 1 and 15 frames a second: large, small, large, small.
PAPER: dict[str, tuple[float, float, float, float]] = {
    "baseline": (8.4, 51.0, -3.5, 48.7),
    "SORT": (-10.5, 24.5, -1.4, 49.9),
    "DeepSORT": (-4.3, 30.9, 6.0, 52.3),
    "rectification": (10.2, 51.8, -3.4, 48.5),
    "world": (8.1, 53.1, -1.1, 49.7),
    "both": (11.7, 53.3, 6.6, 52.0),
}
PAPER_STAGES = {"detect": (18.8, 19.9), "look up": (0.3, 0.4), "describe": (64.4, 46.5), "associate": (2.1, 1.0)}
# The first two are printed as 0.011 and 0.031, which is shares: the whole gain of that row is 1.8 points.
PAPER_GAINS = {"aligned": 1.1, "oblique": 3.1, "centre": 17.703, "rim": 1.757}
RULE_NAMES = {"mota": "MOTA", "mota-and-idf1": "the mean of MOTA and IDF1"}
# Where these people are in an image of 1280x960, by the middle of their upright boxes.
REGIONS = {
    "aligned": "aligned, at most 22.5° from the image's axes",
    "oblique": "oblique, the others",
    "centre": "centre, at most 200 px from the image's middle",
    "rim": "rim, 300 to 500 px from it",
}


def interval(values: Sequence[float]) -> tuple[float, float | None, float | None]:
    """Mean over rooms and the ends of its 95 % interval by Student's t; no ends where there is one room."""
    if len(values) == 1:
        return values[0], None, None
    return intervals.interval(np.asarray(values, dtype=np.float64))


def _shown(found: tuple[float, float | None, float | None], asked: float | None = None) -> str:
    """An `interval` for a table or a note, and the thesis's value beside it."""
    mean, low, high = found
    around = "one room" if low is None or high is None else f"{low:.1f} to {high:.1f}"
    return f"{mean:.1f} ({around}{'' if asked is None else f', asked {asked:g}'})"


def tables(values: Mapping[str, Any]) -> list[Table]:
    """The tables of the experiment's values."""
    result = []
    for k, (label, rows) in enumerate(values["rows"].items()):
        column = {"large 1 fps": 0, "small 1 fps": 1, "large 15 fps": 2, "small 15 fps": 3}[label]
        lines = []
        for name, row in rows.items():
            paper = f"{PAPER[name][column]:g}" if name in PAPER else ""
            errors = [row[f"world_error_{name}"] for name in ("median", "mean", "90")]
            world = "" if errors[0] is None else ", ".join(f"{error:.2f}" for error in errors)
            lines.append([name, paper, _shown(interval(row["mota"])), f"{np.mean(row['idf1']):.1f}",
                          f"{np.mean(row['hota']):.1f}", f"{np.mean(row['id_switches']):.0f}", world])  # fmt: skip
        title = f"{'Table 4.3: ' if k == 0 else ''}{label}"
        columns = ("row", "MOTA, thesis", "MOTA", "IDF1", "HOTA", "switches", "world error, m (median, mean, 90 %)")
        result.append(Table(title, columns, lines))
    result += [_by_rule(values), _differences(values)]
    lines = [
        [
            REGIONS[label],
            row["row"],
            row["against"],
            f"{PAPER_GAINS[label]:g}",
            _shown(row["interval"]),
        ]
        for label, row in values["where"].items()
    ]
    result.append(Table("Table 4.4: points of MOTA gained, large room, 1 fps",
                        ("people", "row", "against", "thesis", "here"), lines))  # fmt: skip
    lines = [
        [
            room, row["part"], str(row["boxes"]), f"{row['ap50']:.3f}", f"{row['recall']:.3f}",
            "" if row["precision"] is None else f"{row['precision']:.3f}",
        ]
        for room, rows in values["detector"].items()
        for row in rows
    ]  # fmt: skip
    least = values["chosen"][values["chosen_by"]]["least_score"]
    title = f"Detections by angle to the axis and by side, 1 fps; recall and precision from {least:g} on"
    result.append(Table(title, ("room", "where", "people", "AP50", "recall", "precision"), lines))
    stages = values["milliseconds"]
    names = [*STAGES, "associate"]
    lines = [
        [n, *(f"{v:g}" for v in PAPER_STAGES.get(n, ("", ""))), *(f"{stages[room][n]:.2f}" for room in stages)]
        if n in PAPER_STAGES else [n, "", "", *(f"{stages[room][n]:.2f}" for room in stages)]
        for n in names
    ]  # fmt: skip
    headings = ("stage", "large, thesis", "small, thesis", "large", "small")
    result.append(Table("Table 4.5: milliseconds of the processor a frame", headings, lines))
    return result


def _by_rule(values: Mapping[str, Any]) -> Table:
    """MOTA and IDF1 at 1 frame a second with the settings that each rule chooses."""
    rules = values["rows_by_rule"]
    columns = [(rule, room, measure) for rule in rules for room in rules[rule] for measure in ("mota", "idf1")]
    names = list(next(iter(next(iter(rules.values())).values())))
    lines = [
        [name, *(f"{np.mean(rules[rule][room][name][measure]):.1f}" for rule, room, measure in columns)]
        for name in names
    ]
    headings = [f"{room}, {measure.upper()} ({RULE_NAMES[rule]})" for rule, room, measure in columns]
    return Table("The rows by what chose their settings, 1 fps", ("row", *headings), lines)


def _differences(values: Mapping[str, Any]) -> Table:
    """By how much rows are ahead of others, with intervals over rooms."""
    by_room = values["differences"]
    columns = [(room, measure) for room in by_room for measure in ("mota", "idf1")]
    lines = [
        [each[0]["row"], each[0]["mota"]["row"],
         *(_shown(at[measure]["interval"]) for at in each for measure in ("mota", "idf1"))]
        for each in zip(*by_room.values(), strict=True)
    ]  # fmt: skip
    headings = ("row", "over", *(f"{room}, {measure.upper()}" for room, measure in columns))
    return Table("Points gained, 1 fps", headings, lines)


def notes(values: Mapping[str, Any]) -> list[str]:
    """What was chosen, and by how much both parts are ahead."""
    seeds = " and ".join(map(str, values["validation_seeds"]))
    lines = []
    for rule, by_room in values["margins"].items():
        least = values["chosen"][rule]["least_score"]
        lines.append(f"chosen by {RULE_NAMES[rule]} on rooms of seeds {seeds}: lowest score {least:g}, all settings")
        for room, margins in by_room.items():
            asked = margins["asked"]
            for measure in ("mota", "idf1"):
                for label, margin in (("best image row", asked[0]), ("DeepSORT", asked[1])):
                    gain = margins[f"{measure} over {label}"]
                    told = _shown(gain["interval"], margin if measure == "mota" else None)
                    lines.append(f"{room}: {measure.upper()} of both over {label} ({gain['row']}): {told}")
    return lines
