"""Track people and objects in video: the names that a user needs, each loaded when it is first used.

    import tsuiseki

    tracker = tsuiseki.Sort()
    people = tracker.update(detections)

What is not named in ``__init__.pyi`` is internal and may change.
"""

from importlib import metadata as _metadata

import lazy_loader as _lazy

_load, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
__version__ = _metadata.version("tsuiseki")


def __getattr__(name: str) -> object:
    from tsuiseki.tracking.arguments import guarded

    value = globals()[name] = guarded(_load(name))
    if name.startswith(("track_", "follow_")):  # what they give is guarded, too
        _ = [globals().get(given) or __getattr__(given) for given in ("Result", "Frame")]
    return value
