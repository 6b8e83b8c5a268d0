"""What is run of others, for `Peer`: functions of a job, which import nothing of ours and need `PACKAGES`."""

# mypy: ignore-errors

import datetime
import json
import sys
import time
import warnings
from importlib import metadata
from itertools import pairwise

import numpy as np

PACKAGES = {
    "links": ("trackers", "arcsort"),
    "counts": ("supervision", "trackers"),
    "points": ("stonesoup", "multisensor-lmb-filters-rs"),
    "csrt": ("opencv-contrib-python-headless",),
}
"""By program."""
LINKERS = ("ByteTrack", "C-BIoU", "SORT", "OC-SORT", "ARC-SORT")
TRANSITION = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]])


def version(program):
    """Of the packages of a program; an error where one is missing."""
    if program == "csrt":
        import cv2

        assert cv2.TrackerCSRT_create
        return cv2.__version__
    return ", ".join(f"{name} {metadata.version(name)}" for name in PACKAGES[program])


def links(job):
    """Rows frame, id, x1, y1, x2, y2, score by tracker of roboflow's ``trackers``, and of ``arcsort``.

    Args:
        job: ``boxes``, rows of frame, x1, y1, x2, y2, score; ``length``, frames; ``rate``, frames a second.
    """
    import arcsort
    import trackers

    boxes = np.array(job["boxes"], dtype=float).reshape(-1, 6)
    frames = [boxes[boxes[:, 0] == frame, 1:] for frame in range(job["length"])]
    rows = {name: [] for name in LINKERS}
    for name in LINKERS[:-1]:
        tracker = getattr(trackers, f"{name.replace('-', '')}Tracker")(frame_rate=job["rate"])
        for frame, here in enumerate(frames):
            tracked = tracker.update(detections(here[:, :4], here[:, 4]))
            if tracked.tracker_id is not None:
                boxes_of_ids = zip(tracked.xyxy, tracked.confidence, tracked.tracker_id, strict=True)
                # -1 is a detection without a confirmed track.
                rows[name] += [
                    [frame, int(n) + 1, *map(float, box), float(score)] for box, score, n in boxes_of_ids if n >= 0
                ]
    # As its page says, by boxes alone; it gives no scores.
    tracker = arcsort.ARCTracker.from_preset("sportsmot", use_cmc=False)
    for frame, here in enumerate(frames):
        tracked = tracker.update(np.insert(here, 5, 0.0, axis=1))
        rows["ARC-SORT"] += [[frame, int(number), *map(float, box), 1.0] for *box, number in tracked]
    return rows


def detections(boxes, scores):
    """Boxes of one class in supervision's terms."""
    from supervision import Detections

    return Detections(xyxy=boxes, confidence=scores, class_id=np.zeros(len(boxes), dtype=int))


def counts(job):
    """Supervision's crossings by line, to the right and back; people in the zone in each frame; mean seconds there.

    Args:
        job: ``rows`` of frame, id, x1, y1, x2, y2, score; ``track``, whether ids are to be found by ByteTrack;
            ``lines``, two ends each; ``zone``, corners; ``length``, frames; ``rate``, frames a second; ``corners``,
            whether all corners of a box must cross, as is its default, or the middle of the lower edge.
    """
    import supervision
    import trackers

    rows = np.array(job["rows"], dtype=float).reshape(-1, 7)
    tracker = trackers.ByteTrackTracker(frame_rate=job["rate"]) if job["track"] else None
    anchors = {} if job["corners"] else {"triggering_anchors": [supervision.Position.BOTTOM_CENTER]}
    points = [[supervision.Point(*map(float, end)) for end in ends] for ends in job["lines"]]
    lines = [supervision.LineZone(start=start, end=end, **anchors) for start, end in points]
    zone = supervision.PolygonZone(polygon=np.array(job["zone"]).round().astype(int))
    occupancy, seconds = [], {}
    for first, last in pairwise(np.searchsorted(rows[:, 0], np.arange(job["length"] + 1))):
        here = rows[first:last]
        tracked = detections(here[:, 2:6], here[:, 6])
        if tracker is None:
            tracked.tracker_id = here[:, 1].astype(int)
        else:
            tracked = tracker.update(tracked)
            tracked = tracked[tracked.tracker_id >= 0] if tracked.tracker_id is not None else tracked[:0]
        for line in lines:
            line.trigger(tracked)
        within = zone.trigger(tracked)
        occupancy.append(int(within.sum()))
        for number in tracked.tracker_id[within].tolist() if len(tracked) else ():
            seconds[number] = seconds.get(number, 0) + 1
    dwell = sum(seconds.values()) / len(seconds) / job["rate"] if seconds else 0.0
    # To the right, as one looks along a line, is what the package calls out.
    return {"crossings": [[line.out_count, line.in_count] for line in lines], "occupancy": occupancy, "dwell": dwell}


