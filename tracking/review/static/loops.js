// The two answers to a question, as short loops side by side.

import { colourOf, drawAsked, drawBox } from "./paint.js";

const MOST = 40; // frames of a loop
const SIDE = 320; // pixels
const STEP = 110; // milliseconds a frame

export class Loops {
  /** `go(frame)` is called with the frame that is clicked. */
  constructor(link, go) {
    this.link = link;
    this.canvases = [document.getElementById("loop-yes"), document.getElementById("loop-no")];
    for (const canvas of this.canvases) canvas.onclick = () => this.shown !== undefined && go(this.shown);
    this.question = null;
    this.still = matchMedia("(prefers-reduced-motion: reduce)");
  }

  /** Play a question `{yes, no}`, each rows of frame, id, x1, y1, x2, y2; or nothing. */
  show(question, state) {
    this.question = question;
    clearInterval(this.timer);
    if (!question) return;
    const rows = [...question.yes, ...question.no, ...question.about];
    const frames = [...new Set(rows.map((row) => row[0]))].sort((a, b) => a - b);
    this.frames = this.between(frames, state.frames);
    this.crop = this.around(question.about, state.size);
    this.held = 0;
    this.images = new Map();
    this.at = 0;
    this.fetchAll(question, state);
    this.timer = setInterval(() => this.step(), STEP);
    this.step();
  }

  /** Frames to play: every one, or of many evenly spaced ones. */
  between(frames, count) {
    const first = Math.max(0, frames[0] - 2), last = Math.min(count - 1, frames[frames.length - 1] + 2);
    const number = Math.min(MOST, last - first + 1);
    return Array.from({ length: number }, (_, k) => Math.round(first + (k * (last - first)) / Math.max(number - 1, 1)));
  }

  /** A square around boxes with some room, `[x, y, side]`. */
  around(rows, [width, height]) {
    const low = [2, 3].map((k) => Math.min(...rows.map((row) => row[k])));
    const high = [4, 5].map((k) => Math.max(...rows.map((row) => row[k])));
    const wide = Math.max(high[0] - low[0], high[1] - low[1]), tall = Math.max(...rows.map((row) => row[5] - row[3]));
    const side = Math.min(Math.max(1.4 * wide, 2.5 * tall), 1.2 * Math.max(width, height));
    return [(low[0] + high[0] - side) / 2, (low[1] + high[1] - side) / 2, side];
  }

  async fetchAll(question, state) {
    if (!state.pictures) return;
    for (const frame of this.frames) {
      try {
        const whole = await createImageBitmap(await (await this.link.ask(`picture/${frame}`)).blob());
        if (this.question !== question) return;
        const scale = whole.width / state.size[0], [x, y, side] = this.crop.map((value) => value * scale);
        this.images.set(frame, await createImageBitmap(whole, x, y, side, side, { resizeWidth: SIDE, resizeHeight: SIDE }));
        whole.close();
      } catch {
        return;
      }
    }
  }

  step() {
    const frame = (this.shown = this.frames[this.at]);
    this.draw(this.canvases[0], this.question.yes, frame);
    this.draw(this.canvases[1], this.question.no, frame);
    // What the question is about stays longer.
    const asked = this.question.about.some((row) => row[0] === frame);
    if (asked && this.held < 5) this.held++;
    else {
      this.held = 0;
      this.at = (this.at + (this.still.matches && !asked ? 4 : 1)) % this.frames.length;
    }
  }

  draw(canvas, rows, frame) {
    const context = canvas.getContext("2d"), [left, top, side] = this.crop, scale = SIDE / side;
    context.fillStyle = "#777";
    context.fillRect(0, 0, SIDE, SIDE);
    if (this.images.has(frame)) context.drawImage(this.images.get(frame), 0, 0);
    const place = (row) => [0, 1, 2, 3].map((k) => (row[2 + k] - (k % 2 ? top : left)) * scale);
    for (const id of new Set(rows.map((row) => row[1]))) {
      const own = rows.filter((row) => row[1] === id).sort((a, b) => a[0] - b[0]);
      context.strokeStyle = colourOf(id);
      context.lineWidth = 3;
      context.beginPath();
      for (const row of own) {
        const [x1, , x2, y2] = place(row);
        context.lineTo((x1 + x2) / 2, y2);
      }
      context.stroke();
      context.font = "bold 14px system-ui, sans-serif";
      const near = this.nearest(own, frame);
      if (near) drawBox(context, place(near), id, String(id), { strong: near[0] === frame, thin: near[0] !== frame });
    }
    for (const row of this.question.about.filter((one) => one[0] === frame)) drawAsked(context, place(row));
    context.fillStyle = "#fff";
    context.fillRect(0, SIDE - 4, (SIDE * (this.at + 1)) / this.frames.length, 4);
  }

  /** The row of a frame; of frames that were left out between two rows, the last one. */
  nearest(rows, frame) {
    if (!rows.length || frame < rows[0][0] || frame > rows[rows.length - 1][0]) return null;
    return rows.findLast((row) => row[0] <= frame);
  }
}
