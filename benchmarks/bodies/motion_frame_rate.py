"""Whether motion learnt at one frame rate holds at another: deviations as scaled, over those that are learnt there.

    OMP_NUM_THREADS=1 python -m benchmarks.bodies.motion_frame_rate [--clips 6]

Exact states of generated fish, 10 s a clip, at 15, 30 and 60 frames a second; nothing is drawn or tracked. 1.00 is a
deviation that was predicted right.
"""

from __future__ import annotations

import argparse

import numpy as np

from tsuiseki.datamodules.scenes.goldfish_clip import GoldfishSettings, goldfish_states
from tsuiseki.tracking.bodies.body import Goldfish
from tsuiseki.tracking.filters.learnt_motion import LearntMotion, PrincipalComponents
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.learn_motion import learn_motion

RATES = (15.0, 30.0, 60.0)
SECONDS = 10
COLUMNS = ("forward", "sideways", "theta", "phi")


def learnt_at(rate: float, clips: int) -> LearntMotion:
    """What the exact states of so many clips teach."""
    settings = GoldfishSettings(frames=round(SECONDS * rate), frame_rate=rate, fish=3)
    states = [goldfish_states(settings, np.random.default_rng(seed)) for seed in range(clips)]
    body = Goldfish()
    tracks = [clip[:, fish] for clip in states for fish in range(settings.fish)]
    return learn_motion(tracks, body.name, body.fields, body.angles, rate)


def deviations(components: PrincipalComponents) -> FloatArray:
    """``(4,)`` of the columns."""
    return np.asarray(np.linalg.norm(components.noise().factor, axis=1))


def main() -> None:
    """Print a row for each pair of frame rates."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=int, default=6)
    clips = parser.parse_args().clips
    learnt = {rate: learnt_at(rate, clips) for rate in RATES}
    print(f"{'from':>6}{'to':>6}  what      " + "".join(f"{name:>10}" for name in COLUMNS))
    for one, other in ((15.0, 30.0), (30.0, 60.0), (60.0, 30.0), (30.0, 15.0)):
        scaled = learnt[one].at(other)
        for what in ("walk", "increments"):
            ratio = deviations(getattr(scaled, what)) / deviations(getattr(learnt[other], what))
            print(f"{one:6g}{other:6g}  {what:10}" + "".join(f"{value:10.2f}" for value in ratio))


if __name__ == "__main__":
    main()
