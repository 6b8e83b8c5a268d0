"""Finite-set filters (`phd`, `phd-unseen`, `blobs`, `phd-equalisation`).

Measured points are on the standard scenarios, and beside peers on new ones. Coloured objects that particles find in the
image itself are beside connected components, and with equal likelihoods.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias
from zipfile import BadZipFile

import numpy as np
from cyclopts.types import NonNegativeInt, PositiveInt
from matplotlib.figure import Figure
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial.distance import cdist

from benchmarks.papers.outcome import Outcome
from benchmarks.papers.peers import Peer, find_peer
from benchmarks.papers.store import Cached
from benchmarks.papers.tables import Column, Name, median_only, tabulated, values_of, with_error, with_interval
from tsuiseki.datamodules.scenes.blob_clip import BlobClip, BlobSceneSettings, as_ground_truth
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.point_distances import PointScores, PointTracks, evaluate_points
from tsuiseki.tracking.features.colour_region import NAMED_COLOURS, ColourImage
from tsuiseki.tracking.filters.base import Filter, SetInfo
from tsuiseki.tracking.filters.finite_sets import point_model
from tsuiseki.tracking.filters.finite_sets import region_likelihoods as likelihoods
from tsuiseki.tracking.filters.finite_sets.births import MeasurementBirths, MixtureBirths, newborn
from tsuiseki.tracking.filters.finite_sets.clusters import by_clusters, by_measurements
from tsuiseki.tracking.filters.finite_sets.labelled_multi_bernoulli import LabelledMultiBernoulliFilter
from tsuiseki.tracking.filters.finite_sets.phd import PhdFilter
from tsuiseki.tracking.filters.finite_sets.phd_identity import TrackIdentity
from tsuiseki.tracking.filters.finite_sets.region_phd import AnywhereBirths, PatchBirths, RegionPhdFilter
from tsuiseki.tracking.filters.point_motion import SteppingBox, constant_velocity, coordinated_turn
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.people.contract import run_tracker
from tsuiseki.tracking.people.sort import Sort
from tsuiseki.tracking.points.settings import BlobSettings, Lag, SetMethod
from tsuiseki.tracking.points.tracker import BlobTracker, MeasurementTracker
from tsuiseki.tracking.types import Detections, FloatArray, Frame, sensing_model
from tsuiseki.tracking.types.measurements import Scan
from tsuiseki.tracking.types.sensing_model import SensingModel

METHODS = ("phd-literal, (54)-(55)", "phd-literal", "phd", "labelled")
CUT_OFF = 100.0
BIRTHS_ANYWHERE = 0.1
"""Expected births a step where a scenario names no places."""
# OSPA p=1 of a plain SMC-PHD filter and of a labelled filter in MATLAB: by the seed of the scenario that they were
# measured on and by the clutter rate.
YARDSTICKS: Mapping[tuple[int, str], Mapping[float, float]] = {
    (20061, "phd"): {10: 14.5, 30: 17.0, 60: 19.8},
    (20061, "labelled"): {10: 10.2, 30: 11.3, 60: 12.8},
    (20091, "phd"): {10: 32.2, 30: 38.0, 60: 42.4},
}
REQUIRED = ("kind", "T", "K", "P_S", "P_D", "region", "clutter_rates", "runs", "sigma_v")
OF_KIND = {"linear": ("sigma_e",), "ct": ("sigma_turn", "sigma_bearing", "sigma_range")}


def reproduce(
    *, store: Cached, data: Path = Path("../shared/data"), particles: PositiveInt = 1000, runs: PositiveInt = 10
) -> Outcome:
    """The finite-set filters on the standard scenarios: OSPA, identities, time.

    DIR gets results.json and tables.md.

    Args:
        store: of what was computed.
        data: folder that holds phd/phd_scenario_*.json.
        particles: number of particles of each target.
        runs: Monte-Carlo runs of each scenario; at most as many as it has.

    Raises:
        RequestError: no scenario.
    """
    paths = sorted((data / "phd").glob("phd_scenario_*.json"))
    if not paths:
        raise RequestError(f"`data`: expected phd/phd_scenario_*.json in {data}, found none; give its folder")
    measured: dict[tuple[str, str, str], list[dict[str, float]]] = {}
    peers: dict[Name, float] = {}
    for path in paths:
        scenario = read_scenario(path)
        clutter = scenario.settings["clutter_rates"]
        rows = {
            (scenario.name, f"{clutter[rate]:g}", method): partial(run_scenario, path, rate, method, particles)
            for rate, method in product(range(len(clutter)), METHODS)
        }
        measured |= store.study(rows, range(min(runs, scenario.settings["runs"])), scenario.name)
        for name, rate in product(METHODS, clutter):
            peer_ospa = YARDSTICKS.get((scenario.settings.get("seed", 0), name), {}).get(rate)
            peers |= {} if peer_ospa is None else {(scenario.name, f"{rate:g}", name): peer_ospa}
    columns = [
        Column("OSPA p=1", "ospa1", show=partial(with_error, ddof=0), paper=peers, beside="peer, p=1"),
        Column("p=2", "ospa2"),
        Column("OSPA(2)", "ospa_tracks"),
        Column("count error", "cardinality_error", ".3f"),
        Column("switches", "switches", ".1f"),
        Column("ms/step", "milliseconds", show=median_only),
    ]
    heads = ("scenario", "clutter", "method")
    return Outcome(values_of(measured, heads), [tabulated(measured, columns, heads, "Standard scenarios")])


def run_scenario(path: Path, rate: int, method: str, particles: int, run: int) -> dict[str, float]:
    """Scores of a method with so many particles at one of a scenario's clutter rates, and its milliseconds a step."""
    scenario = read_scenario(path)
    settings = scenario.settings
    running = start_filter(method, settings, settings["clutter_rates"][rate], particles, seed=run)
    tracks, seconds = run_filter(running, scenario.measurements[run, rate])
    frames, targets = np.nonzero(~np.isnan(scenario.truth[:, :, 0]))
    true = PointTracks(frames, targets + 1, scenario.truth[frames, targets][:, [0, 2]])
    scores = evaluate_points(true, tracks, settings["K"], CUT_OFF)
    return {**asdict(scores), "milliseconds": 1e3 * float(np.median(seconds))}


