"""Track people and objects in video: the names that a user needs, each loaded when it is first used.

    import tsuiseki

    tracker = tsuiseki.Sort()
    people = tracker.update(detections)

What is not named in ``__init__.pyi`` is internal and may change. The import turns off onnxruntime's telemetry, unless
the variable ``ORT_DISABLE_TELEMETRY`` is set already.
"""

import os as _os
from importlib.metadata import version as _version

import lazy_loader as _lazy

# From 1.32 on, onnxruntime writes a number of this machine and events into the user's cache, and sends them where it
# can. It reads this when it is imported, which may happen anywhere below.
_os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
__version__ = _version("tsuiseki")
