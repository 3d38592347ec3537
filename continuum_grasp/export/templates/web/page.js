const KNOWN = JSON.parse(document.getElementById("known").textContent);
const PLANT = KNOWN.plant, LOOP = KNOWN.controller, RECORD = KNOWN.record;
const element = (id) => document.getElementById(id);

async function module(name) {
  const packed = Uint8Array.from(atob(MODULES[name]), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}
const MODULES = JSON.parse(element("modules").textContent);

// ---- what is computed ------------------------------------------------------------------------------------------------

const c = (await WebAssembly.instantiate(await module("plant"))).instance.exports;
const memory = {};
for (const [name, size] of Object.entries(PLANT.arrays)) {
  memory[name] = new Float64Array(c.memory.buffer, c[`at_${name}`](), size);
}
let controller = null, io = null, fields = null, changes = [];

const world = {
  time: 0, steps: 0, next: 0, code: 0, state: "", past: [], push: [0, 0, 0], target: null, led: false, free: false, pace: 1,
  took: 0, calls: 0, played: RECORD ? 0 : -1,
};

function gauss() {
  return Math.sqrt(-2 * Math.log(1 - Math.random())) * Math.cos(2 * Math.PI * Math.random());
}

async function reset() {
  c.restart();
  for (const name of ["x", "u", "p"]) memory[name].set(PLANT.start[name]);
  memory.w.set(PLANT.table.w[0] ?? []);
  Object.assign(world, { time: 0, steps: 0, next: 0, code: 0, past: [], push: [0, 0, 0], free: false, took: 0, calls: 0 });
  Object.assign(world, { led: false, played: RECORD ? 0 : -1 });
  if (LOOP) {
    const finger = await load(await module("controller"));
    controller = finger.new_controller();
    io = controller.direct();
    fields = { measurement: finger.layout("measurement"), reference: finger.layout("reference") };
    changes = [...(RECORD?.changes ?? [])];
    LOOP.start = Object.keys(finger.layout(LOOP.starts));
  }
  for (const [k, slider] of PLANT.parameters.entries()) memory.p[k] = slider.value;
  wish();
  if (RECORD) play(0);
  for (const plot of plots) plot.clear();
  c.look();
  show();
}

// ---- a run that was recorded -----------------------------------------------------------------------------------------

// Its states at an instant, as they were.
function play(time) {
  const { t, x, u, w } = RECORD;
  let k = Math.min(world.played, t.length - 1);
  if (t[k] > time) k = 0;
  while (k + 1 < t.length && t[k + 1] <= time + 1e-9) ++k;
  world.played = k;
  world.time = Math.min(time, t[t.length - 1]);
  memory.x.set(x[k]);
  memory.u.set(u[k]);
  memory.w.set(w[k]);
  wish();
  c.look();
}

// From this instant on the page computes what happens.
function takeOver() {
  if (world.played < 0) return;
  const k = world.played;
  world.played = -1;
  world.steps = Math.round(world.time / PLANT.step);
  world.time = world.next = world.steps * PLANT.step;
  c.restart();
  if (LOOP) {
    Object.keys(controller.known ?? {}).forEach((name, i) => { controller.known[name] = RECORD.known[k][i]; });
    change();
    const whole = (names, values) => Object.fromEntries(names.map((name, i) => [name, values[i]]));
    // What it estimated may be out of the range that it begins in: then it begins as at the start.
    try {
      controller.start(whole(LOOP.start, RECORD.z[k]), whole(LOOP.commands, RECORD.u[k]));
    } catch (error) {
      if (!(error instanceof FingerError)) throw error;
    }
  }
  show();
}

// Weights and limits that a mission changes from phase to phase; any call but that of a step takes them over.
function change() {
  const names = Object.keys(controller.settings);
  while (changes.length && changes[0].t <= world.time + 1e-9) {
    const now = changes.shift(), from = 2 * now.weights.length, values = [now.weights, now.low, now.high];
    let at = 0;
    for (const [k, of] of values.entries()) {
      if (k === 1) at = from;
      for (const value of of) controller.settings[names[at++]] = value;
    }
    controller.estimate();
  }
}

function control() {
  if (changes.length) change();
  c.sense();
  world.past.push([world.time, Float64Array.from(memory.sensed)]);
  while (world.past.length > 1 && world.past[1][0] <= world.time - LOOP.delay + 1e-9) world.past.shift();
  const late = world.past[0][1];
  const array = io.measurement;
  LOOP.names.forEach((name, k) => { array[fields.measurement[name].at] = late[k] + LOOP.std[k] * gauss(); });
  aim();
  const before = performance.now();
  world.code = io.call();
  world.took += performance.now() - before;
  ++world.calls;
  if (world.code >= 0) memory.u.set(io.command);
}

// Setpoints of the scene over the horizon, but of the tip where a target was dragged.
function aim() {
  const { stage } = LOOP.reference, array = io.reference;
  for (const [k, name] of LOOP.reference.names.entries()) {
    const { at, count } = fields.reference[name], to = world.led ? "xy".indexOf(name.replace("tip_", "")) : -1;
    for (let n = 0; n < count; ++n) array[at + n] = to < 0 ? setpoint(k, world.time + n * stage) : world.target[to];
  }
}

function setpoint(k, time) {
  const { dt, rows } = LOOP.reference, at = Math.min(time / dt, rows.length - 1), n = Math.floor(at + 1e-9);
  return rows[n][k] + Math.max(0, at - n) * ((rows[n + 1] ?? rows[n])[k] - rows[n][k]);
}

// Where the scene wants the tip, until it is dragged.
function wish() {
  if (!LOOP || world.led) return;
  const of = ["tip_x", "tip_y"].map((name) => LOOP.reference.names.indexOf(name));
  world.target = of.includes(-1) ? null : of.map((k) => setpoint(k, world.time));
}

// Inputs and loads of the scene over time, until a slider is moved.
function follow() {
  const { dt, u, w } = PLANT.table;
  const at = Math.min(world.time / dt, w.length - 1), k = Math.floor(at), share = at - k;
  const between = (rows, i) => rows[k][i] + share * ((rows[k + 1] ?? rows[k])[i] - rows[k][i]);
  for (let i = 0; i < memory.w.length; ++i) memory.w[i] = between(w, i);
  if (!LOOP && !world.free) for (let i = 0; i < memory.u.length; ++i) memory.u[i] = between(u, i);
}

function advance(steps) {
  takeOver();
  for (let n = 0; n < steps; ++n) {
    follow();
    pull();
    if (LOOP && world.time >= world.next - 1e-9) {
      control();
      world.next += LOOP.period;
    }
    const before = performance.now();
    const code = c.advance(PLANT.step, 1);
    if (!LOOP) {
      world.took += performance.now() - before;
      ++world.calls;
    }
    if (code < 0) {
      world.pace = 0;
      return say("The motion is no longer finite: press Reset.", true);
    }
    world.time = ++world.steps * PLANT.step;
  }
  wish();
  c.look();
}

// ---- hands -----------------------------------------------------------------------------------------------------------

let hand = null; // { kind, at: world point, station }

function pull() {
  world.push = [0, 0, 0];
  if (!hand) return;
  if (hand.kind === "finger") {
    const k = hand.station, first = PLANT.pushes.first + 2 * k, most = PLANT.pushes.most, held = pushed(k);
    const x = hand.at[0] - held[0], y = hand.at[1] - held[1];
    const stiff = most / (0.1 * PLANT.length), size = Math.hypot(x, y) * stiff;
    const force = size > most ? (stiff * most) / size : stiff;
    memory.w[first] += force * x;
    memory.w[first + 1] += force * y;
    world.push = [force * x, force * y, Math.hypot(force * x, force * y)];
  } else if (hand.kind === "object") {
    const o = PLANT.object, pose = objectPose();
    const x = hand.at[0] - hand.grip[0], y = hand.at[1] - hand.grip[1];
    if (o.state === null) {
      // Not faster than a hand: contacts are stiff.
      const most = 0.5 * PLANT.step, away = Math.hypot(x - pose[0], y - pose[1]);
      const share = away > most ? most / away : 1;
      memory.p[o.parameter] += share * (x - pose[0]);
      memory.p[o.parameter + 1] += share * (y - pose[1]);
    } else {
      const stiff = o.most / 0.02, fx = stiff * (x - pose[0]), fy = stiff * (y - pose[1]);
      const size = Math.hypot(fx, fy), share = size > o.most ? o.most / size : 1;
      memory.w[o.wrench] += share * fx;
      memory.w[o.wrench + 1] += share * fy;
      world.push = [share * fx, share * fy, share * size];
    }
  }
}

function objectPose() {
  const o = PLANT.object;
  if (o.state !== null) return [memory.x[o.state], memory.x[o.state + 1], memory.x[o.state + 2]];
  if (o.parameter !== null) return [memory.p[o.parameter], memory.p[o.parameter + 1], o.pose[2]];
  return o.pose;
}

const near = (at, x, y) => Math.hypot(at[0] - x, at[1] - y);

function grab(at, reach) {
  if (world.target && near(at, ...world.target) < reach) return { kind: "target" };
  if (PLANT.object && (PLANT.object.state !== null || PLANT.object.parameter !== null)) {
    const pose = objectPose(), place = [at[0] - pose[0], at[1] - pose[1]];
    const cos = Math.cos(pose[2]), sin = Math.sin(pose[2]);
    const own = [cos * place[0] + sin * place[1], -sin * place[0] + cos * place[1]];
    if (PLANT.object.parts.some((part) => inside(part, own))) return { kind: "object", grip: place };
  }
  let best = reach, station = -1;
  for (let k = 1; k < memory.section_x.length; ++k) {
    const away = near(at, ...section(k)) - PLANT.half[k];
    if (away < best) {
      best = away;
      station = nearestPush(...section(k));
    }
  }
  if (station >= 0) return { kind: "finger", station };
  return world.target ? { kind: "target" } : null;
}

const section = (k) => [memory.section_x[k], memory.section_y[k]];
const pushed = (k) => section(PLANT.pushes.sections[k]);

function nearestPush(x, y) {
  const away = PLANT.pushes.sections.map((k) => near(section(k), x, y));
  return away.indexOf(Math.min(...away));
}

function inside(part, [x, y]) {
  let found = false;
  for (let i = 0, j = part.length - 1; i < part.length; j = i++) {
    const [xi, yi] = part[i], [xj, yj] = part[j];
    if (yi > y !== yj > y && x < ((xj - xi) * (y - yi)) / (yj - yi) + xi) found = !found;
  }
  return found;
}

// ---- what is drawn ---------------------------------------------------------------------------------------------------

const canvas = element("world"), pen = canvas.getContext("2d");
const [LEFT, BOTTOM, RIGHT, TOP] = KNOWN.view;
let scale = 1, colors = {};

function readColors() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ["paper", "ink", "faint", "line", "finger", "object", "edge", "force", "target", "zone", "support", "second"]) {
    colors[name] = style.getPropertyValue(`--${name}`).trim();
  }
}