class PointFilter:
    """A filter at work: it keeps the state from one step to the next."""

    def __init__(self, chosen: Filter[Any, FloatArray, SetInfo], state: object, rng: np.random.Generator) -> None:
        self.chosen, self.state, self.rng = chosen, state, rng

    def step(self, measurements: FloatArray) -> SetInfo:
        """One observation ``(M, Z)`` further."""
        self.state, info = self.chosen.step(self.state, measurements, self.rng)
        return info


def start_filter(method: str, settings: dict[str, Any], clutter: float, particles: int, seed: int) -> PointFilter:
    """A fresh filter at work on a scenario.

    ``phd-literal`` is the paper's filter: the particles of (50) and (57) by weight alone, targets read off by clusters,
    the labels of 5.2 as printed, nothing claimed or remembered, everything parted shown at once. It sums by (46), and
    by (54)-(55) where that is in its name. ``phd`` is ours, and ``labelled`` the multi-Bernoulli filter.
    """
    model = scenario_model(settings, clutter)
    births = scenario_births(settings, particles)
    # As many particles as (50) gives: so many times the expected number of births, wherever.
    printed = (
        replace(births, count=max(round(particles * float(np.mean(births.masses))), 1), sensor=None)
        if isinstance(births, MixtureBirths)
        else replace(births, limit=max(round(particles * BIRTHS_ANYWHERE), 1))
    )
    literal = PhdFilter(
        model, printed, particles, smallest_cluster=0, extract=by_clusters, identity=TrackIdentity(printed=True)
    )
    filters: dict[str, Filter[Any, FloatArray, SetInfo]] = {
        "labelled": LabelledMultiBernoulliFilter(model, births, particles),
        "phd": PhdFilter(model, births, particles, extract=by_measurements),
        "phd-literal": literal,
        "phd-literal, (54)-(55)": replace(literal, printed=True),
    }
    columns = 4 if settings["kind"] == "linear" else 5
    return PointFilter(filters[method], filters[method].init(np.empty((0, columns))), np.random.default_rng(seed))


