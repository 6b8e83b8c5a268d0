const byId = id => document.getElementById(id), frame = byId("frame"), image = document.querySelector("img");
const svg = document.querySelector("svg"), kind = byId("kind"), name = byId("name"), said = byId("said");
const scene = [];
let points = [], cursor = null;
const straight = one => one === "lines" || one === "length";
const make = (tag, given, text) => {
 const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
 Object.entries(given).forEach(([key, value]) => made.setAttribute(key, value));
 if (text) made.textContent = text;
 svg.append(made);
 return made;
};
const meet = (a, b) => a.x < b.x + b.width && b.x < a.x + a.width && a.y < b.y + b.height && b.y < a.y + a.height;
// The name at a point, within the picture and below the names that stand there.
function label([x, y], size, text, taken) {
 const made = make("text", {"font-size": size}, text), {naturalWidth: width} = image;
 const place = down => {
  made.setAttribute("y", Math.max(y, size) + down * size);
  made.setAttribute("x", Math.max(0, Math.min(x, width - made.getBBox().width)));
  return made.getBBox();
 };
 let box = place(0);
 for (let down = 1; down < 20 && taken.some(other => meet(other, box)); down++) box = place(down);
 taken.push(box);
}
function arrow([a, b], size) {
 const m = [0, 1].map(k => (a[k] + b[k]) / 2), l = Math.hypot(b[0] - a[0], b[1] - a[1]) || 1;
 const n = [-(b[1] - a[1]) / l, (b[0] - a[0]) / l], t = [0, 1].map(k => m[k] + n[k] * size);
 return `M${m}L${t}m${[-n[0] - n[1], -n[1] + n[0]].map(v => v * size / 3)}L${t}l` +
  `${[-n[0] + n[1], -n[1] - n[0]].map(v => v * size / 3)}`;
}
function show() {
 svg.setAttribute("viewBox", `0 0 ${image.naturalWidth} ${image.naturalHeight}`);
 svg.replaceChildren();
 frame.style.setProperty("--aspect", image.naturalWidth / image.naturalHeight);
 const taken = [], size = image.naturalWidth / 40, paint = {fill: "none", stroke: "#e8590c", "stroke-width": 3};
 const letters = Math.max(size * .7, 14 * image.naturalWidth / image.clientWidth);
 for (const one of [...scene, {kind: kind.value, name: "", points}]) {
  const filled = !straight(one.kind) && one.points !== points;
  const inner = filled ? {fill: "#e8590c33"} : {};
  make(filled ? "polygon" : "polyline", {...paint, points: one.points.join(" "), ...inner});
  if (one.kind === "lines" && one.points.length === 2) make("path", {...paint, d: arrow(one.points, size)});
  if (one.points.length && one.name) label(one.points[0], letters, one.name, taken);
  if (one.points === points) points.forEach(([x, y]) => make("circle", {cx: x, cy: y, r: size / 6, fill: "#e8590c"}));
 }
 if (cursor) make("path", {...paint, d: `M${cursor}m${-size},0h${2 * size}m${-size},${-size}v${2 * size}`});
 byId("list").replaceChildren(...scene.map((one, k) => {
  const row = document.createElement("li"), does = (text, action) => {
   const button = document.createElement("button");
   button.textContent = text;
   button.onclick = () => { action(); show(); };
   row.append(button, " ");
  };
  const what = kind.querySelector(`[value=${one.kind}]`).textContent;
  row.append(one.name.startsWith(what) ? `${one.name} ` : `${what} ${one.name} `);
  does("Remove", () => scene.splice(k, 1));
  if (one.kind === "lines") does("Turn", () => one.points.reverse());
  return row;
 }));
 byId("close").disabled = straight(kind.value) || points.length < 3;
 byId("save").disabled = points.length > 0 || !scene.some(one => one.kind === "lines" || one.kind === "zones");
}
function done() {
 scene.push({kind: kind.value, name: named() ? name.value : "", points});
 points = [];
 next();
}
const named = () => ["lines", "zones", "length"].includes(kind.value);
function next() {
 points = [];
 name.disabled = !named();
 byId("what").textContent = kind.value === "length" ? "metres" : "named";
 name.value = kind.value === "length" ? "1" : named() ?
  `${kind.value.slice(0, -1)} ${scene.filter(one => one.kind === kind.value).length + 1}` : "";
 show();
}
const within = (v, most) => Math.round(Math.min(Math.max(v, 0), most) * 10) / 10;
function add(point) {
 points.push(point);
 if (straight(kind.value) && points.length === 2) done(); else show();
}
frame.onpointerdown = event => {
 const r = image.getBoundingClientRect(), {naturalWidth: width, naturalHeight: height} = image;
 cursor = null;
 add([within((event.clientX - r.left) / r.width * width, width),
  within((event.clientY - r.top) / r.height * height, height)]);
};
document.onkeydown = event => {
 const way = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1]}[event.key];
 const {naturalWidth: width, naturalHeight: height} = image, here = document.activeElement === frame;
 if (event.key === "Escape") points.pop();
 else if (here && way) {
  cursor = (cursor ?? [width / 2, height / 2]).map((v, k) =>
   within(v + way[k] * (event.shiftKey ? width / 20 : 1), k ? height : width));
 } else if (here && cursor && event.key === "Enter") return add([...cursor]);
 else return;
 event.preventDefault();
 show();
};
kind.onchange = next;
byId("close").onclick = done;
image.onload = window.onresize = show;
byId("save").onclick = async () => {
 const of = what => scene.filter(one => one.kind === what), regions = of("region"), known = of("length").at(-1);
 const long = known && Math.hypot(known.points[1][0] - known.points[0][0], known.points[1][1] - known.points[0][1]);
 const scale = known && Number(known.name.replace(",", ".")) / long;
 const answer = await fetch("answer", {method: "POST", body: JSON.stringify({
  size: [image.naturalWidth, image.naturalHeight],
  lines: of("lines").map(one => ({name: one.name, from: one.points[0], to: one.points[1]})),
  zones: of("zones").map(one => ({name: one.name, corners: one.points})),
  ignored: of("ignored").map(one => one.points), ...(regions.length ? {region: regions.at(-1).points} : {}),
  ...(known ? {scale: Number.isFinite(scale) ? scale : 0} : {})})});
 said.textContent = answer.ok ? "The scene is saved. This page can be closed." : await answer.text();
 byId("save").disabled = answer.ok;
};
if (image.complete) show();