// Widths are asked for when they change: each question would lay out the page anew, texts having been written.
const widths = new Map(), resized = new ResizeObserver((all) => {
  for (const { target } of all) widths.set(target, target.clientWidth);
});

function widthOf(what) {
  if (!widths.has(what)) {
    widths.set(what, what.clientWidth);
    resized.observe(what);
  }
  return widths.get(what);
}

function fit(what, height) {
  const ratio = window.devicePixelRatio || 1, width = widthOf(what);
  if (what.width !== Math.round(width * ratio) || what.height !== Math.round(height * ratio)) {
    what.width = Math.round(width * ratio);
    what.height = Math.round(height * ratio);
    what.style.height = `${height}px`;
  }
  return [width, height, ratio];
}

function draw() {
  const width = widthOf(canvas), shape = (TOP - BOTTOM) / (RIGHT - LEFT);
  const [w, h, ratio] = fit(canvas, Math.round(Math.min(width * shape, 0.62 * window.innerHeight, 560)));
  scale = Math.min(w / (RIGHT - LEFT), h / (TOP - BOTTOM));
  const ox = 0.5 * (w - scale * (RIGHT + LEFT)), oy = 0.5 * (h + scale * (TOP + BOTTOM));
  world.origin = [ox, oy];
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.fillStyle = colors.paper;
  pen.fillRect(0, 0, w, h);
  const at = (x, y) => [ox + scale * x, oy - scale * y];
  const path = (points, close) => {
    pen.beginPath();
    points.forEach(([x, y], k) => pen[k ? "lineTo" : "moveTo"](...at(x, y)));
    if (close) pen.closePath();
  };
  const far = 3 * (RIGHT - LEFT + TOP - BOTTOM);
  for (const zone of PLANT.zones ?? []) {
    pen.fillStyle = colors.zone;
    pen.beginPath();
    if (zone.center) pen.arc(...at(...zone.center), scale * zone.radius, 0, 2 * Math.PI);
    else {
      const [x, y] = zone.point, [a, b] = zone.normal;
      path([[x - far * b, y + far * a], [x + far * b, y - far * a], [x + far * (b - a), y - far * (a + b)], [x - far * (a + b), y + far * (a - b)]], true);
    }
    pen.fill();
  }
  for (const [x, y, a, b, half] of PLANT.walls ?? []) {
    const d = 0.03 * (RIGHT - LEFT);
    path([[x - half * b, y + half * a], [x + half * b, y - half * a], [x + half * b - d * a, y - half * a - d * b], [x - half * b - d * a, y + half * a - d * b]], true);
    pen.fillStyle = colors.support;
    pen.fill();
  }
  for (const [x, y, radius] of PLANT.pegs ?? []) {
    pen.beginPath();
    pen.arc(...at(x, y), Math.max(3, scale * radius), 0, 2 * Math.PI);
    pen.fillStyle = colors.support;
    pen.fill();
  }
  if (PLANT.object) {
    const [x, y, angle] = objectPose(), cos = Math.cos(angle), sin = Math.sin(angle);
    pen.lineJoin = "round";
    const turned = PLANT.object.parts.map((part) => part.map(([a, b]) => [x + cos * a - sin * b, y + sin * a + cos * b]));
    pen.strokeStyle = colors.edge;
    pen.lineWidth = 3;
    for (const part of turned) { path(part, true); pen.stroke(); }
    pen.fillStyle = colors.object;
    for (const part of turned) { path(part, true); pen.fill(); }
  }
  drawFinger(at);
  drawForces(at);
  if (world.target) {
    const [x, y] = at(...world.target);
    pen.strokeStyle = colors.target;
    pen.lineWidth = 2;
    pen.beginPath();
    pen.arc(x, y, 11, 0, 2 * Math.PI);
    pen.moveTo(x - 16, y); pen.lineTo(x + 16, y);
    pen.moveTo(x, y - 16); pen.lineTo(x, y + 16);
    pen.stroke();
  }
  drawScale(w, h);
  if (hand && hand.kind === "finger") {
    pen.strokeStyle = colors.second;
    pen.setLineDash([5, 4]);
    path([pushed(hand.station), hand.at]);
    pen.stroke();
    pen.setLineDash([]);
  }
}

