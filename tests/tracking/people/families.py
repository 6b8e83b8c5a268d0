"""Methods by what they keep to, so that a new method joins the tests of its family."""

from __future__ import annotations

from tsuiseki.tracking.people.lifecycle import LifecycleTracker
from tsuiseki.tracking.people.settings import ONLINE

# Online methods that confirm and end their tracks by the same settings.
LIFECYCLE = {
    method: kind for method, kind in ONLINE.items() if isinstance(kind, type) and issubclass(kind, LifecycleTracker)
}
