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