// Between sections a cubic with their tangents; the sides are as far from it as the finger is thick.
function drawFinger(at) {
  const count = memory.section_x.length;
  const side = (sign) => {
    const found = [];
    for (let k = 0; k < count; ++k) {
      const a = memory.section_angle[k], [x, y] = section(k), half = Math.max(PLANT.half[k], 1.2 / scale), cos = Math.cos(a), sin = Math.sin(a);
      found.push([x + sign * half * cos, y + sign * half * sin, -sin, cos]);
    }
    return found;
  };
  const curve = (points, way) => {
    for (let k = 1; k < points.length; ++k) {
      const [x0, y0, a0, b0] = points[k - 1], [x1, y1, a1, b1] = points[k], chord = Math.hypot(x1 - x0, y1 - y0) / 3;
      pen.bezierCurveTo(...at(x0 + way * chord * a0, y0 + way * chord * b0), ...at(x1 - way * chord * a1, y1 - way * chord * b1), ...at(x1, y1));
    }
  };
  const left = side(-1), right = side(1).reverse();
  pen.beginPath();
  pen.moveTo(...at(left[0][0], left[0][1]));
  curve(left, 1);
  pen.lineTo(...at(right[0][0], right[0][1]));
  curve(right, -1);
  pen.closePath();
  pen.fillStyle = colors.finger;
  pen.fill();
  const a = memory.section_angle[0], [x, y] = section(0), w = 0.06 * PLANT.length, d = 0.03 * PLANT.length;
  const tx = -Math.sin(a), ty = Math.cos(a);
  pen.beginPath();
  [[-w, 0], [w, 0], [w, -d], [-w, -d]].forEach(([across, along], k) =>
    pen[k ? "lineTo" : "moveTo"](...at(x + across * ty + along * tx, y - across * tx + along * ty)));
  pen.closePath();
  pen.fillStyle = colors.faint;
  pen.fill();
  for (const [share, mass] of PLANT.masses) {
    if (!mass) continue;
    const k = Math.round(share * (count - 1));
    pen.beginPath();
    pen.arc(...at(...section(k)), 5, 0, 2 * Math.PI);
    pen.fillStyle = colors.ink;
    pen.fill();
  }
}