def run_filter(running: PointFilter, measurements: Iterable[FloatArray]) -> tuple[PointTracks, FloatArray]:
    """The tracks found, and the processor's seconds in each step."""
    frames, ids, positions, seconds = [], [], [np.empty((0, 2))], []
    for index, scan in enumerate(measurements):
        begin = time.process_time()
        estimates = running.step(scan).estimates
        seconds.append(time.process_time() - begin)
        frames.append(np.full(len(estimates), index))
        ids.append(estimates.ids)
        positions.append(estimates.states[:, [0, 2]])
    return PointTracks(np.concatenate(frames), np.concatenate(ids), np.concatenate(positions)), np.array(seconds)


@dataclass(frozen=True)
class PointScenario:
    """Truth and measurements of a scenario.

    Attributes:
        name: of its file, without what all of them share.
        settings: what its json says.
        truth: ``(K, T, D)`` states, NaN while a target is absent.
        measurements: by run and index of the clutter rate, one ``(M, Z)`` array a step.
    """

    name: str
    settings: dict[str, Any]
    truth: FloatArray
    measurements: dict[tuple[int, int], list[FloatArray]]


@lru_cache(maxsize=2)
def read_scenario(path: Path) -> PointScenario:
    """The scenario whose settings are in ``path`` (json) and whose data is beside it (npz).

    Raises:
        RequestError: a file, a setting or an array is missing, or the kind is unknown.
    """
    data_path = path.with_suffix(".npz")
    try:
        settings = json.loads(path.read_text(encoding="utf-8"))
        for name in (*REQUIRED, *OF_KIND[settings["kind"]]):
            settings[name]
        with np.load(data_path, allow_pickle=False) as data:
            truth, z, run, clutter, step = (data[name] for name in ("truth", "z", "z_run", "z_clut", "z_k"))
    except KeyError as error:
        raise RequestError(f"{path}: expected a scenario of kind linear or ct, found no {error}") from error
    except (OSError, ValueError, EOFError, BadZipFile) as error:
        raise RequestError(f"{path}: expected settings, and beside them the arrays as npz, got: {error}") from error
    cells = {
        (r, c): [z[(run == r) & (clutter == c) & (step == k)] for k in range(settings["K"])]
        for r in range(settings["runs"])
        for c in range(len(settings["clutter_rates"]))
    }
    return PointScenario(path.stem.removeprefix("phd_scenario_"), settings, truth, cells)


def scenario_sensor(settings: dict[str, Any]) -> point_model.GaussianSensor:
    """The sensor of a scenario of kind ``linear`` or ``ct``."""
    if settings["kind"] == "linear":
        return point_model.GaussianSensor(point_model.cartesian, np.full(2, settings["sigma_e"]))
    return point_model.GaussianSensor(
        point_model.bearing_range, np.array([settings["sigma_bearing"], settings["sigma_range"]]), (0,)
    )


def scenario_model(settings: dict[str, Any], clutter_rate: float) -> point_model.PointModel:
    """The model that the scenario was made with: its motion, sensor, probabilities and clutter density."""
    volume = float(np.prod([high - low for low, high in settings["region"]]))
    sensor = scenario_sensor(settings)
    speed, turn = settings["sigma_v"], settings.get("sigma_turn")
    motion = constant_velocity(speed) if turn is None else coordinated_turn(speed, turn)
    chances = settings["P_S"], settings["P_D"]
    return point_model.PointModel(motion, sensor, *chances, clutter_rate / volume, settings["T"])


