"use strict";
// The state's and health's words in plain ones, and what to do about them.
const MODES = {
  no_target: "no target", acquiring: "acquiring", tracking: "tracking", predicted: "predicted", lost: "lost",
};
const MEASURING = {
  no_target: ["bad", "No. Nothing that could be the target stands in the region of interest."],
  learning: ["warn", "Not yet. What stands in the empty room is being learned."],
  acquiring: ["warn", "Not yet. Something is seen, and its motion is being found out; this takes some seconds."],
  tracking: ["good", "Yes. The target is measured with every epoch."],
  predicted: ["warn", "Not at this moment. Its motion is carried on from the last measurement, less surely every second."],
  lost: ["bad", "No. The target was lost, and is being looked for."],
};
const REASONS = {
  no_points: ["nothing stands in the region of interest", "Check the target's place and the config's [target] region of interest."],
  few_points: ["too few points on the target", "Move the target nearer, or look for what hides it."],
  poor_fit: ["the points lie badly on the model", "Wait while the model grows; if it stays, check the calibration and what moves beside the target."],
  degenerate: ["what is seen leaves a direction open", "Wait until more of the target turns into view."],
  rejected: ["the measurement contradicts the prediction", "Wait some frames; if it stays: tumbled ctl reset-filter."],
  manoeuvre: ["the motion has just changed", "Wait some seconds for the new motion."],
  learning: ["the empty room is being learned", "Wait until it is learned, and keep the target out until then."],
  settling: ["the motion is not known yet", "Wait some seconds."],
  one_sensor: ["only one sensor has measured in the last two seconds", "Check in the table which sensor gives nothing."],
  ambiguous: ["several things or poses explain what is seen", "Clear the region of interest of other things."],
  unrecognised: ["what is seen is not the target of the given model", "Check that the right target stands there, or leave the model out."],
  stale: ["nothing was measured for more than a second", "Check the sensors, and whether something stands before them."],
  extrinsic: ["the sensors disagree by more than their mountings' uncertainty", "Check the mountings; calibrate again."],
};
const ORIGINS = {
  live: ["LIVE", "live"], simulated: ["SIMULATED", "simulated"], replay: ["REPLAY", "replay"],
};

// A prediction over less than a second still rests on measurements: between two late epochs the answer stays.
const standing = (state) => (state.mode === "predicted" && !state.reasons.includes("stale") ? "tracking" : state.mode);
// A state as it stands when its session is at `now`, s: where no sensor sends there are no epochs to say so.
const GOOD_S = 1, LOST_S = 3;
function asOf(state, now) {
  const age = now - state.t_ns * 1e-9 + (state.measured_ms_ago ?? 0) * 1e-3;
  if (age <= GOOD_S) return state;
  const known = state.mode === "tracking" || state.mode === "predicted", lost = known && age > LOST_S;
  return {
    ...state, mode: lost ? "lost" : known ? "predicted" : state.mode, validity: "invalid",
    reasons: [...new Set([...state.reasons, "stale"])], spin: lost ? null : state.spin,
  };
}
// Whether what HEALTH says of an epoch is how it stands.
const isSo = (told, mode) => told === mode || (told === "predicted" && mode === "tracking");

const digits = (value, count) => (Number.isFinite(value) ? value.toFixed(count) : "–");

function duration(seconds) {
  if (!Number.isFinite(seconds) || seconds < 0) return "–";
  if (seconds < 60) return `${Math.round(seconds)} s`;
  if (seconds < 3600) return `${Math.floor(seconds / 60)} min ${Math.round(seconds % 60)} s`;
  return `${Math.floor(seconds / 3600)} h ${Math.floor((seconds % 3600) / 60)} min`;
}

function bytes(count) {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let value = count, unit = 0;
  while (value >= 1000 && unit < 4) { value /= 1000; unit += 1; }
  return `${value.toFixed(unit ? 1 : 0)} ${units[unit]}`;
}

// What is known of the target's surface.
function surfaceWords(model, contour) {
  if (!model) return "No model yet.";
  const pieces = `Model of target ${model.target}: ${model.surfels_total} pieces of surface from ${model.frames} frames, ${model.xyz_m.length} drawn`;
  if (!contour || contour.target !== model.target) return `${pieces}.`;
  const creases = contour.edges.filter((edge) => edge.kind === "crease").length;
  return `${pieces}; ${contour.planes} planes, ${creases} creases, ${contour.edges.length - creases} ends.`;
}

