"""What the classes of COCO are called, for networks that were trained on it and do not say so."""

from __future__ import annotations

from collections.abc import Mapping

_NAMES = """person, bicycle, car, motorcycle, airplane, bus, train, truck, boat, traffic light, fire hydrant, stop sign,
parking meter, bench, bird, cat, dog, horse, sheep, cow, elephant, bear, zebra, giraffe, backpack, umbrella, handbag,
tie, suitcase, frisbee, skis, snowboard, sports ball, kite, baseball bat, baseball glove, skateboard, surfboard,
tennis racket, bottle, wine glass, cup, fork, knife, spoon, bowl, banana, apple, sandwich, orange, broccoli, carrot,
hot dog, pizza, donut, cake, chair, couch, potted plant, bed, dining table, toilet, tv, laptop, mouse, remote,
keyboard, cell phone, microwave, oven, toaster, sink, refrigerator, book, clock, vase, scissors, teddy bear,
hair drier, toothbrush"""
# Numbers that COCO itself, which counts from 1, leaves out.
_GAPS = {12, 26, 29, 30, 45, 66, 68, 69, 71, 83}
# Where people stand, by how many classes a network tells: 80 without gaps, 90 or 91 with COCO's own numbers.
COCO = {80: 0, 90: 1, 91: 1}


def coco_names(count: int | None) -> Mapping[int, str]:
    """Names by number for a network of so many classes; none where that is not a number of COCO's.

    >>> coco_names(80)[2], coco_names(91)[3], coco_names(91)[90]
    ('car', 'car', 'toothbrush')
    """
    if count not in COCO:
        return {}
    names = [name.strip() for name in _NAMES.split(",")]
    own = [number for number in range(1, 91) if number not in _GAPS]
    return dict(zip(range(80) if count == 80 else own, names, strict=True))