def scenario_births(settings: dict[str, Any], count: int) -> MixtureBirths | MeasurementBirths:
    """The scenario's places of birth; where it names none, births anywhere, driven by the measurements."""
    if "birth_m" in settings:
        masses, means, spread = (np.array(settings[f"birth_{name}"], dtype=np.float64) for name in ("w", "m", "sd"))
        return MixtureBirths(masses, means, spread, count, scenario_sensor(settings))
    volume = float(np.prod([high - low for low, high in settings["region"]]))
    speed = float(settings.get("birth_speed", 15.0))
    if settings["kind"] == "linear":
        complete, columns = newborn(lambda places: places, 2, speed), 4
    else:
        complete, columns = newborn(point_model.from_bearing_range, 2, speed, turn=0.05), 5
    return MeasurementBirths(BIRTHS_ANYWHERE / volume, scenario_sensor(settings), complete, columns, count // 5)


OURS: Mapping[str, tuple[SetMethod, Lag]] = {
    "labelled": ("labelled", 0),
    "labelled, `--lag 1`": ("labelled", 1),
    "PHD": ("phd", 0),
}
PEERS = ("Stone Soup GM-PHD", "multisensor-lmb-filters-rs LMB")
FIRST_SEED = 700
"""Of scenarios and clips: nothing was tuned on them."""


@dataclass(frozen=True)
class Scenarios:
    """What is drawn, and what every filter knows.

    Attributes:
        first: targets at the start.
        births: expected new ones a scan.
        places: ``(x, y)`` where all new targets appear, known to the filters; by default anywhere.
        bends: standard deviation of the true acceleration; 0 for straight paths.
        acceleration: the one that the filters assume, constant over each step.
        clutter: expected false measurements a scan.
        side: of the region, which is square and about the origin.
        survival, detection: probabilities.
        deviation: of a measured coordinate.
        speed: deviation of a new target's velocity.
        place_spread: deviation of a new target about its place.
        steps: scans, a second apart.
        schedule: place, first and last scan of each target, instead of chance.
    """

    first: int = 3
    births: float = 0.1
    places: tuple[tuple[float, float], ...] = ()
    bends: float = 5.0
    acceleration: float = 5.0
    clutter: float = 10.0
    side: float = 2000.0
    survival: float = 0.99
    detection: float = 0.98
    deviation: float = 10.0
    speed: float = 10.0
    place_spread: float = 10.0
    steps: int = 100
    schedule: tuple[tuple[int, int, int], ...] = ()

    @property
    def model(self) -> SensingModel:
        """For `MeasurementTracker`."""
        half, rate = 0.5 * self.side, self.births / max(len(self.places), 1)
        spread = (self.place_spread, self.speed, self.place_spread, self.speed)
        places = tuple(sensing_model.BirthPlace((x, 0.0, y, 0.0), spread, rate) for x, y in self.places)
        return SensingModel(
            sensing_model.SensorSettings("linear", (self.deviation,)),
            (sensing_model.MotionSettings("constant-velocity", self.acceleration),),
            detection=self.detection, survival=self.survival, clutter=self.clutter,
            region=((-half, half), (-half, half)), births=sensing_model.BirthSettings(self.births, self.speed, places),
        )  # fmt: skip


STANDARD_PLACES = ((0.0, 0.0), (400.0, -600.0), (-800.0, -200.0), (-200.0, 800.0))
"""Those of the usual linear scenario of the literature."""
STANDARD_SCHEDULE = (
    (0, 0, 69), (1, 0, 99), (2, 0, 69), (1, 19, 99), (1, 19, 99), (0, 19, 99),
    (2, 39, 99), (3, 39, 99), (2, 59, 99), (3, 59, 99), (0, 79, 99), (3, 79, 99),
)  # fmt: skip
"""Place, first and last scan of its targets."""
STANDARD = Scenarios(0, 0.12, STANDARD_PLACES, bends=0.0, schedule=STANDARD_SCHEDULE)
KINDS: Mapping[str, Scenarios] = {
    "anywhere": Scenarios(),
    "known places": Scenarios(0, 0.12, STANDARD_PLACES),
    "known places, straight paths": Scenarios(0, 0.12, STANDARD_PLACES, bends=0.0),
    "standard targets, 10 false": STANDARD,
    "standard targets, 30 false": replace(STANDARD, clutter=30.0),
    "standard targets, 60 false": replace(STANDARD, clutter=60.0),
}


def unseen(
    *,
    store: Cached,
    seeds: PositiveInt = 10,
    particles: PositiveInt = 1000,
    peer: str | None = None,
    seed: NonNegativeInt = FIRST_SEED,
    kinds: tuple[str, ...] = tuple(KINDS),
    filters: tuple[str, ...] = (*OURS, *PEERS),
) -> Outcome:
    """The labelled and the PHD filter on new scenarios, births anywhere or at known places, beside peers.

    A target that leaves the region has ended, which is not given to the filters; what any of them reports outside is
    dropped. DIR gets results.json and tables.md.

    Args:
        store: of what was computed.
        seeds: scenarios of each kind.
        particles: number of particles of each target.
        peer: python of an environment with stonesoup and multisensor-lmb-filters-rs; by default this one, if it has
            them.
        seed: of the first scenario.
        kinds: of scenarios; standard targets appear where and when those of the standard linear scenario do.
        filters: labelled is the default of `track points`.

    Raises:
        RequestError: the environment named has not the packages, or there is no such kind or filter.
    """
    if unknown := [*(set(kinds) - set(KINDS)), *(set(filters) - {*OURS, *PEERS})]:
        names = ", ".join([*KINDS, *OURS, *PEERS])
        raise RequestError(f"`kinds`, `filters`: expected some of {names}, got {', '.join(unknown)}")
    environment = find_peer(peer, "points")
    ways: dict[str, Follow] = {name: partial(our_rows, *way, particles) for name, way in OURS.items()}
    ways |= {name: partial(peer_rows, environment, name) for name in PEERS} if environment else {}
    ways = {name: way for name, way in ways.items() if name in filters}
    rows = {(kind, name): partial(run_sensed, KINDS[kind], way) for kind in kinds for name, way in ways.items()}
    measured = store.study(rows, range(seed, seed + seeds), "scenarios")
    fields = {"OSPA(2)": "ospa_tracks", "missed a scan": "missed", "false a scan": "false", "switches": "switches"}
    columns = [
        Column("OSPA p=1", "ospa1", show=with_error, gain=with_interval),
        *(Column(heading, name) for heading, name in fields.items()),
        Column("ms a step", "milliseconds", show=median_only),
    ]
    table = tabulated(measured, columns, ("births", "filter"), "New scenarios", base=lambda name: (name[0], "labelled"))
    peers = f"; peers: {environment.version}" if environment else ""
    note = f"{seeds} scenarios of each kind from seed {seed}; ± is the standard error, differences over labelled"
    return Outcome(values_of(measured, ("births", "filter")), [table], notes=[f"{note}{peers}."])


Followed: TypeAlias = tuple[Sequence[Sequence[float]], Sequence[float]]
"""Rows of scan, id, x, y, and milliseconds of processor time of each scan."""
Follow: TypeAlias = Callable[[Scenarios, Sequence[Scan]], Followed]


def our_rows(method: SetMethod, lag: Lag, particles: int, settings: Scenarios, scans: Sequence[Scan]) -> Followed:
    """A filter of ours with so many particles of each target."""
    tracker, milliseconds = MeasurementTracker(settings.model, method, particles, seed=0, lag=lag), []
    for scan in scans:
        begin = time.process_time()
        tracker.update(scan)
        milliseconds.append(1e3 * (time.process_time() - begin))
    return [
        (int(scan), track.id, *place)
        for track in tracker.tracks()
        for scan, place in zip(track.scans, track.positions, strict=True)
    ], milliseconds


def peer_rows(peer: Peer, name: str, settings: Scenarios, scans: Sequence[Scan]) -> Followed:
    """A filter of the peer by its name."""
    job = {"filter": name, "model": asdict(settings), "scans": [scan.measurements.tolist() for scan in scans]}
    answer = peer.answer(job)
    return answer["rows"], answer["milliseconds"]


def run_sensed(settings: Scenarios, follow: Follow, seed: int) -> dict[str, float]:
    """Scores of one filter on one scenario, and the median milliseconds of processor time of a step."""
    truth, scans = drawn_scenario(settings, seed)
    rows, milliseconds = follow(settings, scans)
    # Those outside the region are dropped.
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    table = table[np.abs(table[:, 2:]).max(axis=1, initial=0.0) <= 0.5 * settings.side]
    # A mixture may name two components alike: the first counts.
    _, first = np.unique(table[:, :2], axis=0, return_index=True)
    table = table[np.sort(first)]
    tracks = PointTracks(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2:])
    scores = evaluate_points(truth, tracks, settings.steps, CUT_OFF)
    return {**asdict(scores), "milliseconds": float(np.median(milliseconds))}


