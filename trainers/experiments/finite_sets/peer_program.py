"""Runs filters of Stone Soup and of multisensor-lmb-filters-rs over scans, in an environment of its own.

    python peer_program.py < job.json > result.json

A job is ``{"filter": …, "settings": {setting: value}, "runs": [{"model": {…}, "scans": [[[x, y], …], …]}, …]}`` with
the models' numbers, ``leave`` "gone" where the filter is told that a target which leaves the region has ended; the
result is a list of ``{"rows": [[scan, id, x, y], …], "milliseconds": [one a scan]}``. Nothing of Tsuiseki is imported
here. Settings:

- GM-PHD: ``shown``, weight from which a component is a target; ``merge``, squared distance within which components are
  joined; ``prune``, weight below which they are dropped.
- LMB: ``shown``, existence from which a track is a target, 0 for as many as the package takes for the likeliest number;
  ``components``, most of a track; ``existence``, below which tracks are dropped; ``cells`` of the grid of births along
  each side where they may be anywhere.
"""

# mypy: ignore-errors

import datetime
import json
import sys
import time
import warnings
from importlib import metadata

import numpy as np
from scipy.stats import norm

SLOWEST = 120.0
"""Seconds after which a filter is given up on; its rows end there."""


def main():
    """Answer one job."""
    warnings.filterwarnings("ignore")
    names = ("stonesoup", "multisensor-lmb-filters-rs")
    version = ", ".join(f"{name} {metadata.version(name)}" for name in names)
    if sys.argv[1:] == ["--version"]:
        print(version)
        return
    job = json.load(sys.stdin)
    begin, settings = FILTERS[job["filter"]], job["settings"]
    json.dump([follow(begin(run["model"], **settings), run["scans"]) for run in job["runs"]], sys.stdout)


def follow(step, scans):
    """Rows and times of one filter over all scans."""
    rows, milliseconds = [], []
    begin = time.process_time()
    for number, scan in enumerate(scans):
        before = time.process_time()
        targets = step(number, np.array(scan, dtype=float).reshape(-1, 2))
        milliseconds.append(1e3 * (time.process_time() - before))
        rows += [[number, identity, float(x), float(y)] for identity, x, y in targets]
        if time.process_time() - begin > SLOWEST:
            break
    return {"rows": rows, "milliseconds": milliseconds}


def moment(number):
    """The time of a scan, for Stone Soup."""
    return datetime.datetime(2000, 1, 1) + datetime.timedelta(seconds=number)


def stone_soup_models(model):
    """Motion and sensor."""
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import LinearGaussianTransitionModel

    gain = model["acceleration"] * np.kron(np.eye(2), [[0.5], [1.0]])

    class Motion(LinearGaussianTransitionModel):
        """Constant velocity with a random acceleration constant over each step, as the scans were made."""

        ndim_state = 4

        def matrix(self, **_):
            return np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]])

        def covar(self, **_):
            return gain @ gain.T + 1e-9 * np.eye(4)

    return Motion(), LinearGaussian(4, (0, 2), np.eye(2) * model["deviation"] ** 2)


def births(model, cells):
    """Means and covariances of births at the known places, or of a grid of ``cells`` x ``cells`` over the region."""
    width, places = model["place_spread"], model["places"]
    if not places:
        step = model["side"] / cells
        middles = (np.arange(cells) + 0.5) * step - 0.5 * model["side"]
        width, places = step / 2, [(x, y) for x in middles for y in middles]
    covariance = np.diag([width**2, model["speed"] ** 2, width**2, model["speed"] ** 2])
    return [(np.array([x, 0.0, y, 0.0]), covariance) for x, y in places]


