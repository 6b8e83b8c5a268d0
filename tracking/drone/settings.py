"""Settings of the drone tracker, and what differs there from the flow of people on a street."""

from __future__ import annotations

from dataclasses import field

from pydantic.dataclasses import dataclass

from tsuiseki.tracking.association.chain_motion import MotionNoise
from tsuiseki.tracking.association.costs import ActionCost
from tsuiseki.tracking.association.flow_window import FlowCosts
from tsuiseki.tracking.association.link_cost import LinkCost
from tsuiseki.tracking.association.video_evidence import DetectionCost
from tsuiseki.tracking.bounds import SETTINGS, Seconds
from tsuiseki.tracking.people.flow_input import FlowSettings, InputSettings

# Measured on generated clips with a detector of drawn people: its boxes of people from above are off by more than those
# of a street, above all in their widths, and people are lower there than tall, so that they move by more of their
# heights.
DRONE_MOTION = MotionNoise((0.08, 0.25, 0.13), (0.5, 0.8, 0.3), (2.5, 0.2, 0.2))


# Tuned for people from a drone: costs in nats, reach and speed in body heights, least shares in [0, 1].
# Many sit or lie, so that who stands and scores little is no clutter.
DRONE_FLOW = FlowSettings(
    input=InputSettings(
        detection=DetectionCost(offset=2.5, weight=2.0, least=0.02, interval=0.5),
        any_speed=False,
        box_noise=DRONE_MOTION.measurement[0],
    ),
    costs=FlowCosts(
        link=LinkCost(
            motion=DRONE_MOTION,
            reach=(0.6, 0.6),
            speed=(6.0, 6.0),
            size=0.8,
            neutral=(0.10, 0.07),
            action=ActionCost(weight=(10.0, 25.0), neutral=(0.05, 0.04), least=0.3),
        ),
        entry=12.0,
        exit=12.0,
        places=False,
    ),
    standing=True,
)


@dataclass(frozen=True, config=SETTINGS)
class DroneSettings:
    """Settings of the drone tracker.

    Attributes:
        flow: settings of the flow tracker.
        window: time over which reported actions are averaged, λ, seconds.
    """

    flow: FlowSettings = field(default_factory=lambda: DRONE_FLOW)
    window: Seconds = 0.5
