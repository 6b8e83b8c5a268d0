// The live page: asks for the state a few times a second, and for a picture whenever there is a new one.

const EVERY = 250; // milliseconds between two questions
const byId = (id) => document.getElementById(id);
const views = [];

function view(number) {
  while (views.length <= number) {
    const section = byId("camera").content.firstElementChild.cloneNode(true);
    byId("cameras").append(section);
    views.push({ section, part: (name) => section.querySelector(name), loading: false, frame: 0 });
  }
  return views[number];
}

function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function setRows(table, rows) {
  const body = table.tBodies[0];
  while (body.rows.length > rows.length) body.deleteRow(-1);
  rows.forEach((cells, n) => {
    const row = body.rows[n] ?? body.insertRow();
    while (row.cells.length < cells.length) row.insertCell();
    cells.forEach((cell, k) => setText(row.cells[k], String(cell)));
  });
  table.hidden = rows.length === 0;
}

function setNumbers(list, numbers) {
  const rows = numbers.filter(([, value]) => value !== null);
  while (list.children.length > rows.length) list.lastElementChild.remove();
  rows.forEach(([name, value], n) => {
    if (!list.children[n]) {
      const row = document.createElement("div");
      row.append(document.createElement("dt"), document.createElement("dd"));
      list.append(row);
    }
    setText(list.children[n].children[0], name);
    setText(list.children[n].children[1], String(value));
  });
}

async function showPicture(number, camera) {
  const shown = view(number);
  if (shown.loading || camera.frame === 0 || shown.frame === camera.frame) return;
  shown.loading = true;
  const next = new Image();
  next.src = `picture/${number}?${camera.frame}`;
  try {
    await next.decode();
    const image = shown.part("img");
    image.src = next.src;
    image.alt = `${camera.name}: ${camera.people} people in frame ${camera.frame}`;
    image.hidden = false;
    shown.part(".none").hidden = true;
    shown.frame = camera.frame;
    shown.section.dataset.frame = camera.frame;
  } catch {
    // A newer one is asked for next time.
  }
  shown.loading = false;
}

function showCamera(camera, number) {
  const shown = view(number);
  setText(shown.part("h2"), camera.name);
  shown.section.classList.toggle("away", camera.away);
  setText(shown.part(".state"), camera.away ? "away" : camera.frame ? "live" : "waiting");
  setNumbers(shown.part(".numbers"), [
    ["People", camera.people],
    ["Frame", camera.frame],
    ["Frames/s", camera.rate.toFixed(1)],
    ["Delay", camera.delay === null ? null : `${camera.delay.toFixed(1)} s`],
    ["Dropped", camera.dropped],
    ["Outages", camera.outages],
  ]);
  const ways = Object.entries(camera.lines ?? {});
  setRows(shown.part(".lines"), ways.flatMap(([line, counts]) => Object.entries(counts).map(([way, n]) => [line, way, n])));
  const zones = Object.entries(camera.zones ?? {});
  setRows(shown.part(".zones"), zones.map(([zone, counts]) => [zone, counts.people, counts.entered, counts.left]));
  showPicture(number, camera);
}

async function step() {
  try {
    const answer = await fetch("state");
    if (!answer.ok) throw new Error(answer.statusText);
    const state = await answer.json();
    setText(byId("name"), state.name);
    document.title = `${state.name} live`;
    const people = state.cameras.reduce((sum, camera) => sum + camera.people, 0);
    setText(byId("summary"), `${people} ${people === 1 ? "person" : "people"} in view`);
    state.cameras.forEach(showCamera);
    byId("gone").hidden = true;
  } catch {
    byId("gone").hidden = false;
  }
  setTimeout(step, document.hidden ? 4 * EVERY : EVERY);
}

step();