def csrt(job):
    """Boxes x, y, width, height of OpenCV-contrib's CSRT from the second image on.

    Args:
        job: ``images``, a file of ``(T, H, W, 3)`` uint8 BGR; ``box`` in the first; ``scales``, the sizes it tries.
    """
    import cv2

    cv2.setNumThreads(1)
    images, box = np.load(job["images"], mmap_mode="r"), job["box"]
    parameters = cv2.TrackerCSRT_Params()
    parameters.number_of_scales = job["scales"]
    tracker = cv2.TrackerCSRT_create(parameters)
    tracker.init(np.array(images[0]), tuple(round(value) for value in box))
    boxes = []
    for image in images[1:]:
        held, place = tracker.update(np.array(image))
        box = list(place) if held else box
        boxes.append(box)
    return boxes


def points(job):
    """``rows`` of scan, id, x, y and ``milliseconds`` of each scan, from ``filter``, ``model`` and ``scans``.

    The thresholds were chosen on the scenarios 200 to 205, on which ours were.
    """
    step = FILTERS[job["filter"]](job["model"])
    rows, milliseconds, ids = [], [], {}
    for number, scan in enumerate(job["scans"]):
        begin = time.process_time()
        targets = step(number, np.array(scan, dtype=float).reshape(-1, 2))
        milliseconds.append(1e3 * (time.process_time() - begin))
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


def gm_phd(model, least_weight=0.35, merge=10.0, prune=1e-5):
    """Stone Soup's Gaussian-mixture PHD filter; births anywhere are one wide component, ids are its tags.

    A component of a weight above ``shown`` is a target; components within the squared distance ``merge`` are joined,
    and those of a weight below ``prune`` dropped.
    """
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.hypothesiser.gaussianmixture import GaussianMixtureHypothesiser
    from stonesoup.measures import Mahalanobis
    from stonesoup.mixturereducer.gaussianmixture import GaussianMixtureReducer
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.detection import Detection
    from stonesoup.types.state import TaggedWeightedGaussianState
    from stonesoup.updater.kalman import KalmanUpdater
    from stonesoup.updater.pointprocess import PHDUpdater

    sensor = LinearGaussian(4, (0, 2), np.eye(2) * model["deviation"] ** 2)
    noise = gain_of(model) @ gain_of(model).T + 1e-9 * np.eye(4)
    motion = LinearGaussianTimeInvariantTransitionModel(transition_matrix=TRANSITION, covariance_matrix=noise)
    kalman = KalmanUpdater(sensor)
    density = model["clutter"] / model["side"] ** 2
    updater = PHDUpdater(kalman, density, prob_detection=model["detection"], prob_survival=model["survival"])
    base = DistanceHypothesiser(KalmanPredictor(motion), kalman, Mahalanobis(), missed_distance=5)
    hypothesiser = GaussianMixtureHypothesiser(base, order_by_detection=True)
    reducer = GaussianMixtureReducer(prune_threshold=prune, pruning=True, merge_threshold=merge, merging=True)
    new, components = births(model, 1), []

    def step(number, scan):
        now = datetime.datetime(2000, 1, 1) + datetime.timedelta(seconds=number)
        weight, tag = model["births"] / len(new), TaggedWeightedGaussianState.BIRTH
        born = [TaggedWeightedGaussianState(m[:, None], c, weight=weight, tag=tag, timestamp=now) for m, c in new]
        measured = {Detection(z[:, None], timestamp=now, measurement_model=sensor) for z in scan}
        updated = updater.update(hypothesiser.hypothesise([*components, *born], measured, now))
        components[:] = reducer.reduce(updated)
        targets = [c for c in components if c.weight > least_weight and c.tag != "birth"]
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

if __name__ == "__main__":
    warnings.filterwarnings("ignore")
    name, task = sys.argv[1], json.load(sys.stdin)
    json.dump(version(name) if task is None else globals()[name](task), sys.stdout)
