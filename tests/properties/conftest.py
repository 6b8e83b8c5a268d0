"""Profiles of hypothesis: the same examples in each run, and few enough that all properties take seconds."""

from __future__ import annotations

from hypothesis import HealthCheck, Phase, settings

# Small arrays are drawn fast; what is slow is what is tested.
UNHURRIED = [HealthCheck.too_slow]

settings.register_profile(
    "quick", derandomize=True, max_examples=25, deadline=None, database=None, suppress_health_check=UNHURRIED
)
# For planted faults: a failure is not made smaller.
settings.register_profile("planted", settings.get_profile("quick"), phases=[Phase.explicit, Phase.generate])
# For a search by hand: `python -m pytest tests/properties --hypothesis-profile searching`.
settings.register_profile("searching", settings.get_profile("quick"), derandomize=False, max_examples=500)
settings.load_profile("quick")
