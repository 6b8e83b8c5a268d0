// The page: what is shown, what is chosen, and what is said to the server.

import { Boxes, Link, Pictures } from "./data.js";
import { Loops } from "./loops.js";
import { sign } from "./paint.js";
import { Stage } from "./stage.js";
import { Timeline } from "./timeline.js";

const $ = (name) => document.getElementById(name);
const FLASH = 2500; // milliseconds

const app = {
  state: null,
  frame: 0,
  chosen: [], // up to two {id, frame}
  segment: null, // {id, first, last}
  flashes: new Map(), // first and last changed frame by id
  question: null,
  skipped: new Set(),
  playing: null,
  busy: false,

  nameOf(id) {
    const name = this.tracks?.get(id)?.name;
    return name ? `${id} ${name}` : String(id);
  },

  flashed(id, frame) {
    const found = this.flashes.get(id);
    return Boolean(found) && frame >= found[0] && frame <= found[1];
  },

  /** Draw once, at the next chance. */
  draw() {
    this.drawing ??= requestAnimationFrame(() => {
      this.drawing = null;
      this.stage.draw();
      this.timeline.draw();
    });
  },

  go(frame) {
    if (!this.state) return;
    this.frame = Math.min(Math.max(Math.round(frame), 0), this.state.frames - 1);
    const ahead = this.playing ? [1, 2, 3, 4, 5, 6] : [];
    this.pictures.want([this.frame, ...ahead.map((k) => this.frame + k)].filter((one) => one < this.state.frames));
    $("scrub").value = this.frame;
    const seconds = this.state.rate > 0 ? ` · ${(this.frame / this.state.rate).toFixed(2)} s` : "";
    $("clock").textContent = `${this.frame + 1} of ${this.state.frames}${seconds}`;
    this.draw();
    clearTimeout(this.settling);
    this.settling = setTimeout(() => this.settled(), 120);
  },

  /** What need not follow while scrubbing. */
  settled() {
    const found = this.boxes.at(this.frame);
    const made = (found ?? []).map(({ id }) => {
      const button = document.createElement("button");
      button.append(sign(id), this.nameOf(id));
      button.setAttribute("aria-pressed", this.chosen.some((one) => one.id === id));
      button.onclick = () => this.choose(id);
      return button;
    });
    const focused = [...$("here").children].indexOf(document.activeElement);
    $("here").replaceChildren(...made);
    if (focused >= 0) (made[focused] ?? $("boxes")).focus();
    this.enable();
  },

  /** Choose a person in this frame, or no longer. */
  choose(id) {
    const same = this.chosen.findIndex((one) => one.id === id && one.frame === this.frame);
    if (same >= 0) this.chosen.splice(same, 1);
    else this.chosen = [...this.chosen.slice(-1), { id, frame: this.frame }];
    this.picked();
  },

  /** Choose up to two, in this frame or the nearest in which each is. */
  pick(...ids) {
    const near = (span) => Math.min(Math.max(this.frame, span[0]), span[1]);
    this.chosen = ids.filter((id) => this.tracks.has(id)).slice(0, 2).map((id) => {
      const frames = this.tracks.get(id).spans.map(near);
      return { id, frame: frames.sort((a, b) => Math.abs(a - this.frame) - Math.abs(b - this.frame))[0] };
    });
    this.picked();
  },

  picked() {
    const said = this.chosen.map((one) => `${this.nameOf(one.id)} in frame ${one.frame + 1}`);
    $("chosen").textContent = said.join(" and ") || "Click a box. A second click, here or in another frame, chooses two.";
    $("called").value = this.tracks?.get(this.last()?.id)?.name ?? "";
    if (this.segment && this.segment.id !== this.last()?.id) this.segment = null;
    this.settled();
    this.draw();
  },

  last() {
    return this.chosen.at(-1);
  },

  here(id) {
    return Boolean((this.boxes.at(this.frame) ?? []).find((one) => one.id === id));
  },

  enable() {
    const [one, two] = this.chosen, last = this.last(), free = Boolean(this.state) && this.link.alive && !this.busy;
    const on = {
      same: two && one.frame !== two.frame && one.id !== two.id,
      part: two ? one.frame !== two.frame : last && this.tracks.get(last.id).spans[0][0] < this.frame,
      exchange: two && one.id !== two.id && this.here(one.id) && this.here(two.id),
      notPerson: last && this.here(last.id),
      isPerson: last && this.here(last.id),
      delete: last,
      called: last,
      from: last,
      to: last,
      right: this.segment,
      undo: this.state?.answered,
      redo: true,
      yes: this.question,
      no: this.question,
      skip: this.question,
      next: this.question,
      add: true,
    };
    for (const [name, value] of Object.entries(on)) $(name).disabled = !(free && value);
    $("naming").lastElementChild.disabled = $("called").disabled;
  },

  click(hit, point) {
    if (hit) this.choose(hit.id);
    else if (this.state.single) this.placeTarget(point);
    else if (this.chosen.length) {
      this.chosen = [];
      this.picked();
    }
  },

  mark(id, first, last) {
    this.segment = { id, first, last };
    this.enable();
    this.draw();
  },

  markEnd(which) {
    const { id } = this.last(), old = this.segment?.id === id ? this.segment : { first: this.frame, last: this.frame };
    const now = { ...old, [which]: this.frame };
    this.mark(id, which === "last" ? Math.min(now.first, now.last) : now.first, which === "first" ? Math.max(now.first, now.last) : now.last);
  },

  addMode(on) {
    this.stage.adding = on;
    $("add").setAttribute("aria-pressed", on);
    $("boxes").style.cursor = on ? "crosshair" : "";
    if (on) this.say(`Drag a box${this.last() ? ` of ${this.nameOf(this.last().id)}; Esc first for a new track` : " of a new track"}.`);
  },

  addBox(box) {
    this.addMode(false);
    this.correct({ kind: "box", frame: this.frame, box: sized(box), ...(this.last() ? { of: this.last().id } : {}) });
  },

  moveBox(id, box) {
    this.correct({ kind: "box", frame: this.frame, box: sized(box), ids: [id] });
  },

  /** The one target is here; as large as where it was last. */
  placeTarget([x, y]) {
    const { id } = this.state.tracks[0];
    this.correct({ kind: "target", frame: this.frame, point: [x, y], of: id });
  },

  say(text, wrong = false) {
    $("said").textContent = text;
    $("said").classList.toggle("wrong", wrong);
  },

  async change(what, given) {
    if (this.busy || !this.state) return;
    this.busy = true;
    this.enable();
    this.say("Solving …");
    const begin = performance.now();
    try {
      const state = await this.link.json(`change/${what}`, given);
      const seconds = ((performance.now() - begin) / 1000).toFixed(1);
      const count = new Set(state.changed.map(([id]) => id)).size;
      this.say(`${state.said} ${count} ${count === 1 ? "track" : "tracks"} changed, ${seconds} s.`);
      this.take(state, state.chunks);
      this.flash(state.changed);
      $("boxes").dataset.changes = Number($("boxes").dataset.changes ?? 0) + 1;
    } catch (error) {
      this.say(this.link.alive ? error.message : "Not taken: the server is gone.", true);
    } finally {
      this.busy = false;
      this.enable();
    }
  },

  correct(given) {
    return this.change("correct", given);
  },

  flash(changed) {
    this.flashes = new Map(changed.map(([id, first, last]) => [id, [first, last]]));
    clearTimeout(this.fading);
    this.fading = setTimeout(() => {
      this.flashes.clear();
      this.draw();
    }, FLASH);
    this.draw();
  },

  /** Show a state of the review; `chunks` are those of the boxes that changed, by default all. */
  take(state, chunks) {
    const first = !this.state;
    this.state = state;
    this.tracks = new Map(state.tracks.map((track) => [track.id, track]));
    this.boxes.renew(state, chunks);
    this.pictures.there = state.pictures;
    document.title = `Review ${state.name}`;
    $("name").textContent = state.name;
    for (const word of document.querySelectorAll(".noun")) word.textContent = state.noun;
    $("note").textContent = state.note;
    $("note").hidden = !state.note;
    const left = state.ranking ? "looking for what is in doubt …" : `${state.left} likely ${state.left === 1 ? "error" : "errors"} left`;
    $("progress").textContent = `${state.answered} answered, ${left}`;
    $("scrub").max = state.frames - 1;
    this.chosen = this.chosen.filter((one) => this.tracks.has(one.id));
    this.segment = null;
    this.timeline.renew();
    this.ask();
    if (first && this.goToPlace()) this.picked();
    else if (first && !this.question) this.go(0);
    else if (first) this.goToQuestion();
    else this.go(this.frame);
    this.picked();
    this.boxes.loadAll(this.frame);
  },

  /** Ask the least certain question that was not skipped. */
  ask() {
    const { questions } = this.state, before = this.question?.key;
    this.question = questions.find((one) => !this.skipped.has(one.key)) ?? null;
    $("question").classList.toggle("none", !this.question);
    $("asked").textContent = this.question?.sentence ?? this.silent();
    if (this.question?.key !== before || !this.question) this.loops.show(this.question, this.state);
    $("question").dataset.key = this.question?.key ?? "";
    $("where").hidden = !this.question?.key.startsWith("link");
    this.enable();
  },

  /** Why there is no question. */
  silent() {
    if (this.state.questions.length) return "All questions are skipped.";
    if (this.state.ranking) return "Questions are being looked for; you can correct by hand meanwhile.";
    return "Nothing is in doubt; you can still correct by hand.";
  },

  /** Go to the frame that the address names, counted from 1, and choose the tracks; false where it names none. */
  goToPlace() {
    const place = new URLSearchParams(location.hash.slice(1)), frame = Number(place.get("frame"));
    if (!(frame >= 1 && frame <= this.state.frames)) return false;
    this.go(frame - 1);
    this.pick(...(place.get("ids") ?? "").split(",").map(Number).filter((id) => this.tracks.has(id)));
    return true;
  },

  goToQuestion() {
    if (!this.question) return;
    this.go(this.question.frame);
    this.pick(...this.question.ids);
    this.timeline.reveal(this.question.ids[0]);
    this.stage.reveal(this.question.about[0].slice(2));
  },

  async answer(yes) {
    if (!this.question) return;
    const { key } = this.question;
    await this.change("answer", { key, yes });
    if (this.question && this.question.key !== key) this.goToQuestion();
  },

  skip() {
    if (!this.question) return;
    this.skipped.add(this.question.key);
    this.say("Skipped.");
    this.ask();
    this.goToQuestion();
  },

  play(on = !this.playing) {
    clearInterval(this.playing?.timer);
    this.playing = null;
    $("play").textContent = on ? "Stop" : "Play";
    $("play").setAttribute("aria-pressed", on);
    if (!on) return;
    const step = 1000 / (this.state.rate || 25);
    this.playing = { due: performance.now() };
    // A picture that is late is waited for, but not long.
    this.playing.timer = setInterval(() => {
      const now = performance.now(), next = this.frame + 1, late = now - this.playing.due;
      if (next >= this.state.frames) return this.play(false);
      if (late < step || (this.state.pictures && !this.pictures.get(next) && late < step + 300)) return undefined;
      this.playing.due = late > 3 * step ? now : this.playing.due + step;
      return this.go(next);
    }, Math.min(step, 10));
  },

  /** Choose the next box of this frame, or the one before. */
  cycle(by) {
    const ids = (this.boxes.at(this.frame) ?? []).map((one) => one.id);
    if (!ids.length) return;
    const at = ids.indexOf(this.last()?.id);
    this.pick(ids[(at + by + ids.length + (at < 0 && by < 0 ? 1 : 0)) % ids.length]);
  },

  pair(kind) {
    const [one, two] = this.chosen;
    return this.correct({ kind, ids: [one.id, two.id], frame: one.frame, last: two.frame });
  },

  /** Of the track that was chosen last; in this frame, where the correction is about one box. */
  one(kind, more = {}) {
    return this.correct({ kind, ids: [this.last().id], frame: this.frame, ...more });
  },
};

