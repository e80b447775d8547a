"use strict";
// Orders: to the session where it takes them, to a replay's transport where there is one. What came of the last stands beside.
const ASK_MS = 1000;
const orders = { control: null, transport: null };

const element = (id) => document.getElementById(id);

async function asked(path, order) {
  const request = order && { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(order) };
  const answer = await fetch(path, request);
  const text = await answer.text();
  try { return [answer.ok, JSON.parse(text)]; } catch { return [answer.ok, { message: text.trim() }]; }
}

function tell(text, isGood) {
  setText("told", text, isGood ? "good" : "bad");
}

async function order(line) {
  try {
    const [isDone, reply] = await asked("/api/control", line);
    tell(isDone ? doneWords(reply) : reply.message, isDone);
  } catch (error) { tell(`not ordered: ${error.message}`, false); }
  await look();
}

async function steer(line) {
  try {
    const [isDone, reply] = await asked("/api/transport", line);
    tell(isDone ? transportWords(reply) : reply.message, isDone);
  } catch (error) { tell(`not ordered: ${error.message}`, false); }
  await look();
}

// What is allowed, and how it stands; where it is not told, nothing is offered. Silence is the link's business, which tells it.
async function look() {
  if (!isConnected) return;
  const told = await Promise.all(["/api/control", "/api/transport"].map((path) => asked(path).catch(() => [false])));
  [orders.control, orders.transport] = told.map(([isTold, reply]) => (isTold ? reply : null));
  showOrders();
  // While a replay is held no line comes: neither the last, which may have been left out, nor, to a page just opened, any.
  if (orders.transport && orders.transport.paused) {
    const [isTold, line] = await asked("/api/state").catch(() => [false]);
    if (isTold && line && (!state || line.t_ns > state.t_ns)) onState(line);
  }
}

function able(group, allowed, why) {
  for (const one of element(group).querySelectorAll("button, input, select")) {
    one.disabled = !allowed;
    one.title = allowed ? one.dataset.title : why;
  }
}

function showOrders() {
  const { control, transport } = orders;
  element("orders").hidden = !(control || transport);
  element("transport").hidden = !transport;
  element("control").hidden = Boolean(transport);
  if (transport) {
    able("transport", transport.allowed, "orders are taken from the daemon's machine alone");
    const rests = transport.paused || transport.ended;
    element("play").textContent = rests ? "Play" : "Pause";
    element("play").disabled = !transport.allowed || transport.ended;
    element("restart").disabled = !transport.allowed || transport.no_restart !== null;
    if (transport.no_restart) element("restart").title = transport.no_restart;
    if (document.activeElement !== element("speed")) element("speed").value = transport.speed === null ? "max" : String(transport.speed);
    setText("position", transportWords(transport));
  } else if (control) {
    able("control", control.allowed, control.why || "");
    element("record").textContent = control.recording ? "Stop recording" : "Record";
    element("record").setAttribute("aria-pressed", String(Boolean(control.recording)));
    setText("recording", control.allowed ? recordingWords(control.recording) : control.why);
  }
}

element("play").onclick = () => steer({ do: orders.transport && orders.transport.paused ? "play" : "pause" });
element("restart").onclick = () => steer({ do: "restart" });
element("speed").onchange = () => {
  const value = element("speed").value;
  steer({ do: "speed", value: value === "max" ? value : Number(value) });
};
element("seek").onsubmit = (event) => { event.preventDefault(); steer({ do: "to", value: element("to").valueAsNumber }); };
element("record").onclick = () => order({ order: orders.control && orders.control.recording ? "record_stop" : "record_start" });
element("snapshot").onclick = () => order({ order: "snapshot" });
element("learn").onclick = () => order({ order: "learn_background" });
element("forget").onclick = () => order({ order: "forget_background" });
element("relearn").onclick = () => order({ order: "reset_filter" });
element("mark").onsubmit = (event) => {
  event.preventDefault();
  order({ order: "marker", text: element("remark").value });
  element("remark").value = "";
};
setInterval(look, ASK_MS);
