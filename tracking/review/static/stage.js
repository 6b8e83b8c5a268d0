// The video with the boxes on it: drawn, zoomed, and changed with a mouse, a pen or fingers.

import { drawAsked, drawBox, fitted } from "./paint.js";

const EDGE = 9; // pixels around an edge in which it is taken
const STILL = 4; // pixels a pointer moves before it drags

/** `app` has `frame`, `state`, `boxes`, `pictures`, `chosen`, `flashed(id, frame)`, `nameOf(id)` and what happens. */
export class Stage {
  constructor(app) {
    this.app = app;
    this.picture = document.getElementById("picture");
    this.canvas = document.getElementById("boxes");
    this.view = { scale: 1, x: 0, y: 0 }; // `scale` times what fits, moved by pixels
    this.pointers = new Map();
    this.drag = null;
    this.adding = false;
    this.shown = null;
    const hears = (name, action) => this.canvas.addEventListener(name, action.bind(this));
    hears("pointerdown", this.down);
    hears("pointermove", this.move);
    hears("pointerup", this.up);
    hears("pointercancel", this.cancel);
    hears("wheel", this.wheel);
    new ResizeObserver(() => this.redraw()).observe(this.canvas);
  }

  /** Pixels of the canvas for one of the video, and where its corner is. */
  place() {
    const [width, height] = this.app.state.size, { clientWidth, clientHeight } = this.canvas;
    const fit = Math.min(clientWidth / width, clientHeight / height), scale = fit * this.view.scale;
    return {
      scale,
      x: (clientWidth - width * scale) / 2 + this.view.x,
      y: (clientHeight - height * scale) / 2 + this.view.y,
    };
  }

  toCanvas(box, at = this.place()) {
    return [box[0] * at.scale + at.x, box[1] * at.scale + at.y, box[2] * at.scale + at.x, box[3] * at.scale + at.y];
  }

  toVideo([x, y], at = this.place()) {
    return [(x - at.x) / at.scale, (y - at.y) / at.scale];
  }

  redraw() {
    this.shown = null;
    this.app.draw();
  }

  draw() {
    if (!this.app.state) return;
    const at = this.place();
    this.drawPicture(at);
    const [context] = fitted(this.canvas);
    context.font = "12px system-ui, sans-serif";
    const { frame } = this.app, found = this.app.boxes.at(frame);
    for (const { id, box, filled } of found ?? []) {
      const strong = this.app.chosen.some((one) => one.id === id), flash = this.app.flashed(id, frame);
      const moved = this.drag?.id === id && this.drag.box ? this.drag.box : box;
      const here = this.toCanvas(moved, at);
      drawBox(context, here, id, this.app.nameOf(id), { strong, thin: filled, flash });
      if (strong) this.drawHandles(context, here);
    }
    for (const row of this.app.question?.about ?? []) {
      if (row[0] === frame) drawAsked(context, this.toCanvas(row.slice(2), at));
    }
    if (this.drag?.kind === "add" && this.drag.box) {
      context.setLineDash([4, 4]);
      context.strokeStyle = "#fff";
      context.lineWidth = 2;
      const here = this.toCanvas(this.drag.box, at);
      context.strokeRect(here[0], here[1], here[2] - here[0], here[3] - here[1]);
    }
    this.canvas.dataset.drawn = Number(this.canvas.dataset.drawn ?? 0) + (found ? 1 : 0);
    this.canvas.dataset.frame = found ? frame : "";
  }

  drawHandles(context, here) {
    context.fillStyle = "#fff";
    context.strokeStyle = "#000";
    context.lineWidth = 1;
    for (const x of [here[0], here[2]]) {
      for (const y of [here[1], here[3]]) {
        context.fillRect(x - 3.5, y - 3.5, 7, 7);
        context.strokeRect(x - 3.5, y - 3.5, 7, 7);
      }
    }
  }

  /** The picture of the frame, or fainter the last one until it comes. */
  drawPicture(at) {
    const { frame, pictures, state } = this.app, picture = pictures.get(frame);
    if (picture) {
      const key = [frame, at.scale, at.x, at.y, this.canvas.clientWidth, this.canvas.clientHeight].join();
      if (key === this.shown) return;
      this.shown = key;
      const [context] = fitted(this.picture);
      context.drawImage(picture, at.x, at.y, state.size[0] * at.scale, state.size[1] * at.scale);
    } else if (!pictures.there && this.shown === null) {
      const [context] = fitted(this.picture);
      context.fillStyle = "#8884";
      context.fillRect(at.x, at.y, state.size[0] * at.scale, state.size[1] * at.scale);
    } else {
      this.shown = "";
    }
    this.picture.classList.toggle("stale", pictures.there && !picture);
  }

