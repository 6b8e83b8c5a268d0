"""A box that the user draws with the mouse, on a page in the browser."""

from __future__ import annotations

from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.report.drawing import drawn_on
from tsuiseki.tracking.types import FloatArray, ImageArray

LEAST_SIDE = 2.0  # pixels
_PAGE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>Draw the target</title>
<style>
 body { font: 16px sans-serif; margin: 1rem; background: Canvas; color: CanvasText; color-scheme: light dark }
 #frame { position: relative; display: inline-block; touch-action: none; cursor: crosshair; user-select: none }
 img { display: block; max-width: 100%; max-height: 80vh; pointer-events: none }
 #box { position: absolute; outline: 2px solid #e8590c; background: #e8590c33; pointer-events: none }
 button { font: inherit; padding: .3rem 1rem }
</style>
<p>Draw a box round the target. <button disabled>Follow this</button> <span id="said" role="status"></span></p>
<div id="frame"><img src="image.png" alt="first frame of the video"><div id="box"></div></div>
<script>
 const frame = document.getElementById("frame"), image = document.querySelector("img");
 const box = document.getElementById("box"), button = document.querySelector("button");
 const said = document.getElementById("said");
 let from = null, drawn = null;
 function at(event) {
  const r = image.getBoundingClientRect(), share = (v, most) => Math.min(Math.max(v / most, 0), 1);
  return [share(event.clientX - r.left, r.width) * image.naturalWidth,
   share(event.clientY - r.top, r.height) * image.naturalHeight];
 }
 function show(to) {
  const [x, y] = [0, 1].map(k => Math.min(from[k], to[k])), [w, h] = [0, 1].map(k => Math.abs(from[k] - to[k]));
  const scale = image.clientWidth / image.naturalWidth;
  box.style.left = x * scale + "px"; box.style.top = y * scale + "px";
  box.style.width = w * scale + "px"; box.style.height = h * scale + "px";
  drawn = [x, y, w, h].map(v => Math.round(v * 10) / 10);
  button.disabled = w < 2 || h < 2;
  said.textContent = "x, y, width, height: " + drawn.join(", ");
 }
 frame.onpointerdown = event => { from = at(event); frame.setPointerCapture(event.pointerId); show(from); };
 frame.onpointermove = event => { if (from && event.buttons) show(at(event)); };
 button.onclick = async () => {
  const answer = await fetch("answer", {method: "POST", body: JSON.stringify(drawn)});
  said.textContent = answer.ok ? "The target is being followed. This page can be closed." : await answer.text();
  button.disabled = answer.ok;
 };
</script></html>
"""


def select_box(image: ImageArray) -> FloatArray:
    """``(4,)`` corners of a box that the user draws on an image with the mouse; see `drawn_on`.

    Raises:
        RequestError: the page cannot be served.
    """

    def box_of(answer: Any) -> FloatArray:
        try:
            x, y, width, height = map(float, answer)
        except (TypeError, ValueError):
            x = y = width = height = np.nan
        corners: FloatArray = np.array([x, y, x + width, y + height])
        if not np.isfinite(corners).all():
            raise RequestError("expected four numbers x, y, width, height")
        corners = np.clip(corners, 0, np.tile(image.shape[1::-1], 2))
        if (corners[2:] - corners[:2]).min() < LEAST_SIDE:
            raise RequestError(f"expected a box of at least {LEAST_SIDE:g} x {LEAST_SIDE:g} pixels inside the image")
        return np.asarray(corners)

    return drawn_on(image, _PAGE, box_of, "draw the box of the target", "give `box` instead")