def stays(model, means, covariances):
    """Probability that targets ``(N, 4)`` still lie in the region a scan later, each axis by itself; 1 if not told."""
    if model["leave"] != "gone":
        return np.ones(len(means))
    gain = model["acceleration"] * np.kron(np.eye(2), [[0.5], [1.0]])
    move = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]])
    after = np.array(means, dtype=float).reshape(-1, 4) @ move.T
    spread = move @ np.array(covariances, dtype=float).reshape(-1, 4, 4) @ move.T + gain @ gain.T
    middle, deviation = after[:, ::2], np.sqrt(np.diagonal(spread, axis1=1, axis2=2)[:, ::2])
    half = 0.5 * model["side"]
    return np.prod(norm.cdf((half - middle) / deviation) - norm.cdf((-half - middle) / deviation), axis=1)


def gm_phd(model, shown, merge, prune):
    """Stone Soup's Gaussian-mixture PHD filter with one wide birth component; targets by weight, ids by tags."""
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.hypothesiser.gaussianmixture import GaussianMixtureHypothesiser
    from stonesoup.measures import Mahalanobis
    from stonesoup.mixturereducer.gaussianmixture import GaussianMixtureReducer
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.detection import Detection
    from stonesoup.types.state import TaggedWeightedGaussianState
    from stonesoup.updater.kalman import KalmanUpdater
    from stonesoup.updater.pointprocess import PHDUpdater

    motion, sensor = stone_soup_models(model)
    kalman = KalmanUpdater(sensor)
    updater = PHDUpdater(
        kalman,
        clutter_spatial_density=model["clutter"] / model["side"] ** 2,
        prob_detection=model["detection"],
        prob_survival=model["survival"],
    )
    base = DistanceHypothesiser(KalmanPredictor(motion), kalman, Mahalanobis(), missed_distance=5)
    hypothesiser = GaussianMixtureHypothesiser(base, order_by_detection=True)
    reducer = GaussianMixtureReducer(prune_threshold=prune, pruning=True, merge_threshold=merge, merging=True)
    new = births(model, 1)
    state = {"components": []}

    def step(number, scan):
        now = moment(number)
        weight, tag = model["births"] / len(new), TaggedWeightedGaussianState.BIRTH
        born = [
            TaggedWeightedGaussianState(mean[:, None], covariance, weight=weight, tag=tag, timestamp=now)
            for mean, covariance in new
        ]
        found = {Detection(z[:, None], timestamp=now, measurement_model=sensor) for z in scan}
        kept = state["components"]
        for one, share in zip(
            kept, stays(model, [c.state_vector[:, 0] for c in kept], [c.covar for c in kept]), strict=True
        ):
            one.weight = one.weight * share
        components = [*kept, *born]
        updated = updater.update(hypothesiser.hypothesise(components, found, now))
        state["components"] = list(reducer.reduce(updated))
        targets = [c for c in state["components"] if c.weight > shown and c.tag != "birth"]
        return [(number_of(c.tag), c.state_vector[0, 0], c.state_vector[2, 0]) for c in targets]

    return step


