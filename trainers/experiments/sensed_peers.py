"""Filters of Stone Soup and multisensor-lmb-filters-rs over scans; a program of `Peer`.

The thresholds were chosen on the scenarios 200 to 205, on which ours were.
"""

# mypy: ignore-errors

import datetime
import time
from importlib import metadata

import numpy as np

TRANSITION = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]])


def version():
    """Of both packages."""
    return ", ".join(f"{name} {metadata.version(name)}" for name in ("stonesoup", "multisensor-lmb-filters-rs"))


def answer(job):
    """``rows`` of scan, id, x, y and ``milliseconds`` of each scan, from ``filter``, ``model`` and ``scans``."""
    return follow(FILTERS[job["filter"]](job["model"]), job["scans"])


def follow(step, scans):
    """Rows and times of one filter over all scans."""
    rows, milliseconds, ids = [], [], {}
    for number, scan in enumerate(scans):
        before = time.process_time()
        targets = step(number, np.array(scan, dtype=float).reshape(-1, 2))
        milliseconds.append(1e3 * (time.process_time() - before))
        rows += [[number, ids.setdefault(name, len(ids) + 1), float(x), float(y)] for name, x, y in targets]
    return {"rows": rows, "milliseconds": milliseconds}


def gain_of(model):
    """From a random acceleration that is constant over each step to the state, as the scans were made."""
    return model["acceleration"] * np.kron(np.eye(2), [[0.5], [1.0]])


def births(model, cells):
    """Means and covariances of births at the known places, or of a grid of ``cells`` x ``cells`` over the region."""
    width, places = model["place_spread"], model["places"]
    if not places:
        side = model["side"] / cells
        middles = (np.arange(cells) + 0.5) * side - 0.5 * model["side"]
        width, places = side / 2, [(x, y) for x in middles for y in middles]
    covariance = np.diag([width**2, model["speed"] ** 2, width**2, model["speed"] ** 2])
    return [(np.array([x, 0.0, y, 0.0]), covariance) for x, y in places]


def gm_phd(model, shown=0.35, merge=10.0, prune=1e-5):
    """Stone Soup's Gaussian-mixture PHD filter; births anywhere are one wide component, ids are its tags.

    A component of a weight above ``shown`` is a target; components within the squared distance ``merge`` are joined,
    and those of a weight below ``prune`` dropped.
    """
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.hypothesiser.gaussianmixture import GaussianMixtureHypothesiser
    from stonesoup.measures import Mahalanobis
    from stonesoup.mixturereducer.gaussianmixture import GaussianMixtureReducer
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import LinearGaussianTransitionModel
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.detection import Detection
    from stonesoup.types.state import TaggedWeightedGaussianState
    from stonesoup.updater.kalman import KalmanUpdater
    from stonesoup.updater.pointprocess import PHDUpdater

    class PlaneMotion(LinearGaussianTransitionModel):
        """Constant velocity with a random acceleration."""

        ndim_state = 4

        def matrix(self, **_):
            return TRANSITION

        def covar(self, **_):
            return gain_of(model) @ gain_of(model).T + 1e-9 * np.eye(4)

    sensor = LinearGaussian(4, (0, 2), np.eye(2) * model["deviation"] ** 2)
    kalman = KalmanUpdater(sensor)
    density = model["clutter"] / model["side"] ** 2
    updater = PHDUpdater(kalman, density, prob_detection=model["detection"], prob_survival=model["survival"])
    base = DistanceHypothesiser(KalmanPredictor(PlaneMotion()), kalman, Mahalanobis(), missed_distance=5)
    hypothesiser = GaussianMixtureHypothesiser(base, order_by_detection=True)
    reducer = GaussianMixtureReducer(prune_threshold=prune, pruning=True, merge_threshold=merge, merging=True)
    new, components = births(model, 1), []

    def step(number, scan):
        now = datetime.datetime(2000, 1, 1) + datetime.timedelta(seconds=number)
        weight, tag = model["births"] / len(new), TaggedWeightedGaussianState.BIRTH
        born = [TaggedWeightedGaussianState(m[:, None], c, weight=weight, tag=tag, timestamp=now) for m, c in new]
        found = {Detection(z[:, None], timestamp=now, measurement_model=sensor) for z in scan}
        updated = updater.update(hypothesiser.hypothesise([*components, *born], found, now))
        components[:] = reducer.reduce(updated)
        targets = [c for c in components if c.weight > shown and c.tag != "birth"]
        return [(c.tag, c.state_vector[0, 0], c.state_vector[2, 0]) for c in targets]

    return step


def lmb(model, components=20, existence=1e-4, cells=8):
    """multisensor-lmb-filters-rs: labelled multi-Bernoulli filter; births anywhere are a grid of ``cells`` x ``cells``.

    A track has so many ``components`` at most, and is dropped below ``existence``.
    """
    import multisensor_lmb_filters_rs as rs

    gain = gain_of(model)
    motion = rs.MotionModel(TRANSITION, gain @ gain.T, np.zeros(4), model["survival"])
    sees, noise = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0]]), np.eye(2) * model["deviation"] ** 2
    sensor = rs.SensorModel(sees, noise, model["detection"], model["clutter"], model["side"] ** 2)
    places = [rs.BirthLocation(k, mean, covariance) for k, (mean, covariance) in enumerate(births(model, cells))]
    born = rs.BirthModel(places, model["births"] / len(places), 1e-3)
    thresholds = rs.FilterThresholds(existence=existence, max_components=components)
    chosen = rs.FilterLmb(motion, sensor, born, rs.AssociatorConfig.lbp(), thresholds, seed=0)

    def step(number, scan):
        estimate = chosen.step([np.asarray(z) for z in scan], number)
        return [((t.label.birth_time, t.label.birth_location), t.mean[0], t.mean[2]) for t in estimate.tracks]

    return step


FILTERS = {"Stone Soup GM-PHD": gm_phd, "multisensor-lmb-filters-rs LMB": lmb}
