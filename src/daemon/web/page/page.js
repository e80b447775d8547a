"use strict";
// Reads the daemon's lines and shows them; connects again by itself.
const SILENT_MS = 4000;
const EVENTS_SHOWN = 50;

const parent = document.getElementById("plots");
const plots = {
  rate: new Plot(parent, "Spin rate", "°/s", 3),
  axis: new Plot(parent, "σ of the axis", "°", 3),
  nis: new Plot(parent, "NIS", "6 on the average", 1),
  latency: new Plot(parent, "Latency", "ms", 0),
  attitude: new Plot(parent, "σ of the attitude", "°", 2),
};
const view = new View(document.getElementById("view"));
let socket = null, state = null, health = null, session = null;
// Without a link by the page's clock; else by the session's, s.
let isConnected = false, heard = 0, lostAt = Date.now(), mode = null, since = null, now = 0, wait = 500;

// Another session, or a replay from its start: times begin anew.
function clear() {
  Object.values(plots).forEach((plot) => plot.clear());
  view.clear(); state = null; health = null; mode = null; since = null; now = 0;
  document.getElementById("events").replaceChildren();
}

function begin(hello) {
  if (session !== null && session !== hello.session) clear();
  session = hello.session;
  const [text, name] = ORIGINS[hello.origin] || ["UNKNOWN", "waiting"];
  setText("origin", text, name);
  document.title = `${text} – tumbled`;
  view.sensors = hello.sensors || [];
  setText("rig", hello.rig);
  setText("session", `session ${hello.session.slice(0, 8)}, version ${hello.version}`);
  wait = 500;
}

function onState(line) {
  const t = line.t_ns * 1e-9;
  now = Math.max(now, t);
  if (line.kind === "epoch") {
    plots.nis.add(t, line.nis ?? NaN);
    if (line.spin) { plots.rate.add(t, line.spin.rate_dps); plots.axis.add(t, line.spin.axis_sigma_deg); }
    if (line.delivery) plots.latency.add(t, line.delivery.latency_ms.total);
  }
  // Epochs come after the predictions that went before them.
  if (!state || line.t_ns >= state.t_ns) { state = line; view.state = line; }
  stand();
}

// How it stands now, and since when.
function stand() {
  if (!state) return;
  const before = mode;
  mode = standing(asOf(state, now));
  if (mode !== before) since = state.t_ns * 1e-9 - (state.measured_ms_ago ?? 0) * 1e-3;
}

function onHealth(line) {
  health = line;
  const sigma = line.estimate && line.estimate.sigma_by_source;
  if (sigma) plots.attitude.add(line.estimate.t_ns * 1e-9, sigma.attitude_deg.total);
  now = Math.max(now, line.t_ns * 1e-9);
  // The daemon knows what was before this page.
  stand();
  if (line.estimate && isSo(line.estimate.mode, mode)) since = line.estimate.since_ns * 1e-9;
  showHealth(line);
}

function onEvent(line) {
  if (line.kind === "restarted") clear();
  const item = document.createElement("li");
  item.className = line.level;
  item.textContent = `${digits(line.t_ns * 1e-9, 1)} s ${line.message}`;
  const list = document.getElementById("events");
  list.prepend(item);
  while (list.children.length > EVENTS_SHOWN) list.lastChild.remove();
}

function onLine(line) {
  const handlers = {
    HELLO: begin, STATE: onState, HEALTH: onHealth, EVENT: onEvent,
    CLOUD: (cloud) => view.clouds.set(cloud.sensor, { at: cloud.t_ns * 1e-9, xyz: cloud.xyz_m }),
    MODEL: (model) => { view.model = model; },
    CONTOUR: (contour) => { view.contour = contour; },
    TRUTH: (truth) => { view.truth = truth; },
    POINT: (point) => (point.position_m ? view.points.set(point.name, point.position_m) : view.points.delete(point.name)),
    ERROR: (error) => setText("link", error.message, "off"),
  };
  if (handlers[line.class]) handlers[line.class](line);
}

function connect() {
  socket = new WebSocket(`ws://${location.host}/ws`);
  socket.onmessage = (message) => { heard = Date.now(); linked(true); onLine(JSON.parse(message.data)); };
  socket.onclose = () => { linked(false); setTimeout(connect, wait); wait = Math.min(wait * 1.5, 3000); };
}

function linked(is) {
  if (is === isConnected) return;
  isConnected = is; lostAt = Date.now();
  document.body.classList.toggle("off", !is);
  setText("link", is ? "connected" : "not connected: what is shown is old", is ? "" : "off");
  if (!is) setText("origin", "NOT CONNECTED", "waiting");
}

function cell(row, text, kind = "") {
  const data = row.insertCell();
  data.textContent = text; data.className = kind;
}