// A length of one, two or five, as long as a fifth of the canvas at most.
function drawScale(w, h) {
  const most = (0.2 * w) / scale, power = 10 ** Math.floor(Math.log10(most));
  const length = power * (most >= 5 * power ? 5 : most >= 2 * power ? 2 : 1), x = w - 12, y = h - 12;
  pen.strokeStyle = pen.fillStyle = colors.faint;
  pen.lineWidth = 1.5;
  pen.beginPath();
  pen.moveTo(x - scale * length, y - 5); pen.lineTo(x - scale * length, y);
  pen.lineTo(x, y); pen.lineTo(x, y - 5);
  pen.stroke();
  pen.font = "13px system-ui, sans-serif";
  pen.textAlign = "right";
  pen.fillText(`${digits(1000 * length)} mm`, x, y - 9);
}

function arrow(at, x, y, fx, fy, color) {
  const size = Math.hypot(fx, fy);
  if (size < 1e-3 * world.unit) return;
  const reach = (0.18 * (TOP - BOTTOM) * Math.min(size / world.unit, 1.5)) / size;
  const [x0, y0] = at(x - fx * reach, y - fy * reach), [x1, y1] = at(x, y), turn = Math.atan2(y1 - y0, x1 - x0);
  pen.strokeStyle = pen.fillStyle = color;
  pen.lineWidth = 2.5;
  pen.beginPath();
  pen.moveTo(x0, y0); pen.lineTo(x1, y1);
  pen.stroke();
  pen.beginPath();
  pen.moveTo(x1, y1);
  for (const sign of [-1, 1]) pen.lineTo(x1 - 12 * Math.cos(turn + 0.45 * sign), y1 - 12 * Math.sin(turn + 0.45 * sign));
  pen.fill();
}

