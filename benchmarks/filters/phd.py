"""Milliseconds a step of the finite-set filters beside Stone Soup's SMC-PHD filter at equal particle numbers.

    OMP_NUM_THREADS=1 python -m benchmarks.filters.phd --data ../shared/data [--steps 20]

Stone Soup (`pip install stonesoup`) is looked for in this environment; run it with a Python that has both, or give the
site-packages of another with PYTHONPATH. Blocks of ten scans are interleaved on the same measurements, in one run and
one thread, in processor time; the ratio is that of the medians. The particles counted are those that an update weighs,
births included.
"""

from __future__ import annotations

import argparse
import datetime
import platform
import time
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.papers.finite_sets import (
    PointScenario,
    read_scenario,
    scenario_births,
    scenario_model,
    start_filter,
)
from tsuiseki.tracking.filters.base import TargetEstimates
from tsuiseki.tracking.filters.finite_sets.clusters import Clusters, PhdState
from tsuiseki.tracking.filters.finite_sets.phd import PhdFilter
from tsuiseki.tracking.filters.finite_sets.phd_identity import TrackIdentity
from tsuiseki.tracking.filters.finite_sets.point_model import GaussianSensor

SURVIVING, BORN = 10_000, 4_000
# Scans in a row by one filter before the next has its turn: none runs on the caches that another has just filled.
BLOCK = 10


class StoneSoup:
    """Stone Soup's SMC-PHD filter on a linear scenario, with its expansion birth at the scenario's places."""

    def __init__(self, scenario: PointScenario, clutter: float) -> None:
        from stonesoup.models.measurement.linear import LinearGaussian
        from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
        from stonesoup.predictor.particle import SMCPHDPredictor
        from stonesoup.resampler.particle import SystematicResampler
        from stonesoup.types.array import StateVectors
        from stonesoup.types.numeric import Probability
        from stonesoup.types.state import GaussianState, ParticleState
        from stonesoup.updater.particle import SMCPHDUpdater

        settings = scenario.settings
        volume = float(np.prod([high - low for low, high in settings["region"]]))
        motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(settings["sigma_v"] ** 2)] * 2)
        self.sensor = LinearGaussian(4, (0, 2), np.eye(2) * settings["sigma_e"] ** 2)
        birth = GaussianState(np.zeros((4, 1)), np.diag([500.0**2, 100, 500.0**2, 100]))
        self.predictor = SMCPHDPredictor(
            motion, death_probability=1 - settings["P_S"], birth_probability=BORN / SURVIVING,
            birth_rate=float(np.sum(settings["birth_w"])), birth_sampler=_Sampler(birth),
        )  # fmt: skip
        self.updater = SMCPHDUpdater(
            self.sensor, resampler=SystematicResampler(), prob_detect=Probability(settings["P_D"]),
            clutter_intensity=clutter / volume, num_samples=SURVIVING,
        )  # fmt: skip
        self.now = datetime.datetime(2000, 1, 1)
        rng = np.random.default_rng(0)
        vectors = rng.multivariate_normal(np.zeros(4), birth.covar, SURVIVING).T
        self.state = ParticleState(
            StateVectors(vectors), weight=np.full(SURVIVING, Probability(1 / SURVIVING)), timestamp=self.now
        )

    def step(self, measurements: np.ndarray) -> None:
        """One scan."""
        from stonesoup.types.detection import Detection
        from stonesoup.types.hypothesis import SingleHypothesis
        from stonesoup.types.multihypothesis import MultipleHypothesis

        self.now += datetime.timedelta(seconds=1)
        prediction = self.predictor.predict(self.state, timestamp=self.now)
        found = [Detection(z[:, None], timestamp=self.now, measurement_model=self.sensor) for z in measurements]
        hypotheses = MultipleHypothesis([SingleHypothesis(prediction, one) for one in found])
        self.state = self.updater.update(hypotheses)


