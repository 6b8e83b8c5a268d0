"""Training for Lightning users: a module and a data module of each network, loaded when they are first used.

    import lightning as L
    from tsuiseki.training import DetectionData, Detector

    model, data = Detector(start="people"), DetectionData("labelled/")
    L.Trainer(max_epochs=5).fit(model, data)

It needs the train extra. What is not named in ``__init__.pyi`` is internal and may change.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