function drawForces(at) {
  world.unit = Math.max(4 * PLANT.pushes.most, ...(memory.normal_force ?? []));
  if (memory.force_x) {
    for (let k = 0; k < PLANT.touches.length; ++k) {
      if (PLANT.touches[k] === "table") continue;
      arrow(at, memory.point_x[k], memory.point_y[k], memory.force_x[k], memory.force_y[k], colors.force);
    }
  }
}

const words = (name) => name.replaceAll("_", " ").replaceAll(".", " ");

// Without exponents and signs of zero.
function digits(value) {
  const size = Math.abs(value);
  return size < 1e-9 ? "0" : size >= 1e-3 && size < 1e5 ? Number(value.toPrecision(3)).toString() : value.toExponential(1);
}

// Units as they are printed.
const raised = (unit) => (unit === "1" ? "" : unit.replaceAll("2", "\u00b2").replaceAll("3", "\u00b3"));

// Text that is written again costs a layout.
function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

// ---- plots -----------------------------------------------------------------------------------------------------------

const SPAN = 5; // s
class Plot {
  constructor(title, unit, names) {
    const figure = document.createElement("figure");
    this.caption = document.createElement("figcaption");
    this.canvas = document.createElement("canvas");
    this.shown = names.map(() => document.createElement("span"));
    this.caption.append(`${title} [${raised(unit)}]: `, ...this.shown.flatMap((one) => [one, " "]));
    figure.append(this.caption, this.canvas);
    element("plots").append(figure);
    Object.assign(this, { title, unit, names, rows: [] });
  }
  clear() { this.rows = []; }
  add(values) {
    if (this.rows.length && world.time <= this.rows[this.rows.length - 1][0]) return;
    this.rows.push([world.time, ...values]);
    while (this.rows.length && this.rows[0][0] < world.time - SPAN) this.rows.shift();
  }
  draw() {
    const [w, h, ratio] = fit(this.canvas, 90), p = this.canvas.getContext("2d");
    p.setTransform(ratio, 0, 0, ratio, 0, 0);
    p.clearRect(0, 0, w, h);
    if (!this.rows.length) return;
    let low = 0, high = 1e-9;
    for (const row of this.rows) for (let k = 1; k < row.length; ++k) {
      low = Math.min(low, row[k]);
      high = Math.max(high, row[k]);
    }
    const last = this.rows[this.rows.length - 1];
    const shades = [colors.finger, colors.second, colors.target, colors.force, colors.faint];
    for (const [k, shown] of this.shown.entries()) {
      const color = this.shown.length > 1 ? shades[k % shades.length] : colors.ink;
      if (shown.style.color !== color) shown.style.color = color;
      write(shown, `${this.shown.length > 1 ? `${words(this.names[k].split(" ")[0])} ` : ""}${digits(last[k + 1])}`);
    }
    const x = (t) => w - ((world.time - t) / SPAN) * w, y = (v) => h - 4 - ((v - low) / (high - low)) * (h - 24);
    p.strokeStyle = colors.line;
    p.beginPath(); p.moveTo(0, y(0)); p.lineTo(w, y(0)); p.stroke();
    p.font = "12px system-ui, sans-serif";
    p.fillStyle = colors.faint;
    if (high > 1e-8) p.fillText(digits(high), 4, 14);
    if (low < -1e-8) p.fillText(digits(low), 4, h - 6);
    for (let k = 1; k < last.length; ++k) {
      p.strokeStyle = shades[(k - 1) % shades.length];
      p.lineWidth = 1.6;
      p.beginPath();
      this.rows.forEach((row, i) => p[i ? "lineTo" : "moveTo"](x(row[0]), y(row[k])));
      p.stroke();
    }
  }
}

