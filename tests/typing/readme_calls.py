"""The calls of the README and of docs/how-to/python.md, as type checkers see them: never run, checked in `make lint`.

`tests/test_docs.py` holds that each block of these pages stands here.
"""

from __future__ import annotations

import numpy as np

import tsuiseki


def readme() -> None:
    tracks = tsuiseki.track_people("street.mp4")  # all at once
    for track in tracks:
        print(track.id, track.frames[0], track.boxes[0])  # x1, y1, x2, y2 in pixels

    for frame, people in tsuiseki.follow_people("street.mp4", method="sort"):  # frame by frame; 0 is a webcam
        print(frame.index, people.ids, people.boxes, people.status)

    tracker = tsuiseki.Sort(min_hits=1)  # boxes of your own detector
    people = tracker.update([[100, 80, 140, 180, 0.9]])
    print(people.ids, people.boxes)


def people() -> None:
    tracks = tsuiseki.track_people("street.mp4")  # shipped models, the flow over the whole video
    for track in tracks:
        print(track.id, track.frames[0], track.boxes[0], track.scores.mean())
    tsuiseki.write_tracks("tracks.txt", tracks)

    for frame, people in tsuiseki.follow_people(0, method="sort"):  # 0 is a webcam
        print(frame.index, people.ids, people.boxes, people.status)


def result(tracks: tsuiseki.Result[tsuiseki.Track]) -> None:
    print(tracks.frame_rate, tracks.size, tracks.by_id[1].frames)  # what a run gives knows its video
    print(tracks.at(20).ids)  # who is in frame 20; frames count from 0
    tracks.save("people.csv")
    tracks.overlay("people.webm")
    tsuiseki.with_page(tracks).save("people")  # the files of the command, with report.html
    print(tsuiseki.Result.load("people.csv"))


def one_target() -> None:
    for frame, target in tsuiseki.follow_single("street.mp4", box=(155, 252, 186, 331)):  # x1, y1, x2, y2
        print(frame.index, target.box, target.score, target.status)


def scores(tracks: tsuiseki.Result[tsuiseki.Track]) -> None:
    truth = tsuiseki.track_people("street.mp4", method="sort")  # or a folder, a file
    print(tsuiseki.evaluate_people(truth, tracks).hota)

    boxes = [target.box for _, target in tsuiseki.follow_single("street.mp4", box=(155, 252, 186, 331), method="kcf")]
    print(tsuiseki.evaluate_target(boxes, boxes).auc)


def objects() -> None:
    for frame, objects in tsuiseki.follow_blobs("balls.mp4", colour="red"):
        print(frame.index, objects.ids)

    measured = [np.array([[50.0 + 3 * t, 60.0], [200.0, 90.0 + 2 * t]]) for t in range(20)]
    print(tsuiseki.track_points(measured, extent=(320, 240)))

    births = {"rate": 0.1, "speed": 5}
    model = {"sensor": {"deviation": 2}, "clutter": 1, "region": [[0, 320], [0, 240]], "births": births}
    scans = [tsuiseki.Scan(0.7 * t, points) for t, points in enumerate(measured)]  # seconds, (M, 2)
    for track in tsuiseki.track_measurements(scans, model):
        print(track.id, track.times, track.positions, track.covariances)


def drone() -> None:
    result = tsuiseki.track_drone("flight")
    for person in result:
        if person.multi is not None:  # actions were recognised
            print(person.track.id, [result.names[int(k)] for k in person.multi.argmax(axis=1)])  # an action a frame


def bodies() -> None:
    settings = tsuiseki.DeformableSettings(particles=1000)
    print(tsuiseki.track_deformable("fish", body="goldfish", settings=settings))
    animals = tsuiseki.track_animals("fish", contrast="any")
    for animal in animals:
        print(animal.id, animal.frames, animal.states)  # a, b, theta, length, width


def ball() -> None:
    sources = ["ball/camera1", "ball/camera2"]
    path = tsuiseki.track_sphere(sources, cameras="ball/cameras.yaml", radius=0.1, start=(0.39, -0.38, 0.94))
    for position in path:
        print(position.time, position.point, position.status)


def what_is_no_call() -> None:
    """Each is an error to a type checker: where one is not any more, its `ignore` is reported."""
    tsuiseki.Sort(min_hitz=1)  # type: ignore[call-arg]
    tsuiseki.Sort(min_hits="1")  # type: ignore[arg-type]
    tsuiseki.SortSettings(min_hitz=1)  # type: ignore[call-arg]
    tsuiseki.FlowTracker(fil=0.0)  # type: ignore[call-arg]
    tsuiseki.track_people("street.mp4", methods="sort")  # type: ignore[call-arg]
    tsuiseki.track_people("street.mp4", "sorted")  # type: ignore[arg-type]
    tsuiseki.track_deformable("fish", preset="learned")  # type: ignore[arg-type]
    tsuiseki.track_sphere([], "cameras.yaml", 0.1, begin=(0, 0, 1))  # type: ignore[call-arg]
