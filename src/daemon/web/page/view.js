"use strict";
// The scene in three dimensions: WebGL2, or a plain canvas where there is none. Rig frame, z up, m.
const CLOUD_KEPT_S = 3;
// A frustum is drawn so deep, m.
const FRUSTUM_M = 0.6;

const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const n = Math.hypot(...a) || 1; return [a[0] / n, a[1] / n, a[2] / n]; };
// A vector turned by a quaternion x, y, z, w.
function turned(q, v) {
  const t = cross(q, v).map((c) => 2 * c);
  return add(add(v, t, q[3]), cross(q, t));
}

function rgb(name) {
  const hex = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  return [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);
}

class GlPainter {
  constructor(gl) {
    this.gl = gl;
    const part = (kind, source) => {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source); gl.compileShader(shader);
      return shader;
    };
    this.program = gl.createProgram();
    gl.attachShader(this.program, part(gl.VERTEX_SHADER, `#version 300 es
      in vec3 place; in vec4 colour; uniform mat4 camera; uniform float size; out vec4 tint;
      void main() { gl_Position = camera * vec4(place, 1.0); gl_PointSize = size; tint = colour; }`));
    gl.attachShader(this.program, part(gl.FRAGMENT_SHADER, `#version 300 es
      precision mediump float; in vec4 tint; out vec4 drawn;
      void main() { drawn = vec4(tint.rgb * tint.a, tint.a); }`));
    gl.bindAttribLocation(this.program, 0, "place"); gl.bindAttribLocation(this.program, 1, "colour");
    gl.linkProgram(this.program);
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS)) throw new Error("no WebGL program");
    this.camera = gl.getUniformLocation(this.program, "camera");
    this.size = gl.getUniformLocation(this.program, "size");
    this.buffer = gl.createBuffer();
  }

  draw(camera, ground, ratio, lists) {
    const gl = this.gl;
    gl.viewport(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
    gl.clearColor(...ground, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST); gl.enable(gl.BLEND); gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(this.camera, false, camera);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.enableVertexAttribArray(0); gl.enableVertexAttribArray(1);
    const kinds = { points: gl.POINTS, lines: gl.LINES, triangles: gl.TRIANGLES };
    for (const list of lists) {
      gl.uniform1f(this.size, list.size * ratio);
      gl.depthMask(list.kind !== "triangles");
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(list.data), gl.STREAM_DRAW);
      gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 28, 0); gl.vertexAttribPointer(1, 4, gl.FLOAT, false, 28, 12);
      gl.drawArrays(kinds[list.kind], 0, list.data.length / 7);
    }
    gl.depthMask(true);
  }
}

class FlatPainter {
  constructor(context) { this.context = context; }

  draw(m, ground, ratio, lists) {
    const context = this.context, { width, height } = context.canvas;
    const colour = (c, alpha = 1) => `rgba(${c.slice(0, 3).map((v) => Math.round(255 * v))},${alpha})`;
    context.fillStyle = colour(ground); context.fillRect(0, 0, width, height);
    const seen = (d, at) => {
      const [x, y, z] = [d[at], d[at + 1], d[at + 2]];
      const w = m[3] * x + m[7] * y + m[11] * z + m[15];
      if (w < 0.01) return null;
      return [((m[0] * x + m[4] * y + m[8] * z + m[12]) / w * 0.5 + 0.5) * width,
        (0.5 - (m[1] * x + m[5] * y + m[9] * z + m[13]) / w * 0.5) * height];
    };
    for (const { kind, size, data } of lists) {
      const step = { points: 1, lines: 2, triangles: 3 }[kind];
      for (let at = 0; at < data.length; at += 7 * step) {
        const corners = [];
        for (let n = 0; n < step; n += 1) corners.push(seen(data, at + 7 * n));
        if (corners.some((corner) => !corner)) continue;
        const drawn = colour(data.slice(at + 3, at + 6), data[at + 6]);
        context.fillStyle = drawn; context.strokeStyle = drawn; context.lineWidth = 2 * ratio;
        if (kind === "points") { context.fillRect(corners[0][0], corners[0][1], size * ratio, size * ratio); continue; }
        context.beginPath(); context.moveTo(...corners[0]);
        corners.slice(1).forEach((corner) => context.lineTo(...corner));
        if (kind === "lines") context.stroke(); else context.fill();
      }
    }
  }
}