def drawn_scenario(settings: Scenarios, seed: int) -> tuple[PointTracks, list[Scan]]:
    """The targets of a seed, which go when they leave the region, and what is measured of them."""
    rng, half = np.random.default_rng(seed), 0.5 * settings.side
    states, names, born = np.empty((0, 4)), np.empty(0, dtype=np.int64), 0
    frames, ids, places, scans = [], [], [], []
    schedule = np.array(settings.schedule, dtype=np.int64).reshape(-1, 3)
    schedule = schedule[np.argsort(schedule[:, 1], kind="stable")]
    for k in range(settings.steps):
        alive = schedule[names - 1, 2] >= k if len(schedule) else rng.random(len(states)) < settings.survival
        states, names = states[alive], names[alive]
        x, y = settings.bends * rng.standard_normal((len(states), 2)).T
        states = states + np.stack([states[:, 1] + x / 2, x, states[:, 3] + y / 2, y], axis=1)
        inside = (np.abs(states[:, [0, 2]]) < half).all(axis=1)
        appearing = schedule[schedule[:, 1] == k, 0]
        count = settings.first if k == 0 else rng.poisson(settings.births)
        count = len(appearing) if len(schedule) else count
        new = np.zeros((count, 4))
        if len(schedule):
            # As in the standard scenario, right at its place.
            new[:, [0, 2]] = np.array(settings.places)[appearing]
        elif settings.places:
            chosen = np.array(settings.places)[rng.integers(0, len(settings.places), count)]
            new[:, [0, 2]] = chosen + settings.place_spread * rng.standard_normal((count, 2))
        else:
            new[:, [0, 2]] = rng.uniform(-0.5, 0.5, (count, 2)) * settings.side
        new[:, [1, 3]] = settings.speed * rng.standard_normal((count, 2))
        states = np.concatenate([states[inside], new])
        names = np.concatenate([names[inside], born + 1 + np.arange(count)])
        born += count
        frames.append(np.full(len(states), k, dtype=np.int64))
        ids.append(names)
        places.append(states[:, [0, 2]])
        detected = places[-1][rng.random(len(states)) < settings.detection]
        false = rng.uniform(-half, half, (rng.poisson(settings.clutter), 2))
        measured = np.concatenate([detected + settings.deviation * rng.standard_normal(detected.shape), false])
        scans.append(Scan(float(k), measured[rng.permutation(len(measured))]))
    return PointTracks(np.concatenate(frames), np.concatenate(ids), np.concatenate(places)), scans