def jpda(model):
    """Stone Soup's joint probabilistic data association, begun by its measurement initiator."""
    from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
    from stonesoup.dataassociator.probability import JPDA
    from stonesoup.deleter.time import UpdateTimeStepsDeleter
    from stonesoup.functions import gm_reduce_single
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.hypothesiser.probability import PDAHypothesiser
    from stonesoup.initiator.simple import MultiMeasurementInitiator
    from stonesoup.measures import Mahalanobis
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.array import StateVectors
    from stonesoup.types.detection import Detection
    from stonesoup.types.state import GaussianState
    from stonesoup.types.update import GaussianStateUpdate
    from stonesoup.updater.kalman import KalmanUpdater

    motion, sensor = stone_soup_models(model)
    predictor, updater = KalmanPredictor(motion), KalmanUpdater(sensor)
    density = model["clutter"] / model["side"] ** 2
    associator = JPDA(PDAHypothesiser(predictor, updater, density, model["detection"], prob_gate=0.99))
    deleter = UpdateTimeStepsDeleter(3)
    initiator = MultiMeasurementInitiator(
        GaussianState(np.zeros((4, 1)), np.diag([0.0, model["speed"] ** 2, 0.0, model["speed"] ** 2])),
        deleter,
        GNNWith2DAssignment(DistanceHypothesiser(predictor, updater, Mahalanobis(), missed_distance=3)),
        updater,
        measurement_model=sensor,
        min_points=3,
    )
    tracks = set()

    def step(number, scan):
        now = moment(number)
        if model["leave"] == "gone":
            half = 0.5 * model["side"]
            out = [t for t in tracks if max(abs(t.state_vector[0, 0]), abs(t.state_vector[2, 0])) > half]
            tracks.difference_update(out)
        found = {Detection(z[:, None], timestamp=now, measurement_model=sensor) for z in scan}
        used = set()
        for track, hypotheses in associator.associate(tracks, found, now).items():
            states, weights = [], []
            for hypothesis in hypotheses:
                if hypothesis:
                    states.append(updater.update(hypothesis))
                    used.add(hypothesis.measurement)
                else:
                    states.append(hypothesis.prediction)
                weights.append(float(hypothesis.probability))
            vectors = StateVectors([s.state_vector for s in states])
            covariances = np.stack([s.covar for s in states], axis=2)
            mean, covariance = gm_reduce_single(vectors, covariances, np.array(weights))
            seen = any(hypotheses)
            kind = GaussianStateUpdate if seen else GaussianState
            more = {"hypothesis": hypotheses} if seen else {}
            track.append(kind(mean, covariance, timestamp=now, **more))
        tracks.difference_update(deleter.delete_tracks(tracks))
        tracks.update(initiator.initiate(found - used, now))
        return [(number_of(t.id), t.state_vector[0, 0], t.state_vector[2, 0]) for t in tracks]

    return step


def lmb(model, shown, components, existence, cells):
    """multisensor-lmb-filters-rs: labelled multi-Bernoulli filter with births on a grid over the region."""
    import multisensor_lmb_filters_rs as rs

    transition = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]])
    gain = model["acceleration"] * np.kron(np.eye(2), [[0.5], [1.0]])
    motion = rs.MotionModel(transition, gain @ gain.T, np.zeros(4), model["survival"])
    sensor = rs.SensorModel(
        np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0]]),
        np.eye(2) * model["deviation"] ** 2,
        model["detection"],
        model["clutter"],
        model["side"] ** 2,
    )
    new = births(model, int(cells))
    places = [rs.BirthLocation(k, mean, covariance) for k, (mean, covariance) in enumerate(new)]
    chosen = rs.FilterLmb(
        motion,
        sensor,
        rs.BirthModel(places, model["births"] / len(places), 1e-3),
        rs.AssociatorConfig.lbp(),
        rs.FilterThresholds(existence=existence, max_components=int(components)),
        seed=0,
    )

    def step(number, scan):
        if model["leave"] == "gone":
            chosen.set_tracks([lmb_track_that_stays(model, track) for track in chosen.get_tracks()])
        estimate = chosen.step([np.asarray(z) for z in scan], number)
        if shown:
            likely = [t for t in chosen.get_tracks() if t.existence > shown]
            targets = [(t.label, np.array(t.mu)[int(np.argmax(t.w))]) for t in likely]
        else:
            targets = [((t.label.birth_time, t.label.birth_location), t.mean) for t in estimate.tracks]
        return [(number_of(tuple(label)), mean[0], mean[2]) for label, mean in targets]

    return step


def lmb_track_that_stays(model, track):
    """The track with the existence and the weights that are left of it if what leaves the region has ended."""
    import multisensor_lmb_filters_rs as rs

    weights = np.array(track.w) * stays(model, track.mu, track.sigma)
    total = max(float(weights.sum()), 1e-12)
    means, covariances = np.array(track.mu).tolist(), np.array(track.sigma).tolist()
    return rs._TrackData(track.label, track.existence * total, means, covariances, (weights / total).tolist())


NUMBERS = {}


def number_of(name):
    """The same whole number for the same name."""
    return NUMBERS.setdefault(name, len(NUMBERS) + 1)


FILTERS = {"Stone Soup GM-PHD": gm_phd, "Stone Soup JPDA": jpda, "multisensor-lmb-filters-rs LMB": lmb}

if __name__ == "__main__":
    main()
