// How a person is drawn everywhere: a colour that the colour-blind tell apart, a dash, and a name.

const COLOURS = ["#E69F00", "#56B4E9", "#009E73", "#F0E442", "#0072B2", "#D55E00", "#CC79A7"]; // Okabe and Ito
const DASHES = [[], [9, 4], [2, 3], [10, 3, 2, 3]];

export const colourOf = (id) => COLOURS[id % COLOURS.length];
const lightOf = (id) => ![4, 5, 2].includes(id % COLOURS.length);
export const dashOf = (id) => DASHES[Math.floor(id / COLOURS.length) % DASHES.length];

const known = new Map(), probe = document.createElement("i");
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => known.clear());

/** The colour that a variable of the style sheet has on this screen. */
export function css(name) {
  if (!known.has(name)) {
    probe.style.color = `var(${name})`;
    document.body.append(probe);
    known.set(name, getComputedStyle(probe).color);
    probe.remove();
  }
  return known.get(name);
}

/** Make the pixels of a canvas those of the screen; returns its context, in CSS pixels, and its size. */
export function fitted(canvas, width = canvas.clientWidth, height = canvas.clientHeight) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const size = [Math.max(1, Math.round(width * ratio)), Math.max(1, Math.round(height * ratio))];
  if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return [context, width, height];
}

/** Draw a box `[x1, y1, x2, y2]` in pixels of the canvas with the label of its person. */
export function drawBox(context, box, id, label, { strong = false, thin = false, flash = false } = {}) {
  const [x, y] = box, width = box[2] - x, height = box[3] - y;
  context.setLineDash(flash ? [] : dashOf(id));
  context.strokeStyle = flash ? "#fff" : "#000a";
  context.lineWidth = (strong ? 5 : 3.5) + (flash ? 4 : 0);
  context.strokeRect(x, y, width, height);
  context.strokeStyle = colourOf(id);
  context.lineWidth = strong ? 4 : thin ? 1.2 : 2.2;
  context.strokeRect(x, y, width, height);
  context.setLineDash([]);
  if (!label) return;
  const wide = context.measureText(label).width + 6, top = y > 16 ? y - 16 : y;
  context.fillStyle = colourOf(id);
  context.fillRect(x - 1, top, wide, 16);
  context.fillStyle = lightOf(id) ? "#000" : "#fff";
  context.fillText(label, x + 2, top + 12);
}

/** Corners around a box that a question is about. */
export function drawAsked(context, [left, top, right, bottom]) {
  const room = 5, long = Math.min(right - left, bottom - top) / 3 + room;
  for (const [colour, width] of [["#000", 5], ["#fff", 2.5]]) {
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.beginPath();
    for (const [x, dx] of [[left - room, long], [right + room, -long]]) {
      for (const [y, dy] of [[top - room, long], [bottom + room, -long]]) {
        context.moveTo(x + dx, y);
        context.lineTo(x, y);
        context.lineTo(x, y + dy);
      }
    }
    context.stroke();
  }
}

/** A small sign of a person for lists. */
export function sign(id) {
  const make = (tag, given) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(given)) made.setAttribute(name, value);
    return made;
  };
  const made = make("svg", { width: 22, height: 6, "aria-hidden": "true" });
  const dash = dashOf(id).join(" ") || "none";
  made.append(make("path", { d: "M0 3H22", stroke: colourOf(id), "stroke-width": 5, "stroke-dasharray": dash }));
  return made;
}