class _Sampler:
    """Draws `BORN` particles of a Gaussian birth, in the shape that Stone Soup's predictor asks for."""

    def __init__(self, birth: Any) -> None:
        self.birth = birth

    def sample(self, timestamp: object = None, **_: object) -> object:
        from stonesoup.types.array import StateVectors
        from stonesoup.types.numeric import Probability
        from stonesoup.types.state import ParticleState

        rng = np.random.default_rng(0)
        vectors = rng.multivariate_normal(np.zeros(4), self.birth.covar, BORN).T
        return ParticleState(StateVectors(vectors), weight=np.full(BORN, Probability(1 / BORN)), timestamp=timestamp)


class Unlabelled(TrackIdentity):
    """No labels are kept: what the peer does."""

    def tidy(self, posterior: PhdState, clusters: Clusters, sensor: GaussianSensor) -> tuple[PhdState, Clusters]:
        """Nothing."""
        del sensor
        return posterior, clusters


def no_targets(posterior: PhdState, clusters: Clusters) -> TargetEstimates:
    """No target is read off: the peer has none either."""
    del clusters
    return TargetEstimates(np.empty(0, dtype=np.int64), np.empty((0, posterior.particles.shape[1])), np.empty(0))


class CountedPhd:
    """This project's PHD filter, with or without targets and labels, and how many particles its updates weighed."""

    def __init__(self, scenario: PointScenario, clutter: float, labelled: bool) -> None:
        # Late in the scenario about ten targets and four places of birth: 1,000 for each make the peer's 14,000.
        density = (SURVIVING + BORN) // 14
        births = scenario_births(scenario.settings, density)
        model = scenario_model(scenario.settings, clutter)
        alone = PhdFilter(
            model, births, density, identity=Unlabelled(printed=True), extract=no_targets, smallest_cluster=0
        )
        self.filter = PhdFilter(model, births, density) if labelled else alone
        self.state, self.rng = self.filter.init(np.empty((0, 4))), np.random.default_rng(0)
        self.particles: list[int] = []

    def step(self, measurements: np.ndarray) -> None:
        """One scan."""
        self.state, info = self.filter.step(self.state, measurements, self.rng)
        self.particles.append(len(info.posterior))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--steps", type=int, default=20)
    arguments = parser.parse_args()
    scenario = read_scenario(arguments.data / "phd" / "phd_scenario_linear_dev.json")
    try:
        peer = f"stonesoup {metadata.version('stonesoup')}"
    except metadata.PackageNotFoundError:
        peer = ""
    print(f"{platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}, {peer or 'no stonesoup'}")
    names = (
        "clutter",
        "phd alone",
        "particles",
        "with targets",
        "particles",
        "labelled",
        "stonesoup",
        "ratio",
        "ratio",
    )
    print(" ".join(f"{name:>12}" for name in names))
    for index, clutter in enumerate(scenario.settings["clutter_rates"]):
        measurements = scenario.measurements[0, index][80 : 80 + arguments.steps]
        alone, phd = (CountedPhd(scenario, clutter, kept) for kept in (False, True))
        labelled = start_filter("labelled", scenario.settings, clutter, 1000, seed=0)
        for found in scenario.measurements[0, index][:80]:
            alone.step(found)
            phd.step(found)
            labelled.step(found)
        alone.particles.clear()
        phd.particles.clear()
        steps = {"alone": alone.step, "phd": phd.step, "labelled": labelled.step} | (
            {"peer": StoneSoup(scenario, clutter).step} if peer else {}
        )
        times: dict[str, list[float]] = {name: [] for name in steps}
        for first in range(0, len(measurements), BLOCK):
            for name, step in steps.items():
                for found in measurements[first : first + BLOCK]:
                    begin = time.process_time()
                    step(found)
                    times[name].append(1e3 * (time.process_time() - begin))
        middle = {name: float(np.median(values)) for name, values in times.items()}
        counts = {"alone": float(np.mean(alone.particles)), "phd": float(np.mean(phd.particles))}
        ratios = [middle["peer"] / middle[name] if peer else float("nan") for name in ("alone", "phd")]
        values = [
            clutter, middle["alone"], counts["alone"], middle["phd"], counts["phd"], middle["labelled"],
            middle.get("peer", float("nan")), *ratios,
        ]  # fmt: skip
        print(" ".join(f"{value:12.{0 if value >= 1000 else 2}f}" for value in values))


if __name__ == "__main__":
    main()