const unitOf = (name) => (name.match(/\[(.*)\]/) ?? ["", ""])[1];
const plots = [];
const inputs = new Plot("Input", unitOf(PLANT.input_names[0]), PLANT.input_names);
plots.push(inputs);
const contacts = PLANT.touches.length ? new Plot("Contact force", "N", PLANT.touches) : null;
if (contacts) plots.push(contacts);
const times = new Plot(LOOP ? "Time per call of the controller" : "Time per step", "ms", ["time"]);
plots.push(times);

// ---- sliders and buttons ---------------------------------------------------------------------------------------------

const sliders = [];
class Slider {
  constructor({ name, unit, low, high }, read, write) {
    const label = document.createElement("label"), named = document.createElement("span");
    named.textContent = words(name);
    this.input = Object.assign(document.createElement("input"), { type: "range", min: low, max: high, step: (high - low) / 500, name });
    this.output = document.createElement("output");
    label.append(named, this.input, this.output);
    element("sliders").append(label);
    this.input.addEventListener("input", () => { write(Number(this.input.value)); this.show(); });
    Object.assign(this, { read, unit: raised(unit) });
  }
  show() {
    const value = this.read();
    if (document.activeElement !== this.input) this.input.value = value;
    write(this.output, `${digits(value)} ${this.unit}`);
  }
}
const scrub = RECORD && new Slider(
  { name: "recorded_time", unit: "s", low: 0, high: RECORD.t[RECORD.t.length - 1] }, () => world.time,
  (v) => { for (const plot of plots) plot.clear(); play(v); },
);
if (scrub) sliders.push(scrub);
PLANT.inputs.forEach((slider, k) => sliders.push(new Slider(slider, () => memory.u[k], (v) => { takeOver(); world.free = true; memory.u[k] = v; })));
PLANT.parameters.forEach((slider, k) => sliders.push(new Slider(slider, () => memory.p[k], (v) => { takeOver(); slider.value = v; memory.p[k] = v; })));