const sized = ([left, top, right, bottom]) => [left, top, right - left, bottom - top];

const ACTIONS = {
  yes: () => app.answer(true),
  no: () => app.answer(false),
  skip: () => app.skip(),
  next: () => app.goToQuestion(),
  undo: () => app.change("undo", {}),
  redo: () => app.change("redo", {}),
  same: () => app.pair("same"),
  part: () => (app.chosen.length > 1 ? app.pair("not_same") : app.one("not_same")),
  exchange: () => app.correct({ kind: "switch", ids: app.chosen.map((one) => one.id), frame: app.frame }),
  notPerson: () => app.one("not_person"),
  isPerson: () => app.one("real"),
  delete: () => app.one("delete"),
  add: () => app.addMode(!app.stage.adding),
  from: () => app.markEnd("first"),
  to: () => app.markEnd("last"),
  right: () => app.one("right", { frame: app.segment.first, last: app.segment.last }),
  play: () => app.play(),
  back: () => app.go(app.frame - 1),
  forth: () => app.go(app.frame + 1),
  help: () => $("keys").showModal(),
  closer: () => app.stage.zoom(1.5),
  wider: () => app.stage.zoom(1 / 1.5),
};
const KEYS = {
  y: "yes", n: "no", s: "skip", q: "next", j: "same", p: "part", x: "exchange", m: "notPerson", h: "isPerson",
  delete: "delete", backspace: "delete", a: "add", "[": "from", "]": "to", r: "right", " ": "play", "?": "help",
  "+": "closer", "=": "closer", "-": "wider",
};

