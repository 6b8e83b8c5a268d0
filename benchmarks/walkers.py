"""Detections of walking people for the speed benchmarks: random, seeded, of any length and crowd."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.types import Detections, FloatArray


def walking_people(
    frames: int, people: int, seed: int = 0, size: tuple[int, int] = (1920, 1080), feature_length: int = 0
) -> list[Detections]:
    """Detections of ``people`` who walk about an image and turn back at its borders.

    One detection in ten is missed and one in twenty is false, boxes are noisy, people 100 to 200 pixels tall. With a
    ``feature_length`` everybody has looks, and every detection features near those.
    """
    rng = np.random.default_rng(seed)
    looks = rng.normal(size=(people, feature_length))
    limits = np.array(size, dtype=np.float64)
    place, velocity = rng.uniform(0, 1, (people, 2)) * limits, rng.normal(0, 2, (people, 2))
    height = rng.uniform(100, 200, people)
    video = []
    for _ in range(frames):
        place = place + velocity
        velocity = np.where((place < 0) | (place > limits), -velocity, velocity) + rng.normal(0, 0.05, (people, 2))
        seen = rng.random(people) > 0.1
        false = rng.random(people) < 0.05
        middle = np.vstack(
            [place[seen] + rng.normal(0, 3, (seen.sum(), 2)), rng.uniform(0, 1, (false.sum(), 2)) * limits]
        )
        tall = np.append(height[seen] * np.exp(rng.normal(0, 0.03, seen.sum())), height[false])
        half = np.stack([0.2 * tall, 0.5 * tall], axis=1)
        scores = np.append(rng.uniform(0.8, 1, seen.sum()), rng.uniform(0.3, 0.9, false.sum()))
        found = Detections(np.hstack([middle - half, middle + half]), scores)
        if feature_length:
            seen_looks = np.vstack([looks[seen], rng.normal(size=(false.sum(), feature_length))])
            features = seen_looks + rng.normal(0, 0.3, seen_looks.shape)
            found = found.with_features(features / np.linalg.norm(features, axis=1, keepdims=True))
        video.append(found)
    return video


def acting_look_alikes(
    frames: int, people: int, actions: int, seed: int = 0, feature_length: int = 128
) -> tuple[list[Detections], list[FloatArray]]:
    """Detections of people in a crowd under a drone, and noisy probabilities of what they do.

    Everybody is dressed in one of two ways. In one frame of seven the camera jerks by a quarter of a person's height;
    one detection in five is missed, and three in ten say nothing of actions. Somebody does something else about every
    two seconds.
    """
    rng = np.random.default_rng(seed)
    limits = np.array([1280.0, 720.0])
    place, velocity = rng.uniform(0.3, 0.7, (people, 2)) * limits, rng.normal(0, 1.5, (people, 2))
    height, does = rng.uniform(50, 80, people), rng.integers(0, actions, people)
    looks = rng.normal(size=(2, feature_length))[rng.integers(0, 2, people)]
    video, said = [], []
    for _ in range(frames):
        place = place + velocity
        turns = (place < 0.2 * limits) | (place > 0.8 * limits)
        velocity = np.clip(np.where(turns, -velocity, velocity) + rng.normal(0, 0.2, (people, 2)), -4, 4)
        does = np.where(rng.random(people) < 1 / 60, rng.integers(0, actions, people), does)
        jerk = rng.normal(0, 15, 2) if rng.random() < 1 / 7 else 0.0
        seen = np.flatnonzero(rng.random(people) < 0.8)
        middle = place[seen] + jerk + rng.normal(0, 3, (len(seen), 2))
        tall = height[seen] * np.exp(rng.normal(0, 0.1, len(seen)))
        half = np.stack([0.2 * tall, 0.5 * tall], axis=1)
        features = looks[seen] + rng.normal(0, 0.8, (len(seen), feature_length))
        features /= np.linalg.norm(features, axis=1, keepdims=True)
        scores = rng.uniform(0.4, 1, len(seen))
        video.append(Detections(np.hstack([middle - half, middle + half]), scores).with_features(features))
        clear = np.full((len(seen), actions), 0.08)
        clear[np.arange(len(seen)), does[seen]] = 0.5
        clear = np.clip(clear + rng.normal(0, 0.35, clear.shape), 0.01, 1)
        blurred = rng.random((len(seen), 1)) < 0.3
        said.append(np.where(blurred, rng.beta(0.5, 2, clear.shape), clear))
    return video, said