  zoom(by, [x, y] = [this.canvas.clientWidth / 2, this.canvas.clientHeight / 2]) {
    const before = this.toVideo([x, y]);
    this.view.scale = Math.min(Math.max(this.view.scale * by, 1), 16);
    if (this.view.scale === 1) Object.assign(this.view, { x: 0, y: 0 });
    else {
      const after = this.toCanvas([...before, ...before]);
      this.view.x += x - after[0];
      this.view.y += y - after[1];
    }
    this.redraw();
  }

  /** Move the view so that a box of the video can be seen. */
  reveal(box) {
    const here = this.toCanvas(box), { clientWidth, clientHeight } = this.canvas;
    if (this.view.scale > 1 && (here[0] < 0 || here[1] < 0 || here[2] > clientWidth || here[3] > clientHeight)) {
      this.view.x += clientWidth / 2 - (here[0] + here[2]) / 2;
      this.view.y += clientHeight / 2 - (here[1] + here[3]) / 2;
      this.redraw();
    }
  }

  wheel(event) {
    event.preventDefault();
    this.zoom(Math.exp(-event.deltaY / 400), [event.offsetX, event.offsetY]);
  }

  /** What is under a point: the edge or the inside of a chosen box first, then the smallest box. */
  under(point, slack) {
    const at = this.place(), hits = [];
    for (const { id, box } of this.app.boxes.at(this.app.frame) ?? []) {
      const here = this.toCanvas(box, at), chosen = this.app.chosen.some((one) => one.id === id);
      const edges = [0, 1, 2, 3].map((k) => Math.abs(point[k % 2] - here[k]) <= slack);
      const near = [0, 1].every((k) => point[k] >= here[k] - slack && point[k] <= here[k + 2] + slack);
      const inside = [0, 1].every((k) => point[k] >= here[k] && point[k] <= here[k + 2]);
      if (chosen && near && edges.some(Boolean)) return { id, box, edges, chosen };
      if (inside) hits.push({ id, box, chosen, area: (here[2] - here[0]) * (here[3] - here[1]) });
    }
    return hits.sort((a, b) => b.chosen - a.chosen || a.area - b.area)[0] ?? null;
  }

  down(event) {
    if (event.button) return;
    const point = [event.offsetX, event.offsetY];
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, point);
    if (this.pointers.size > 1) {
      this.drag = { kind: "pinch" };
      return;
    }
    const hit = this.adding ? null : this.under(point, event.pointerType === "mouse" ? EDGE : 2 * EDGE);
    const kind = this.adding ? "add" : hit?.chosen ? "box" : "pan";
    this.drag = { kind, begin: point, id: kind === "box" ? hit.id : null, old: hit?.box, edges: hit?.edges, hit };
  }

  move(event) {
    const point = [event.offsetX, event.offsetY], before = this.pointers.get(event.pointerId), { drag } = this;
    if (!before || !drag) return;
    this.pointers.set(event.pointerId, point);
    if (drag.kind === "pinch") {
      const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
      const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
      if (other) this.zoom(apart(point) / (apart(before) || 1), [(point[0] + other[0]) / 2, (point[1] + other[1]) / 2]);
      return;
    }
    drag.moved ||= Math.hypot(point[0] - drag.begin[0], point[1] - drag.begin[1]) > STILL;
    if (!drag.moved) return;
    if (drag.kind === "pan" && this.view.scale > 1) {
      this.view.x += point[0] - before[0];
      this.view.y += point[1] - before[1];
      this.redraw();
    }
    const [x, y] = this.toVideo(point), [left, top] = this.toVideo(drag.begin);
    if (drag.kind === "add") drag.box = [Math.min(x, left), Math.min(y, top), Math.max(x, left), Math.max(y, top)];
    if (drag.kind === "box") {
      const taken = drag.edges ?? [true, true, true, true];
      const by = [x - left, y - top], now = drag.old.map((value, k) => value + (taken[k] ? by[k % 2] : 0));
      drag.box = [0, 1, 2, 3].map((k) => Math[k < 2 ? "min" : "max"](now[k % 2], now[(k % 2) + 2]));
    }
    this.app.draw();
  }

  up(event) {
    this.pointers.delete(event.pointerId);
    const { drag } = this;
    this.drag = null;
    if (!drag || drag.kind === "pinch") return;
    const big = drag.box && drag.box[2] - drag.box[0] > 2 && drag.box[3] - drag.box[1] > 2;
    if (drag.kind === "add" && big) this.app.addBox(drag.box);
    else if (drag.kind === "box" && big) this.app.moveBox(drag.id, drag.box);
    else if (!drag.moved) this.app.click(drag.hit, this.toVideo(drag.begin));
    this.app.draw();
  }

  cancel(event) {
    this.pointers.delete(event.pointerId);
    this.drag = null;
    this.app.draw();
  }
}