BLOB_CUT_OFF = 50.0
USUAL = BlobSceneSettings(frames=100, width=480, height=360)
SCENES: Mapping[str, BlobSceneSettings] = {
    "usual clutter: 12 patches up to a third of an object": USUAL,
    "hard: 40 patches up to a half of an object": replace(USUAL, clutter=40, clutter_reach=0.25),
}
WAYS = ("components and SORT", "track blobs")


def blobs(*, store: Cached, seeds: PositiveInt = 5, particles: PositiveInt = 300) -> Outcome:
    """The tracker of coloured objects beside connected components and SORT, with usual and with hard clutter.

    DIR gets results.json and tables.md.

    Args:
        store: of what was computed.
        seeds: clips of each kind.
        particles: number of particles of each target.
    """
    rows = {(scene, name): partial(run_blobs, SCENES[scene], name, particles) for scene in SCENES for name in WAYS}
    measured = store.study(rows, range(FIRST_SEED, FIRST_SEED + seeds), "clips")
    columns = [
        Column("OSPA p=1", "ospa1", ".1f", show=with_error),
        Column("missed a frame", "missed"),
        Column("false a frame", "false"),
        Column("count error", "cardinality_error"),
        Column("switches a clip", "switches"),
    ]
    note = f"{seeds} clips of each kind from seed {FIRST_SEED}, cut-off {BLOB_CUT_OFF:g}; ± is the standard error."
    table = tabulated(measured, columns, ("clutter", "method"), "Coloured objects")
    return Outcome(values_of(measured, ("scene", "method")), [table], notes=[note])


