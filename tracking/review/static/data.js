// What the server gives: the state of the review, boxes by chunks of frames, pictures.

const ROW = 7; // numbers of a row: frame, id, x1, y1, x2, y2, filled

/** Asks the server; tells `heard(alive)` when it goes or comes back. */
export class Link {
  constructor(heard) {
    this.heard = heard;
    this.alive = true;
  }

  async ask(path, options = {}) {
    let answer;
    try {
      answer = await fetch(path, { cache: "no-store", ...options });
    } catch (error) {
      if (error.name !== "AbortError") this.tell(false);
      throw error;
    }
    this.tell(true);
    if (!answer.ok) throw new Error(await answer.text());
    return answer;
  }

  async json(path, given) {
    const headers = { "Content-Type": "application/json" };
    const options = given === undefined ? {} : { method: "POST", headers, body: JSON.stringify(given) };
    return (await this.ask(path, options)).json();
  }

  tell(alive) {
    if (alive === this.alive) return;
    this.alive = alive;
    this.heard(alive);
  }
}

/** Rows of all frames, loaded by chunks; `loaded()` is called after each. */
export class Boxes {
  constructor(link, loaded) {
    Object.assign(this, { link, loaded, chunks: [], waiting: new Map(), size: 1, count: 0 });
  }

  /** Take a new state; only chunks in `changed` are asked for again, or all where that is not known. */
  renew(state, changed) {
    this.size = state.chunk;
    this.count = Math.ceil(state.frames / state.chunk);
    this.whole = state.rows <= 4e6;
    if (!changed) this.chunks = [];
    for (const number of changed ?? []) if (this.chunks[number]) this.chunks[number].old = true;
    this.waiting.clear();
  }

  /** The boxes of a frame, `{id, box, filled}`; null before they are here. */
  at(frame) {
    const number = Math.floor(frame / this.size);
    this.want(number);
    const chunk = this.chunks[number];
    if (!chunk) return null;
    const found = [];
    for (let k = chunk.starts[frame - number * this.size]; k < chunk.starts[frame - number * this.size + 1]; k++) {
      const at = k * ROW;
      found.push({
        id: chunk.whole[at + 1],
        box: Array.from(chunk.real.subarray(at + 2, at + 6)),
        filled: chunk.whole[at + 6] > 0,
      });
    }
    return found;
  }

  async want(number) {
    if (number < 0 || number >= this.count || this.waiting.has(number)) return;
    if (this.chunks[number] && !this.chunks[number].old) return;
    const mark = {};
    this.waiting.set(number, mark);
    try {
      const buffer = await (await this.link.ask(`boxes/${number}`)).arrayBuffer();
      if (this.waiting.get(number) !== mark) return;
      this.chunks[number] = this.parsed(number, buffer);
      this.forget(number);
      this.loaded();
    } catch {
      await new Promise((done) => setTimeout(done, 1000));
    } finally {
      if (this.waiting.get(number) === mark) this.waiting.delete(number);
    }
  }

  parsed(number, buffer) {
    const whole = new Int32Array(buffer), starts = new Int32Array(this.size + 1);
    for (let k = 0; k < whole.length; k += ROW) starts[whole[k] - number * this.size + 1]++;
    for (let k = 0; k < this.size; k++) starts[k + 1] += starts[k];
    return { whole, real: new Float32Array(buffer), starts };
  }

  /** Of a very long video only what is near is kept. */
  forget(near) {
    if (this.whole) return;
    this.chunks.forEach((_, number) => Math.abs(number - near) > 20 && delete this.chunks[number]);
  }

  /** Load everything that may stay, one chunk after the other, from `frame` on. */
  async loadAll(frame) {
    const begin = Math.floor(frame / this.size), count = this.whole ? this.count : 4;
    for (let k = 0; k < count; k++) await this.want((begin + k) % this.count);
  }
}

/** Pictures by frame. The newest wish comes first, so that scrubbing never waits for what it left behind. */
export class Pictures {
  constructor(link, loaded) {
    Object.assign(this, { link, loaded, kept: new Map(), wishes: [], under: new Set(), most: 48, there: false });
  }

  get(frame) {
    return this.kept.get(frame);
  }

  /** Wish for these frames, the first one most, and for no others. */
  want(frames) {
    if (!this.there) return;
    this.wishes = frames.filter((frame) => !this.kept.has(frame) && !this.under.has(frame));
    this.work();
  }

  async work() {
    while (this.wishes.length && this.under.size < 2) {
      const frame = this.wishes.shift();
      this.under.add(frame);
      this.fetched(frame)
        .then((picture) => {
          this.kept.set(frame, picture);
          for (const [old, one] of this.kept) {
            if (this.kept.size <= this.most) break;
            one.close();
            this.kept.delete(old);
          }
          this.loaded(frame);
        })
        .catch(() => {})
        .finally(() => {
          this.under.delete(frame);
          this.work();
        });
    }
  }

  async fetched(frame) {
    return createImageBitmap(await (await this.link.ask(`picture/${frame}`)).blob());
  }
}
