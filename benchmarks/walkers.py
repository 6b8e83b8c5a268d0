"""Detections of walking people for the speed benchmarks: random, seeded, of any length and crowd."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.types import Detections, FloatArray


def walking_people(
    frames: int, people: int, seed: int = 0, size: tuple[int, int] = (1920, 1080), feature_length: int = 0
) -> list[Detections]:
    """Detections of ``people`` who walk about an image and turn back at its borders.

    One detection in ten is missed and one in twenty is false, boxes are noisy, people 100 to 200 pixels tall. With a
    ``feature_length`` everybody has an appearance, and every detection features near it.
    """
    rng = np.random.default_rng(seed)
    appearance = rng.normal(size=(people, feature_length))
    limits = np.array(size, dtype=np.float64)
    place, velocity = rng.uniform(0, 1, (people, 2)) * limits, rng.normal(0, 2, (people, 2))
    height = rng.uniform(100, 200, people)
    video = []
    for _ in range(frames):
        place = place + velocity
        velocity = np.where((place < 0) | (place > limits), -velocity, velocity) + rng.normal(0, 0.05, (people, 2))
        detected = rng.random(people) > 0.1
        false = rng.random(people) < 0.05
        middle = np.vstack(
            [place[detected] + rng.normal(0, 3, (detected.sum(), 2)), rng.uniform(0, 1, (false.sum(), 2)) * limits]
        )
        tall = np.append(height[detected] * np.exp(rng.normal(0, 0.03, detected.sum())), height[false])
        half = np.stack([0.2 * tall, 0.5 * tall], axis=1)
        scores = np.append(rng.uniform(0.8, 1, detected.sum()), rng.uniform(0.3, 0.9, false.sum()))
        found = Detections(np.hstack([middle - half, middle + half]), scores)
        if feature_length:
            rows = np.vstack([appearance[detected], rng.normal(size=(false.sum(), feature_length))])
            features = rows + rng.normal(0, 0.3, rows.shape)
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
    appearance = rng.normal(size=(2, feature_length))[rng.integers(0, 2, people)]
    video, actions_of = [], []
    for _ in range(frames):
        place = place + velocity
        turns = (place < 0.2 * limits) | (place > 0.8 * limits)
        velocity = np.clip(np.where(turns, -velocity, velocity) + rng.normal(0, 0.2, (people, 2)), -4, 4)
        does = np.where(rng.random(people) < 1 / 60, rng.integers(0, actions, people), does)
        jerk = rng.normal(0, 15, 2) if rng.random() < 1 / 7 else 0.0
        detected = np.flatnonzero(rng.random(people) < 0.8)
        middle = place[detected] + jerk + rng.normal(0, 3, (len(detected), 2))
        tall = height[detected] * np.exp(rng.normal(0, 0.1, len(detected)))
        half = np.stack([0.2 * tall, 0.5 * tall], axis=1)
        features = appearance[detected] + rng.normal(0, 0.8, (len(detected), feature_length))
        features /= np.linalg.norm(features, axis=1, keepdims=True)
        scores = rng.uniform(0.4, 1, len(detected))
        video.append(Detections(np.hstack([middle - half, middle + half]), scores).with_features(features))
        clear = np.full((len(detected), actions), 0.08)
        clear[np.arange(len(detected)), does[detected]] = 0.5
        clear = np.clip(clear + rng.normal(0, 0.35, clear.shape), 0.01, 1)
        blurred = rng.random((len(detected), 1)) < 0.3
        actions_of.append(np.where(blurred, rng.beta(0.5, 2, clear.shape), clear))
    return video, actions_of
