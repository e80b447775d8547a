"use strict";
// Plots of the last three minutes, one value a line, drawn at most four times a second.
const SPAN_S = 180;
const MOST_SAMPLES = 4000;

class Plot {
  constructor(parent, title, unit, count) {
    const box = document.createElement("div");
    const head = document.createElement("h2");
    this.value = document.createElement("b");
    head.append(`${title}, ${unit} `, this.value);
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `${title} over the last three minutes`);
    box.append(head, this.canvas);
    parent.append(box);
    this.count = count;
    this.samples = [];
  }

  add(t, value) {
    if (!Number.isFinite(value)) return;
    const last = this.samples.at(-1);
    if (last && t < last[0] - 1) this.samples = [];
    this.samples.push([t, value]);
    if (this.samples.length > MOST_SAMPLES) this.samples.splice(0, this.samples.length - MOST_SAMPLES);
  }

  clear() { this.samples = []; }

  draw(now) {
    const first = this.samples.findIndex((sample) => sample[0] >= now - SPAN_S);
    this.samples.splice(0, first < 0 ? this.samples.length : first);
    const ratio = window.devicePixelRatio || 1;
    const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    this.canvas.width = width * ratio; this.canvas.height = height * ratio;
    const context = this.canvas.getContext("2d");
    context.scale(ratio, ratio);
    const style = getComputedStyle(document.documentElement);
    const values = this.samples.map((sample) => sample[1]);
    const last = values.at(-1);
    this.value.textContent = last === undefined ? "–" : last.toFixed(this.count);
    const sorted = [...values].sort((a, b) => a - b);
    // A single wild value must not flatten the rest.
    const high = sorted.length ? Math.max(sorted[Math.floor(0.98 * (sorted.length - 1))] * 1.15, 1e-6) : 1;
    const x = (t) => 34 + (1 - (now - t) / SPAN_S) * (width - 38);
    const y = (value) => Math.max(2, height - 16 - (value / high) * (height - 22));
    context.font = "11px system-ui"; context.fillStyle = style.getPropertyValue("--soft");
    context.strokeStyle = style.getPropertyValue("--line"); context.lineWidth = 1;
    for (const part of [0, 0.5, 1]) {
      const at = y(high * part);
      context.beginPath(); context.moveTo(34, at); context.lineTo(width, at); context.stroke();
      context.fillText(String(Number((high * part).toPrecision(2))), 2, at + 4);
    }
    for (const back of [180, 120, 60]) context.fillText(`−${back} s`, x(now - back), height - 2);
    context.strokeStyle = style.getPropertyValue("--c0"); context.lineWidth = 1.5;
    context.beginPath();
    let before = -Infinity;
    for (const [t, value] of this.samples) {
      // A gap in time is a gap in the line.
      if (t - before > 2.5) context.moveTo(x(t), y(value)); else context.lineTo(x(t), y(value));
      before = t;
    }
    context.stroke();
  }
}