let paused = false, slow = false;
function press(id, value) { element(id).setAttribute("aria-pressed", String(value)); }
const pause = () => { paused = !paused; press("pause", paused); };
element("pause").addEventListener("click", pause);
element("slow").addEventListener("click", () => { slow = !slow; press("slow", slow); });
element("reset").addEventListener("click", () => { world.pace = 1; reset(); });
element("take").addEventListener("click", takeOver);

// What depends on whether a record plays, and where it is.
function show() {
  for (const row of sliders) row.show();
  element("take").hidden = world.played < 0;
  if (scrub) scrub.input.disabled = world.played < 0;
}

function place(event) {
  const box = canvas.getBoundingClientRect(), [ox, oy] = world.origin;
  return [(event.clientX - box.left - canvas.clientLeft - ox) / scale, -(event.clientY - box.top - canvas.clientTop - oy) / scale];
}
canvas.addEventListener("pointerdown", (event) => {
  const at = place(event);
  hand = grab(at, 24 / scale);
  if (!hand) return;
  takeOver();
  hand.at = at;
  canvas.setPointerCapture(event.pointerId);
  if (hand.kind === "target") lead(at);
});
canvas.addEventListener("pointermove", (event) => {
  if (!hand) return;
  hand.at = place(event);
  if (hand.kind === "target") lead(hand.at);
});
function lead(to) {
  takeOver();
  Object.assign(world, { target: to, led: true });
}
for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => { hand = null; });

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
document.addEventListener("keydown", (event) => {
  if (event.target instanceof HTMLInputElement || event.target instanceof HTMLButtonElement) return;
  const way = ARROWS[event.key];
  if (way && world.target) {
    lead([world.target[0] + 0.01 * PLANT.length * way[0], world.target[1] + 0.01 * PLANT.length * way[1]]);
  } else if (way && PLANT.inputs.length) {
    takeOver();
    const k = way[0] ? 0 : Math.min(1, PLANT.inputs.length - 1), { low, high } = PLANT.inputs[k];
    world.free = true;
    memory.u[k] = Math.min(high, Math.max(low, memory.u[k] + 0.02 * (high - low) * (way[0] + way[1])));
  } else if (event.key === " ") pause();
  else if (event.key === "r") element("reset").click();
  else if (event.key === "s") element("slow").click();
  else return;
  event.preventDefault();
});