class View {
  constructor(canvas) {
    this.canvas = canvas;
    const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
    this.painter = gl ? new GlPainter(gl) : new FlatPainter(canvas.getContext("2d"));
    this.clouds = new Map(); this.points = new Map();
    this.sensors = []; this.model = null; this.contour = null; this.truth = null;
    this.shows = { clouds: true, model: true, sensors: true, truth: true };
    this.state = null; this.now = 0; this.follows = true; this.focus = [2.5, 0, 0.5];
    this.reset();
    this.listen();
  }

  reset() { this.yaw = 3.7; this.pitch = 0.35; this.distance = 3.2; this.follows = true; }
  clear() { this.clouds.clear(); this.points.clear(); this.state = null; this.model = null; this.contour = null; this.truth = null; }

  listen() {
    const canvas = this.canvas;
    const turn = (x, y) => {
      this.yaw -= x * 0.008;
      this.pitch = Math.min(1.5, Math.max(-1.5, this.pitch + y * 0.008));
    };
    const zoom = (factor) => { this.distance = Math.min(30, Math.max(0.3, this.distance * factor)); };
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => { if (event.buttons & 1) turn(event.movementX, event.movementY); });
    canvas.addEventListener("wheel", (event) => { zoom(Math.exp(event.deltaY * 0.001)); event.preventDefault(); }, { passive: false });
    const keys = {
      ArrowLeft: () => turn(-12, 0), ArrowRight: () => turn(12, 0), ArrowUp: () => turn(0, 12), ArrowDown: () => turn(0, -12),
      "+": () => zoom(0.9), "-": () => zoom(1.1), 0: () => this.reset(),
    };
    canvas.addEventListener("keydown", (event) => {
      if (keys[event.key]) { keys[event.key](); event.preventDefault(); }
    });
  }

  // Columns of projection times view.
  camera(aspect) {
    const back = [Math.cos(this.pitch) * Math.cos(this.yaw), Math.cos(this.pitch) * Math.sin(this.yaw), Math.sin(this.pitch)];
    const eye = add(this.focus, back, this.distance);
    const right = unit(cross([0, 0, 1], back)), up = cross(back, right);
    const f = 1 / Math.tan(0.4), near = 0.05, far = 80;
    const rows = [
      [...right, -dot(right, eye)].map((v) => (v * f) / aspect),
      [...up, -dot(up, eye)].map((v) => v * f),
      [...back, -dot(back, eye)].map((v) => (v * (far + near)) / (near - far)),
      [...back, -dot(back, eye)].map((v) => -v),
    ];
    rows[2][3] += (2 * far * near) / (near - far);
    const columns = new Float32Array(16);
    for (let c = 0; c < 4; c += 1) for (let r = 0; r < 4; r += 1) columns[4 * c + r] = rows[r][c];
    return columns;
  }

  // How often the cone is widened so that it can be seen, and its half angle as drawn, degrees.
  static cone(spin) {
    const half = 3 * spin.axis_sigma_deg;
    const factor = [1, 10, 100].find((times) => half * times >= 2) || 100;
    return { half, factor, drawn: Math.min(half * factor, 40) };
  }

  lists() {
    const lists = [];
    const names = [...this.clouds.keys()].sort();
    for (const [sensor, cloud] of this.shows.clouds ? this.clouds : []) {
      if (this.now - cloud.at > CLOUD_KEPT_S) continue;
      const colour = [...rgb(`--c${names.indexOf(sensor) % 3}`), 1];
      lists.push({ kind: "points", size: 2.5, data: cloud.xyz.flatMap((p) => [...p, ...colour]) });
    }
    const lines = [];
    const line = (a, b, colour) => lines.push(...a, ...colour, ...b, ...colour);
    const soft = [...rgb("--line"), 1];
    const ground = this.focus[2] - 1;
    for (let n = -3; n <= 3; n += 1) {
      const [x, y] = [Math.round(this.focus[0]), Math.round(this.focus[1])];
      line([x + n, y - 3, ground], [x + n, y + 3, ground], soft);
      line([x - 3, y + n, ground], [x + 3, y + n, ground], soft);
    }
    for (const point of this.points.values()) {
      for (const axis of [[1, 0, 0], [0, 1, 0], [0, 0, 1]]) {
        line(add(point, axis, -0.06), add(point, axis, 0.06), [...rgb("--axis"), 1]);
      }
    }
    const state = this.state;
    if (this.shows.sensors) this.frusta(line);
    if (this.shows.model) this.surface(state, line, lists);
    if (this.shows.truth && this.truth) this.trueAxis(state, line);
    if (state && state.position_m && state.rotation_xyzw) {
      const axes = [[[1, 0, 0], [0.9, 0.2, 0.2, 1]], [[0, 1, 0], [0.2, 0.7, 0.25, 1]], [[0, 0, 1], [0.25, 0.45, 1, 1]]];
      for (const [axis, colour] of axes) {
        line(state.position_m, add(state.position_m, turned(state.rotation_xyzw, axis), 0.45), colour);
      }
    }
    if (state && state.position_m && state.spin) this.spin(state, line, lists);
    lists.unshift({ kind: "lines", size: 1, data: lines });
    return lists;
  }

  // Each sensor where it stands: a depth camera's view as a frustum a part of the way to the target, a LiDAR as a ring.
  frusta(line) {
    const names = [...this.clouds.keys()].sort();
    for (const { id, translation_m: at, rotation_xyzw: q, corners_m: corners } of this.sensors) {
      const index = names.indexOf(id), colour = [...(index < 0 ? rgb("--soft") : rgb(`--c${index % 3}`)), 1];
      if (corners) {
        const far = corners.map((corner) => add(at, turned(q, corner), FRUSTUM_M));
        far.forEach((corner, n) => { line(at, corner, colour); line(corner, far[(n + 1) % 4], colour); });
      } else {
        const rim = (n) => add(at, turned(q, [Math.cos((Math.PI * n) / 12), Math.sin((Math.PI * n) / 12), 0]), 0.12);
        for (let n = 0; n < 24; n += 1) line(rim(n), rim(n + 1), colour);
        line(at, add(at, turned(q, [0, 0, 1]), 0.12), colour);
      }
    }
  }

  // The surface that was put together so far, and its edges, where the target is now.
  surface(state, line, lists) {
    if (!state || !state.position_m || !state.rotation_xyzw) return;
    const place = (p) => add(state.position_m, turned(state.rotation_xyzw, p));
    const colour = rgb("--model");
    if (this.model) {
      // Lit from the eye: a side that faces it is bright.
      const back = [Math.cos(this.pitch) * Math.cos(this.yaw), Math.cos(this.pitch) * Math.sin(this.yaw), Math.sin(this.pitch)];
      const data = [];
      this.model.xyz_m.forEach((p, n) => {
        const light = dot(turned(state.rotation_xyzw, this.model.normals[n]), back);
        if (light > 0) data.push(...place(p), ...colour.map((c) => c * (0.45 + 0.55 * light)), 1);
      });
      lists.push({ kind: "points", size: 3, data });
    }
    if (this.contour && (!this.model || this.contour.target === this.model.target)) {
      for (const { kind, ends_m: [from, to] } of this.contour.edges) {
        line(place(from), place(to), [...(kind === "crease" ? rgb("--ink") : rgb("--soft")), 1]);
      }
    }
  }

  // The true spin axis of a simulated target, dashed, through the place that was measured.
  trueAxis(state, line) {
    if (!this.truth.axis) return;
    const from = state && state.position_m ? state.position_m : this.truth.position_m;
    for (let n = -14; n < 14; n += 2) {
      line(add(from, this.truth.axis, n * 0.1), add(from, this.truth.axis, (n + 1) * 0.1), [...rgb("--truth"), 1]);
    }
  }

  spin(state, line, lists) {
    const colour = rgb("--axis"), { drawn } = View.cone(state.spin);
    const axis = state.spin.axis, from = state.position_m, length = 1;
    line(add(from, axis, -length), add(from, axis, length), [...colour, 1]);
    const side = unit(cross(axis, Math.abs(axis[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0])), other = cross(axis, side);
    const wide = length * Math.tan((drawn * Math.PI) / 180), cone = [];
    for (const end of [1, -1]) {
      const rim = (n) => {
        const angle = (2 * Math.PI * n) / 24;
        return add(add(add(from, axis, end * length), side, wide * Math.cos(angle)), other, wide * Math.sin(angle));
      };
      for (let n = 0; n < 24; n += 1) {
        for (const corner of [from, rim(n), rim(n + 1)]) cone.push(...corner, ...colour, 0.16);
        line(rim(n), rim(n + 1), [...colour, 1]);
      }
    }
    lists.push({ kind: "triangles", size: 1, data: cone });
  }

  draw() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.round(this.canvas.clientWidth * ratio), height = Math.round(this.canvas.clientHeight * ratio);
    if (!width || !height) return;
    if (this.canvas.width !== width || this.canvas.height !== height) { this.canvas.width = width; this.canvas.height = height; }
    if (this.follows && this.state && this.state.position_m) this.focus = this.state.position_m;
    this.painter.draw(this.camera(width / height), rgb("--scene"), ratio, this.lists());
  }
}