for (const [name, action] of Object.entries(ACTIONS)) $(name).addEventListener("click", action);
window.addEventListener("hashchange", () => app.goToPlace());
$("scrub").addEventListener("input", () => app.go(Number($("scrub").value)));
$("naming").addEventListener("submit", (event) => {
  event.preventDefault();
  app.one("name", { name: $("called").value.trim() });
});

document.addEventListener("keydown", (event) => {
  const key = event.key.toLowerCase(), { target } = event;
  const types = target === $("called"), slides = target === $("scrub");
  if ($("keys").open || event.altKey) return;
  if ((event.ctrlKey || event.metaKey) && key === "z" && !types) {
    event.preventDefault();
    ACTIONS[event.shiftKey ? "redo" : "undo"]();
    return;
  }
  if (event.ctrlKey || event.metaKey) return;
  if (key === "escape") {
    if (app.stage.adding) app.addMode(false);
    else app.chosen = [];
    app.picked();
    $("boxes").focus();
  }
  if (types || ([" ", "enter"].includes(key) && target.tagName === "BUTTON")) return;
  const steps = { arrowleft: -1, arrowright: 1 };
  if (key in steps && !slides) app.go(app.frame + steps[key] * (event.shiftKey ? 10 : 1));
  else if (key === "home") app.go(0);
  else if (key === "end") app.go(app.state.frames - 1);
  else if (key === "," || key === ".") app.cycle(key === "." ? 1 : -1);
  else if (key === "0") app.stage.zoom(0.01);
  else if (key === "e" && !$("called").disabled) $("called").focus();
  else if (KEYS[key] && !$(KEYS[key]).disabled) ACTIONS[KEYS[key]]();
  else return;
  if (!slides || !key.startsWith("arrow")) event.preventDefault();
});

app.link = new Link((alive) => {
  $("gone").hidden = alive;
  if (alive) renew();
  app.enable();
});
app.boxes = new Boxes(app.link, () => {
  app.draw();
  clearTimeout(app.settling);
  app.settling = setTimeout(() => app.settled(), 120);
});
app.pictures = new Pictures(app.link, (frame) => frame === app.frame && app.draw());
app.loops = new Loops(app.link, (frame) => app.go(frame));
app.stage = new Stage(app);
app.timeline = new Timeline(app);

/** Take the state where it is another than the page has. */
async function renew() {
  try {
    const version = await app.link.json("version");
    if (version === app.state?.version || app.busy) return;
    const state = await app.link.json("data");
    // Questions may be other ones while the boxes are the same.
    app.take(state, state.boxes === app.state?.boxes ? [] : undefined);
  } catch (error) {
    if (app.link.alive) app.say(error.message, true);
  }
}

await renew();
setInterval(renew, 1500);
