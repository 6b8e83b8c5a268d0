// A lane for every person: when they are there, where the tracks are uncertain, what was changed or is marked.

import { colourOf, css, dashOf, fitted } from "./paint.js";

const LANE = 18, GUTTER = 76, HEAD = 14;

export class Timeline {
  /** `app` as in `Stage`, with `segment` and `mark(id, first, last)`. */
  constructor(app) {
    this.app = app;
    this.box = document.getElementById("lanes");
    this.canvas = document.getElementById("timeline");
    this.lanes = [];
    this.drag = null;
    this.box.addEventListener("scroll", () => app.draw(), { passive: true });
    this.canvas.addEventListener("pointerdown", (event) => this.down(event));
    this.canvas.addEventListener("pointermove", (event) => this.move(event));
    this.canvas.addEventListener("pointerup", (event) => this.up(event));
    this.canvas.addEventListener("pointercancel", () => (this.drag = null));
    new ResizeObserver(() => app.draw()).observe(this.box);
  }

  renew() {
    const { state } = this.app;
    this.lanes = [...state.tracks].sort((a, b) => a.spans[0][0] - b.spans[0][0] || a.id - b.id);
    this.row = new Map(this.lanes.map((track, k) => [track.id, k]));
    this.box.lastElementChild.style.height = `${HEAD + this.lanes.length * LANE + 6}px`;
  }

  x(frame) {
    return GUTTER + ((this.box.clientWidth - GUTTER - 8) * (frame + 0.5)) / Math.max(this.app.state.frames, 1);
  }

  frame(x) {
    const share = (x - GUTTER) / (this.box.clientWidth - GUTTER - 8);
    return Math.min(Math.max(Math.floor(share * this.app.state.frames), 0), this.app.state.frames - 1);
  }

  /** Scroll so that the lane of a person can be seen. */
  reveal(id) {
    const top = (this.row?.get(id) ?? 0) * LANE, { scrollTop, clientHeight } = this.box;
    if (top < scrollTop || top + LANE + HEAD > scrollTop + clientHeight) this.box.scrollTop = top - clientHeight / 2;
  }

  draw() {
    if (!this.app.state) return;
    const height = this.box.clientHeight, width = this.box.clientWidth;
    if (this.canvas.clientHeight !== height) {
      this.canvas.style.height = `${height}px`;
      this.box.lastElementChild.style.marginTop = `${-height}px`;
    }
    const [context] = fitted(this.canvas, width, height);
    const ink = { text: css("--text"), line: css("--line"), faint: css("--faint"), warn: css("--warn"), mark: css("--strong") };
    context.font = "12px system-ui, sans-serif";
    const top = this.box.scrollTop, begin = Math.max(0, Math.floor((top - HEAD) / LANE));
    const end = Math.min(this.lanes.length, begin + Math.ceil(height / LANE) + 1);
    for (let k = begin; k < end; k++) this.drawLane(context, this.lanes[k], HEAD + k * LANE - top, ink);
    for (const question of this.app.state.questions) {
      for (const id of question.ids) {
        const k = this.row.get(id);
        if (k >= begin && k < end) this.drawMark(context, this.x(question.frame), HEAD + k * LANE - top, ink, question);
      }
    }
    context.fillStyle = css("--ground");
    context.fillRect(0, 0, width, HEAD);
    this.drawScale(context, width, ink);
    // Of boxes that are in no track.
    const alone = this.app.state.questions.filter((question) => !question.ids.length);
    for (const question of alone) this.drawMark(context, this.x(question.frame), 1, ink, question);
    const here = Math.round(this.x(this.app.frame)) + 0.5;
    context.strokeStyle = ink.text;
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(here, 0);
    context.lineTo(here, height);
    context.stroke();
  }

  drawLane(context, track, y, ink) {
    const { app } = this, chosen = app.chosen.some((one) => one.id === track.id);
    context.fillStyle = chosen ? ink.mark : ink.text;
    const label = app.nameOf(track.id);
    context.fillText(label, 6, y + 13, GUTTER - 12);
    context.strokeStyle = context.fillStyle = colourOf(track.id);
    context.lineWidth = 8;
    context.setLineDash(dashOf(track.id).map((part) => part * 2));
    context.beginPath();
    let before = -1;
    for (const [first, last] of track.spans) {
      const from = this.x(first - 0.5), to = Math.max(this.x(last + 0.5), from + 1);
      if (to <= before) continue;
      context.moveTo(Math.max(from, before), y + LANE / 2);
      context.lineTo((before = to), y + LANE / 2);
    }
    context.stroke();
    context.setLineDash([]);
    const outline = (first, last, colour) => {
      const from = this.x(first - 0.5), to = this.x(last + 0.5);
      context.strokeStyle = colour;
      context.lineWidth = 2;
      context.strokeRect(from, y + 2, Math.max(to - from, 2), LANE - 4);
    };
    if (app.segment?.id === track.id) outline(app.segment.first, app.segment.last, ink.mark);
    const flash = app.flashes.get(track.id);
    if (flash) outline(...flash, ink.warn);
  }

  /** A triangle where the tracks are uncertain; the question that is asked has a filled one. */
  drawMark(context, x, y, ink, question) {
    context.beginPath();
    context.moveTo(x - 5, y + 1);
    context.lineTo(x + 5, y + 1);
    context.lineTo(x, y + 10);
    context.closePath();
    context.fillStyle = question === this.app.question ? ink.warn : css("--ground");
    context.fill();
    context.strokeStyle = ink.text;
    context.lineWidth = 1.3;
    context.stroke();
  }

  drawScale(context, width, ink) {
    const { frames } = this.app.state, wanted = frames / Math.max(1, (width - GUTTER) / 90);
    const power = 10 ** Math.floor(Math.log10(Math.max(wanted, 1)));
    const step = Math.max(1, power * [1, 2, 5, 10].find((k) => k * power >= wanted));
    context.fillStyle = ink.faint;
    for (let frame = 0; frame < frames; frame += step) {
      const x = this.x(frame ? frame - 1 : 0);
      if (x < width - 40) context.fillText(String(frame || 1), x - 3, 11);
    }
  }

  down(event) {
    if (event.button) return;
    this.canvas.setPointerCapture(event.pointerId);
    const k = Math.floor((event.offsetY - HEAD + this.box.scrollTop) / LANE), frame = this.frame(event.offsetX);
    const id = event.offsetY > HEAD ? this.lanes[k]?.id : undefined;
    this.drag = { id, first: frame, marks: event.shiftKey && id !== undefined };
    if (event.offsetX >= GUTTER) this.app.go(frame);
    if (id !== undefined && event.pointerType === "mouse") this.app.pick(id);
  }

  move(event) {
    if (!this.drag) return;
    const frame = this.frame(event.offsetX);
    this.drag.moved ||= frame !== this.drag.first;
    if (this.drag.marks) this.app.mark(this.drag.id, Math.min(frame, this.drag.first), Math.max(frame, this.drag.first));
    else if (this.drag.moved) this.app.go(frame);
  }

  up(event) {
    const { drag } = this;
    this.drag = null;
    if (drag && !drag.moved && drag.id !== undefined && event.pointerType !== "mouse") this.app.pick(drag.id);
  }
}