const moves = PLANT.object && (PLANT.object.state !== null || PLANT.object.parameter !== null);
function help() {
  const aims = LOOP && ["tip_x", "tip_y"].every((name) => LOOP.reference.names.includes(name));
  element("help").textContent = [
    RECORD ? "The recorded run plays; whatever is moved takes over from there, Reset plays it again." : "",
    aims ? "Drag the target, or click where the tip should go." : "",
    sliders.length > (RECORD ? 1 : 0) ? "Move the sliders." : "",
    moves ? "Drag the object." : "",
    "Push the finger with the mouse or a finger.",
    "Keys: arrows, space to pause, s for slow motion, r to reset.",
  ].filter(Boolean).join(" ");
}

// ---- time ------------------------------------------------------------------------------------------------------------

const CODES = {
  3: "not solved to its tolerance in this period", 4: "a soft bound is left", 5: "following the previous plan",
  6: "no plan: going to the safe command", 7: "the filter started again", 8: "on its way to a limit",
};
function say(text, bad = false) {
  write(element("state"), text);
  element("state").className = bad ? "bad" : "";
}

let last = null, owed = 0, drawn = 0, counted = 0, rate = 0, written = -Infinity;
const REST = 66; // ms between texts and plots, which are read and not followed: layouts and further canvases cost most
function frame(now) {
  const passed = last === null ? 0 : Math.min(0.1, (now - last) / 1000), pace = slow ? 0.2 : 1;
  last = now;
  if (!paused && world.pace) {
    if (world.played >= 0) play(world.time + passed * pace);
    else compute(passed, pace);
    inputs.add([...memory.u]);
    if (contacts) contacts.add([...memory.normal_force]);
  }
  draw();
  if (now - written >= REST) {
    written = now;
    if (world.pace) tell();
    show();
    for (const plot of plots) plot.draw();
  }
  ++counted;
  if (now - drawn > 1000) { rate = (1000 * counted) / (now - drawn); drawn = now; counted = 0; }
  requestAnimationFrame(frame);
}

function compute(passed, pace) {
  owed += passed * pace;
  const whole = Math.floor(owed / PLANT.step), began = performance.now();
  // What a hand holds moves under it; else the shape need not be known on the way.
  const part = hand && hand.kind === "finger" ? 4 : 16;
  let made = 0;
  // No more than fits into a frame: what is left is lost, and said.
  while (made < whole && world.pace && performance.now() - began < 25) {
    const steps = Math.min(part, whole - made);
    advance(steps);
    made += steps;
  }
  owed = made >= whole ? owed - whole * PLANT.step : 0;
  const real = passed > 0 ? Math.min(1, (made * PLANT.step) / (passed * pace)) : 1;
  world.real = 0.95 * (world.real ?? 1) + 0.05 * real;
  // Clocks of browsers are coarse: the mean of the frame.
  if (made && world.calls) times.add([world.took / world.calls]);
  world.took = world.calls = 0;
}

function tell() {
  const parts = [`${world.time.toFixed(2)} s`];
  if (world.played >= 0) parts.push(world.played < RECORD.t.length - 1 ? "recorded" : "end of the recorded run");
  if (world.target) parts.push(`tip ${(1000 * near(section(memory.section_x.length - 1), ...world.target)).toFixed(1)} mm from the target`);
  if (world.push[2]) parts.push(`hand ${world.push[2].toPrecision(2)} N`);
  if (world.played < 0) {
    if (world.real < 0.9) parts.push(`${Math.round(100 * world.real)} % of real time`);
    if (world.code) parts.push(CODES[world.code] ?? `code ${world.code}`);
  }
  say(parts.join(", "), world.code < 0 || world.code === 6);
}

readColors();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", readColors);
await reset();
help();
// For tests and for those who look: what moves, and what it can be given.
window.page = { world, memory, plant: PLANT, record: RECORD, rate: () => rate, advance, play, takeOver, reset, frame, section, toScreen: (x, y) => {
  const box = canvas.getBoundingClientRect(), [ox, oy] = world.origin;
  return [box.left + canvas.clientLeft + ox + scale * x, box.top + canvas.clientTop + oy - scale * y];
} };
requestAnimationFrame(frame);