function showHealth(line) {
  const sensors = document.getElementById("sensors");
  sensors.replaceChildren();
  for (const sensor of line.core.sensors) {
    const row = sensors.insertRow();
    cell(row, sensor.id);
    cell(row, sensor.state, { live: "good", opening: "warn" }[sensor.state] || "bad");
    cell(row, digits(sensor.rate_hz, 1));
    cell(row, sensor.age_ns === null ? "–" : `${digits(sensor.age_ns * 1e-9, 2)} s`);
    cell(row, String(sensor.lost.total), sensor.lost.total ? "warn" : "");
    const unreadable = Object.values(sensor.malformed).reduce((sum, count) => sum + count, 0);
    cell(row, String(unreadable), unreadable ? "warn" : "");
    const clock = sensor.clock;
    cell(row, clock ? `${clock.state}, ${digits(clock.skew_ppm, 1)} ppm` : "none", !clock || clock.state === "locked" ? "" : "warn");
  }
  const machine = document.getElementById("machine");
  machine.replaceChildren();
  const fact = (name, text, kind) => { const row = machine.insertRow(); cell(row, name); cell(row, text, kind); };
  const { recorder, queues, stream, uptime_s: uptime, memory_bytes: memory } = line.shell;
  fact("health", line.level, { ok: "good", degraded: "warn", failed: "bad" }[line.level]);
  fact("running for", duration(uptime));
  if (memory) fact("memory", bytes(memory));
  fact("recorder", recorder ? `${recorder.state}, ${bytes(recorder.bytes)}` : "not recording", recorder && recorder.state !== "recording" ? "bad" : "");
  if (recorder && recorder.disk_free_bytes !== null) fact("disk free", bytes(recorder.disk_free_bytes));
  const lost = queues.reduce((sum, queue) => sum + queue.lost, 0);
  const fullest = queues.reduce((most, queue) => Math.max(most, queue.bound ? queue.waiting / queue.bound : 0), 0);
  fact("queues", `${Math.round(100 * fullest)} % of the fullest; ${lost} lost`, lost ? "warn" : "");
  fact("scans shed", String(line.shell.shed_scans), line.shell.shed_scans ? "warn" : "");
  fact("clients", String(stream.clients));
}

function showState() {
  const shows = state && asOf(state, now);
  const shown = document.getElementById("mode");
  shown.dataset.mode = shows ? standing(shows) : "";
  setText("mode", shows ? MODES[standing(shows)] || standing(shows) : "no state yet");
  const spin = shows && shows.spin;
  setText("rate", spin ? `${digits(spin.rate_dps, 3)} ±${digits(spin.rate_sigma_dps, 3)}` : "–");
  setText("axis", spin ? spin.axis.map((part) => digits(part, 3)).join("  ") : "–");
  setText("axis-sigma", spin ? `${digits(spin.axis_sigma_deg, 3)}°` : "–");
  setText("place", shows && shows.position_m ? shows.position_m.map((part) => digits(part, 3)).join("  ") : "–");
  const cone = spin ? View.cone(spin) : null;
  const widened = cone && cone.factor > 1 ? `, drawn ${cone.factor} times wider` : "";
  setText("cone", cone ? `Spin axis with its cone of uncertainty: 3σ = ${digits(cone.half, 2)}°${widened}. Body axes: x red, y green, z blue.` : "No spin axis yet.");
  setText("surface", surfaceWords(view.model, view.contour));
  const truth = document.getElementById("truth");
  truth.hidden = !view.truth; document.querySelector("[data-shows=truth]").hidden = !view.truth;
  if (view.truth) setText("truth", truthWords(view.truth, spin));
  const names = [...view.clouds.keys()].sort();
  const legend = document.getElementById("legend");
  const words = `${names.join()}|${[...view.points.keys()].join()}`;
  if (legend.dataset.words !== words) {
    legend.dataset.words = words;
    legend.replaceChildren(...names.flatMap((name, index) => {
      const dot = document.createElement("i");
      dot.style.setProperty("background", `var(--c${index % 3})`);
      return [dot, name];
    }));
    const dot = document.createElement("i");
    dot.style.setProperty("background", "var(--model)");
    legend.append(dot, "model");
    if (view.points.size) legend.append(` · points: ${[...view.points.keys()].join(", ")}`);
  }
}

document.getElementById("reset").onclick = () => view.reset();
for (const button of document.querySelectorAll("[data-shows]")) {
  button.onclick = () => {
    const name = button.dataset.shows;
    view.shows[name] = !view.shows[name];
    button.setAttribute("aria-pressed", String(view.shows[name]));
  };
}
const fit = document.getElementById("fit");
fit.onclick = () => { view.follows = !view.follows; };

setInterval(() => {
  // A link that is dead without a word is closed, and made anew.
  if (isConnected && Date.now() - heard > SILENT_MS) socket.close();
  fit.setAttribute("aria-pressed", String(view.follows));
  view.now = now;
  showState();
  answer(state && asOf(state, now), health, isConnected ? now - (since ?? 0) : (Date.now() - lostAt) / 1000, isConnected);
  Object.values(plots).forEach((plot) => plot.draw(now));
}, 250);
function frame() {
  if (!document.hidden) view.draw();
  setTimeout(() => requestAnimationFrame(frame), 60);
}
frame();
connect();