// How far what is measured lies from what is simulated.
function truthWords(truth, spin) {
  if (!truth.axis) return "Simulated truth: it does not turn.";
  const told = `Simulated truth (dashed): ${digits(truth.rate_dps, 3)} °/s`;
  if (!spin) return `${told}.`;
  const cosine = spin.axis.reduce((sum, part, n) => sum + part * truth.axis[n], 0);
  const off = (180 / Math.PI) * Math.acos(Math.min(1, Math.max(-1, cosine)));
  return `${told}; measured: axis off by ${digits(off, 2)}°, rate by ${digits(spin.rate_dps - truth.rate_dps, 3)} °/s.`;
}

const setText = (id, text, kind) => {
  const element = document.getElementById(id);
  if (element.textContent !== text) element.textContent = text;
  if (kind !== undefined) element.className = kind;
  return element;
};

// The five questions, from what was told last. `so_s`: for how long the answer to the first one has been what it is.
function answer(state, health, so_s, isConnected) {
  if (!isConnected) {
    setText("q-measuring", "Not known: the daemon does not answer.", "bad");
    setText("q-well", "Not known.", "bad");
    setText("q-missing", "The connection to the daemon.", "bad");
    setText("q-since", `For ${duration(so_s)}.`, "");
    setText("q-todo", "Check that tumbled runs (systemctl status tumbled). The page connects again by itself.", "bad");
    return;
  }
  const mode = state ? standing(state) : null;
  const learns = state && state.reasons.includes("learning");
  const [kind, sentence] = MEASURING[learns ? "learning" : mode] || ["warn", "Not yet: no state has come."];
  setText("q-measuring", sentence, kind);
  const level = state ? state.validity : "none";
  const fit = { ok: "Valid.", degraded: "Usable with care.", invalid: "Do not use it." }[level] || "Not known yet.";
  const sigma = health && health.estimate && health.estimate.sigma_by_source;
  const spin = state && state.spin;
  const parts = [fit];
  if (spin) parts.push(`Rate ±${digits(3 * spin.rate_sigma_dps, 3)} °/s, axis ±${digits(3 * spin.axis_sigma_deg, 2)}° (3σ).`);
  if (sigma) parts.push(`σ: attitude ${digits(sigma.attitude_deg.total, 2)}°, position ${digits(sigma.position_mm.total, 1)} mm.`);
  setText("q-well", parts.join(" "), { ok: "good", degraded: "warn", invalid: "bad" }[level] || "warn");

  const own = (state ? state.reasons : []).map((reason) => REASONS[reason] || [reason, ""]);
  const told = health ? [...health.core.reasons, ...health.shell.reasons] : [];
  const missing = [...new Set([...own.map((reason) => reason[0]), ...told.map((reason) => reason.message)])];
  setText("q-missing", missing.length ? `${missing.join("; ")}.` : "Nothing.", missing.length ? "warn" : "good");
  setText("q-since", `So for ${duration(so_s)}.`, "");
  const todo = [...new Set(own.map((reason) => reason[1]).filter(Boolean))];
  if (told.length) todo.push("What the sensors and the machine lack is said above with its remedy.");
  if (!todo.length) {
    todo.push(mode === "tracking" ? "Nothing: it measures." : mode === "no_target" ? REASONS.no_points[1] : "Wait some seconds.");
  }
  setText("q-todo", todo.join(" "), todo[0].startsWith("Nothing") ? "good" : "");
}

const ORDERED = {
  learn_background: "the empty room is being learned", forget_background: "the room is forgotten",
  reset_filter: "the target is found anew", marker: "the marker stands in the recording",
  record_start: "recording", record_stop: "recorded", snapshot: "written", note: "noted",
};

const fileName = (path) => path.split("/").pop();

function doneWords(reply) {
  const { recording: file, order } = reply;
  const words = `${ORDERED[order] || order} (at ${digits(reply.t_ns * 1e-9, 1)} s)`;
  if (!file) return words;
  return order === "record_start" ? `${words}: ${fileName(file.file)}` : `${words}: ${fileName(file.file)}, ${digits(file.covers_s, 1)} s, ${bytes(file.bytes)}`;
}

const recordingWords = (recording) => (recording ? `${fileName(recording.file)}, ${bytes(recording.bytes)}` : "not recording");

function transportWords(transport) {
  const at = transport.t_s === null ? "not begun" : `at ${digits(transport.t_s, 1)} s`;
  if (transport.ended) return `at its end, ${at}`;
  if (transport.paused) return `held ${at}`;
  return `plays ${transport.speed === null ? "as fast as it can" : `${transport.speed} times as fast`}, ${at}`;
}
