"""Tables 5.3 to 5.5 of the thesis, paper and here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tsuiseki.trainers.experiments.drone.rows import ComparedMethod
from tsuiseki.trainers.experiments.experiment import Table

# Thesis Table 5.3: recall, precision, IDs, MOTA, MOTP; the names are those of the table's rows.
PAPER_PEOPLE: dict[ComparedMethod, tuple[float, float, int, float, float]] = {
    "deepsort": (29.10, 70.81, 584, 17.29, 32.85),
    "flow": (32.42, 73.93, 597, 21.43, 32.99),
    "flow-saf": (32.13, 74.10, 558, 21.20, 33.01),
    "flow-maf": (32.48, 74.24, 528, 21.57, 33.01),
}
# Table 5.4, the second data set.
PAPER_SECOND: dict[ComparedMethod, tuple[float, float, int, float, float]] = {
    "flow-saf": (89.68, 83.23, 47, 41.29, 33.98),
    "flow-maf": (89.68, 83.23, 43, 43.87, 33.98),
}
# Table 5.5, averages.
PAPER_ACTIONS = {
    "Single frame (local)": 42.88,
    "Single frame (local+global)": 45.94,
    "Multi frames (local)": 45.09,
    "Multi frames (local+global)": 47.80,
}
COLUMNS = ("Rcll", "Prcn", "IDs", "MOTA", "MOTP", "100(1-IoU)", "IDF1", "HOTA")
COMPARED = {"id_switches": "IDs", "mota": "MOTA", "idf1": "IDF1", "hota": "HOTA"}
IN_THE_PAPER = "paper: Rcll Prcn IDs MOTA MOTP"


def tables(values: Mapping[str, Any]) -> list[Table]:
    """The tables of the experiment, from all its numbers."""
    heading = ("method", *COLUMNS, *(f"{name} against flow" for name in COMPARED.values()), IN_THE_PAPER)
    return [
        *(
            Table(
                f"Table 5.3, the camera's motion {motion}",
                heading,
                [_person_row(n, r, PAPER_PEOPLE) for n, r in rows.items()],
            )
            for motion, rows in values["people"].items()
        ),
        Table(
            "Table 5.4, everything carried over to other clips",
            heading,
            [_person_row(n, r, PAPER_SECOND) for n, r in values["second"].items()],
        ),
        Table(
            "Camera's motion, the largest error over all steps of a flight; pixels",
            ("flight", "median place", "worst place", "best similarity, worst place", "largest step", "unknown steps"),
            [_flight_row(name, row) for name, row in values["camera"].items()],
        ),
        Table(
            "Bridging of missed detections, the camera's motion taken out",
            ("", "bridging", *COLUMNS),
            [_bridging_row(row) for row in values["bridging"]],
        ),
        _action_table(values["actions"]),
    ]


def _action_table(actions: Mapping[str, Any]) -> Table:
    names = next(iter(actions.values()))["actions"]
    rows = [[name, *(_percent(actions[kind]["actions"][name]["f1"]) for kind in actions)] for name in names]
    rows.append(["average", *(_percent(actions[kind]["mean_f1"]) for kind in actions)])
    rows.append(["mAP", *(_percent(actions[kind]["mean_average_precision"]) for kind in actions)])
    rows.append(["average in the paper", *(f"{PAPER_ACTIONS[kind]:.2f}" for kind in actions)])
    return Table("Table 5.5, F1 at 0.4 of every action, tracks given; percent", ["", *actions], rows)


def _person_row(name: str, row: Mapping[str, Any], paper: Mapping[Any, Sequence[float]]) -> list[str]:
    printed = " ".join(f"{value:g}" for value in paper[name]) if name in paper else ""
    return [name, *_scores(row), *(difference_cell(score, row["against_flow"][score]) for score in COMPARED), printed]


def difference_cell(score: str, of: Mapping[str, float]) -> str:
    """A difference and its interval: of switches as it is, of shares in points."""
    factor, digits = (1, 0) if score == "id_switches" else (100, 1)
    middle, low, high = (f"{factor * of[key]:+.{digits}f}" for key in ("difference", "low", "high"))
    return f"{middle} ({low} to {high})"


def _flight_row(name: str, row: Mapping[str, float]) -> list[str]:
    return [
        name,
        *(f"{row[key]:.1f}" for key in ("median", "worst", "best")),
        f"{row['step']:.0f}",
        f"{row['unknown']:.0f} of {row['steps']:.0f}",
    ]


def _bridging_row(row: Mapping[str, Any]) -> list[str]:
    return [row["method"], "yes" if row["bridging"] else "no", *_scores(row)]


def _scores(row: Mapping[str, float]) -> list[str]:
    cells = [f"{row[k]:.2f}" for k in ("recall", "precision", "mota", "motp", "motp_as_printed", "idf1", "hota")]
    return [*cells[:2], f"{row['id_switches']:.0f}", *cells[2:]]


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.2f}"
