"use strict";
// Read numbers off a chart under the pointer.
for (const svg of document.querySelectorAll("svg.chart")) {
  const [left, right, top, bottom] = svg.dataset.box.split(",").map(Number);
  const [x0, x1, y0, y1] = svg.dataset.range.split(",").map(Number);
  const { width, height } = svg.viewBox.baseVal;
  const add = (name) => svg.appendChild(Object.assign(document.createElementNS(svg.namespaceURI, name)));
  const line = add("path"), text = add("text");
  line.setAttribute("class", "cursor"); text.setAttribute("class", "cursor"); text.setAttribute("y", top + 10);
  svg.addEventListener("pointermove", (event) => {
    const box = svg.getBoundingClientRect();
    const px = (event.clientX - box.left) / box.width * width, py = (event.clientY - box.top) / box.height * height;
    if (px < left || px > width - right || py < top || py > height - bottom) return clear();
    const x = x0 + (px - left) / (width - left - right) * (x1 - x0);
    const at = y0 + (height - bottom - py) / (height - top - bottom) * (y1 - y0);
    const y = svg.dataset.log ? 10 ** at : at;
    line.setAttribute("d", `M${px} ${top}V${height - bottom}M${left} ${py}H${width - right}`);
    text.textContent = `${x.toPrecision(4)}, ${y.toPrecision(4)}`;
    text.setAttribute("x", px > width / 2 ? px - 6 : px + 6);
    text.setAttribute("text-anchor", px > width / 2 ? "end" : "start");
  });
  const clear = () => { line.setAttribute("d", ""); text.textContent = ""; };
  svg.addEventListener("pointerleave", clear);
}
// Play a motion: bodies are outlines through their joints and markers.
for (const figure of document.querySelectorAll("figure.playback")) {
  const motion = JSON.parse(figure.querySelector("script").textContent);
  const canvas = figure.querySelector("canvas"), pen = canvas.getContext("2d");
  const slider = figure.querySelector("input"), button = figure.querySelector("button"), output = figure.querySelector("output");
  const all = [...motion.held, ...motion.after.flat(2), ...motion.before.flat(2), ...motion.seen.flat().filter(Boolean)];
  const xs = all.map((p) => p[0]), ys = all.map((p) => p[1]);
  const low = (a) => a.reduce((m, v) => Math.min(m, v), Infinity), high = (a) => a.reduce((m, v) => Math.max(m, v), -Infinity);
  const [x0, x1, y0, y1] = [low(xs), high(xs), low(ys), high(ys)];
  canvas.height = Math.min(640, Math.max(260, (y1 - y0) / Math.max(x1 - x0, 1) * (canvas.width - 120) + 130));
  const scale = Math.min((canvas.width - 120) / Math.max(x1 - x0, 1), (canvas.height - 90) / Math.max(y1 - y0, 1));
  const place = ([x, y]) => [canvas.width / 2 + (x - (x0 + x1) / 2) * scale, canvas.height / 2 - (y - (y0 + y1) / 2) * scale];
  const ink = (name) => getComputedStyle(figure).getPropertyValue("--" + name);
  function outline(points) {  // convex hull, so that a plate with three joints is drawn as a plate
    const sorted = points.map(place).sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const half = (list) => { const chain = []; for (const p of list) {
      while (chain.length > 1 && (chain.at(-1)[0] - chain.at(-2)[0]) * (p[1] - chain.at(-2)[1]) <= (chain.at(-1)[1] - chain.at(-2)[1]) * (p[0] - chain.at(-2)[0])) chain.pop();
      chain.push(p); } return chain.slice(0, -1); };
    return sorted.length < 3 ? sorted : [...half(sorted), ...half(sorted.reverse())];
  }
  function body(points, colour, width, alpha) {
    const hull = outline(points);
    pen.strokeStyle = pen.fillStyle = colour; pen.globalAlpha = alpha; pen.lineWidth = width; pen.lineJoin = pen.lineCap = "round";
    pen.beginPath(); hull.forEach((p, i) => i ? pen.lineTo(...p) : pen.moveTo(...p)); pen.closePath(); pen.stroke();
    if (hull.length > 2) { pen.globalAlpha = alpha * 0.25; pen.fill(); }
    pen.globalAlpha = 1;
  }
  function dot(p, radius, fill, edge) {
    pen.beginPath(); pen.arc(...place(p), radius, 0, 7); pen.fillStyle = fill; pen.fill();
    if (edge) { pen.lineWidth = 2; pen.strokeStyle = edge; pen.stroke(); }
  }
  function ground([x, y]) {
    const [a, b] = place([x, y]);
    pen.strokeStyle = ink("soft"); pen.lineWidth = 2; pen.beginPath();
    pen.moveTo(a, b); pen.lineTo(a - 14, b + 22); pen.lineTo(a + 14, b + 22); pen.closePath(); pen.stroke();
    for (let i = -14; i <= 14; i += 7) { pen.beginPath(); pen.moveTo(a + i, b + 22); pen.lineTo(a + i - 6, b + 30); pen.stroke(); }
  }
  function scaleBar() {
    const raw = (x1 - x0 || 100) / 4, power = 10 ** Math.floor(Math.log10(raw)), mm = [5, 2, 1].find((m) => m * power <= raw) * power;
    pen.strokeStyle = pen.fillStyle = ink("soft"); pen.lineWidth = 2; pen.font = "20px system-ui, sans-serif";
    pen.beginPath(); pen.moveTo(24, canvas.height - 20); pen.lineTo(24 + mm * scale, canvas.height - 20); pen.stroke();
    pen.fillText(`${mm >= 1 ? mm : mm.toPrecision(1)} mm`, 24, canvas.height - 30);
  }
  const few = motion.after.length <= 8, count = motion.time_s.length;
  function trace(frames) {  // where each point of a body goes: a coupler curve says more than a pose
    pen.strokeStyle = ink("after"); pen.lineWidth = 1.5; pen.globalAlpha = 0.35;
    frames[0].forEach((_, k) => {
      pen.beginPath(); frames.forEach((points, j) => j ? pen.lineTo(...place(points[k])) : pen.moveTo(...place(points[k]))); pen.stroke();
    });
    pen.globalAlpha = 1;
  }
  function draw() {
    const i = Number(slider.value);
    pen.clearRect(0, 0, canvas.width, canvas.height);
    if (few) motion.after.forEach(trace);
    const ghosts = few ? 5 : 0;  // a few poses of the whole motion, so that paper shows it too
    for (let g = 0; g < ghosts; g++) motion.after.forEach((frames) => body(frames[Math.round(g * (count - 1) / (ghosts - 1))], ink("soft"), 3, 0.16));
    motion.held.forEach(ground);
    motion.before.forEach((frames) => body(frames[i], ink("before"), 4, 0.65));
    motion.after.forEach((frames) => body(frames[i], ink("after"), few ? 8 : 4, 0.85));
    motion.after.forEach((frames) => frames[i].forEach((p) => dot(p, 4, ink("panel"), ink("after"))));
    motion.held.forEach((p) => dot(p, 6, ink("panel"), ink("soft")));
    motion.seen.forEach((frames) => frames[i] && dot(frames[i], 6, ink("measured"), ink("panel")));
    scaleBar();
    output.textContent = `${motion.time_s[i].toFixed(3)} s`;
  }
  let started = null;
  function frame(now) {
    if (started === null) return;
    slider.value = Math.floor((now - started) / 4000 * count) % count;
    draw(); requestAnimationFrame(frame);
  }
  button.addEventListener("click", () => {
    const playing = started === null;
    button.textContent = playing ? "Pause" : "Play";
    started = playing ? performance.now() - slider.value / count * 4000 : null;
    if (playing) requestAnimationFrame(frame);
  });
  slider.addEventListener("input", () => { started = null; button.textContent = "Play"; draw(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  slider.value = Math.round(count * 0.3); draw();
}