def run_blobs(scene: BlobSceneSettings, method: str, particles: int, seed: int) -> PointScores:
    """A method with so many particles on one clip, an object being there while half of it is in the image."""
    frames = list(BlobClip(scene, seed).frames())
    colour = NAMED_COLOURS[scene.colour]
    if method == WAYS[0]:
        # Each patch of the colour that is large enough for an object in the filter's births.
        patches = PatchBirths(smallest=BlobSettings().smallest, limit=200)
        patch_boxes = [patches.patches(ColourImage.of(image, colour), np.empty((0, 4))) for (image,), _ in frames]
        tracks = run_tracker((Detections(boxes, np.ones(len(boxes))) for boxes in patch_boxes), Sort())
    else:
        tracker = BlobTracker(colour, BlobSettings(particles=particles))
        for index, ((image,), _) in enumerate(frames):
            tracker.update(Frame(index, index / scene.frame_rate, image))
        tracks = tracker.tracks()
    boxes, size = np.stack([boxes for _, boxes in frames]), np.array([scene.width, scene.height])
    sides = np.clip(np.minimum(boxes[..., 2:], size) - np.maximum(boxes[..., :2], 0), 0, None)
    share = sides.prod(axis=-1) / (boxes[..., 2:] - boxes[..., :2]).prod(axis=-1)
    truth = as_ground_truth(np.where((share >= 0.5)[..., None], boxes, np.nan))
    there = PointTracks(truth.frames, truth.ids, centres(truth.boxes))
    return evaluate_points(there, PointTracks.of(tracks), scene.frames, BLOB_CUT_OFF)


UPDATES: Mapping[str, tuple[likelihoods.Update, likelihoods.EachAlone]] = {
    "as printed": (likelihoods.as_printed, likelihoods.EachAlone()),
    "equalised": (likelihoods.Equalised(likelihoods.as_printed), likelihoods.EachAlone()),
    "calibrated": (likelihoods.calibrated, likelihoods.WithoutOthers()),
}
TARGETS = 3
LEAST, LOST_AFTER = 0.05, 5
"""A target with fewer than this share of its particles has none to speak of, and is lost after so many such frames."""
Weakened: TypeAlias = Mapping[str, FloatArray]
"""Of one clip, as `run_update` returns it."""


def equalisation(
    *, store: Cached, seeds: PositiveInt = 20, frames: PositiveInt = 150, particles: PositiveInt = 300
) -> Outcome:
    """Whether equal likelihoods keep the weak target of three: particles over time, with and without.

    The end of section 6.2. Targets of one colour and size but unequal purity stay in the image for the whole clip. The
    particles start on the targets, as many on each, and nothing is born, so that a target without particles stays lost.
    Their number is held, since the printed likelihood only shrinks their sum. DIR gets results.json, tables.md and
    particles.png.

    Args:
        store: of what was computed.
        seeds: clips.
        frames: length of each clip.
        particles: number of particles of each target.
    """
    scene = BlobSceneSettings(
        frames=frames, objects=TARGETS, purity=(0.45, 0.95), size=(34.0, 34.0), clutter=0, enter=0.0, stay=True,
        speed=2.0,
    )  # fmt: skip
    rows = {update: partial(run_update, update, scene, particles) for update in UPDATES}
    measured = store.study(rows, range(seeds), "clips")
    purity = np.sort(BlobClip(scene, 0).purity)

    def one_more(gained: FloatArray, _: str) -> str:
        return f"at least one on {100 * np.mean(gained >= 1):.0f} % of the clips"

    columns = [
        Column(f"kept of {TARGETS}", lambda clip: (clip["lost"] >= frames).sum(), gain=one_more),
        *(Column(f"frames, purity {p:.2f}", f"lost.{k}", ".0f") for k, p in enumerate(purity)),
        Column("expected count at the end", lambda clip: clip["expected"][-1], ".3g"),
    ]
    table = tabulated(measured, columns, ("update",), "Equal likelihoods", base="as printed")
    plots, notes = {"particles": plot_particles(measured, purity)}, [f"means over {seeds} clips"]
    numbers = {
        u: [{"lost": w["lost"], "expected_count_at_end": w["expected"][-1]} for w in of] for u, of in measured.items()
    }
    return Outcome(values_of(numbers, ("update",)), [table], plots, notes=notes)


