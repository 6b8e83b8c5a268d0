"""Track people and objects in video: the names that a user needs, each loaded when it is first used.

    import tsuiseki

    tracker = tsuiseki.Sort()
    people = tracker.update(detections)

What is not named in ``__init__.pyi`` is internal and may change.
"""

from importlib.metadata import version as _version

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
__version__ = _version("tsuiseki")