def run_update(name: str, scene: BlobSceneSettings, density: int, seed: int) -> Weakened:
    """Follow the targets of a clip from its first frame with one of `UPDATES` and so many particles of each target.

    Returns:
        Of K targets, the weakest first, ``particles``: ``(T, K)`` on each; ``expected``: ``(T,)`` sum of the weights;
        ``lost``: ``(K,)`` first frame from which `LOST_AFTER` frames or the rest have too few particles on it; the
        length of the clip where it never was lost.
    """
    update, likelihood = UPDATES[name]
    rng = np.random.default_rng(seed)
    fixed = 0 if name == "calibrated" else density * scene.objects
    nowhere = AnywhereBirths(0.0, 0, size=(32.0, 32.0))
    chosen = RegionPhdFilter(SteppingBox(1.5, 0.5), nowhere, likelihood, update, density, fixed, 1.0)
    clip = BlobClip(scene, seed)
    counts, expected = [], []
    state = None
    for (image,), boxes in clip.frames():
        if state is None:
            # Particles on each target with its size, and the place before. Drawn for nothing, so that a seed gives the
            # particles of the published numbers.
            rng.uniform(0, 2 * np.pi, len(boxes))
            middles = np.repeat(centres(boxes), density, axis=0) + rng.standard_normal((len(boxes) * density, 2))
            previous = middles - 2.0 * rng.standard_normal(middles.shape)
            particles = np.column_stack([middles, previous, np.repeat(boxes[:, 2:] - boxes[:, :2], density, axis=0)])
            state = chosen.init(particles, np.repeat(np.arange(1, len(boxes) + 1), density), float(len(boxes)))
        state, info = chosen.step(state, ColourImage.of(image, NAMED_COLOURS[scene.colour]), rng)
        # A particle is on the target whose middle is nearest, of those that its own middle is inside.
        middle = centres(likelihoods.boxes_of(state.particles))
        inside = np.all((middle[:, None] >= boxes[None, :, :2]) & (middle[:, None] <= boxes[None, :, 2:]), axis=2)
        distance = np.where(inside, cdist(middle, centres(boxes)), np.inf)
        nearest = np.argmin(distance, axis=1)[np.isfinite(distance.min(axis=1))]
        counts.append(np.bincount(nearest, minlength=len(boxes)).astype(np.float64))
        expected.append(info.expected_count)
    particles = np.array(counts)[:, np.argsort(clip.purity)]
    few = np.concatenate([particles < LEAST * density, np.ones((LOST_AFTER, scene.objects), dtype=np.bool_)])
    lost = sliding_window_view(few, LOST_AFTER, axis=0).all(axis=-1).argmax(axis=0)
    return {"particles": particles, "expected": np.array(expected), "lost": lost.astype(np.float64)}


def plot_particles(measured: Mapping[str, list[Weakened]], purity: FloatArray) -> Figure:
    """Particles on each target over time, and how many of the clips still have it; a column for each update."""
    figure = Figure(figsize=(3.6 * len(measured), 5.4), dpi=90, layout="constrained")
    panels = figure.subplots(2, len(measured), sharex=True, sharey="row", squeeze=False)
    for (name, clips), (above, below) in zip(measured.items(), panels.T, strict=True):
        mean, lost = np.mean([clip["particles"] for clip in clips], axis=0), np.array([clip["lost"] for clip in clips])
        for target in reversed(range(len(purity))):
            above.plot(mean[:, target], label=f"purity {purity[target]:.2f}")
            below.plot(np.mean(lost[:, target, None] > np.arange(len(mean)), axis=0))
        above.set(title=name, ylim=(0, None))
        below.set(xlabel="frame", ylim=(0, 1.05))
    panels[0, 0].set_ylabel("particles on the target")
    panels[1, 0].set_ylabel("share of clips that still have it")
    panels[0, 0].legend(fontsize="small")
    return figure
