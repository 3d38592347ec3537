const KNOWN = JSON.parse(document.getElementById("known").textContent);
const PLANT = KNOWN.plant, LOOP = KNOWN.controller, RECORD = KNOWN.record, MISSION = LOOP?.mission ?? null;
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
const OBJECT = PLANT.object, ROUGH = PLANT.friction ?? null, moves = OBJECT && (OBJECT.state !== null || OBJECT.parameter !== null);
let controller = null, io = null, fields = null, changes = [];

const world = {
  time: 0, steps: 0, next: 0, code: 0, state: "", past: [], push: [0, 0, 0], target: null, led: false, free: false, pace: 1,
  took: 0, calls: 0, played: RECORD ? 0 : -1, wind: [0, 0], trails: { tip: [], target: [] }, touched: false,
};

function gauss() {
  return Math.sqrt(-2 * Math.log(1 - Math.random())) * Math.cos(2 * Math.PI * Math.random());
}

async function reset() {
  c.restart();
  for (const name of ["x", "u", "p"]) memory[name].set(PLANT.start[name]);
  memory.w.set(PLANT.table.w[0] ?? []);
  Object.assign(world, { time: 0, steps: 0, next: 0, code: 0, past: [], push: [0, 0, 0], free: false, took: 0, calls: 0 });
  Object.assign(world, { led: false, played: RECORD ? 0 : -1, wind: [0, 0], trails: { tip: [], target: [] }, lost: 0 });
  Object.assign(world, { phase: 0, since: 0, opened: null });
  if (LOOP) {
    const finger = await load(await module("controller"));
    controller = MISSION ? finger.new_mission() : finger.new_controller();
    io = controller.direct();
    fields = { measurement: finger.layout("measurement"), reference: MISSION ? null : finger.layout("reference") };
    changes = [...(RECORD?.changes ?? [])];
    LOOP.start = Object.keys(finger.layout(LOOP.starts));
  }
  for (const [k, slider] of PLANT.parameters.entries()) memory.p[k] = slider.value;
  if (ROUGH) memory.p[ROUGH.parameter] = 1;
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
  if (MISSION?.height) {
    const { of, std } = MISSION.height;
    controller.height(Object.entries(of).reduce((sum, [k, share]) => sum + share * memory.x[k], std * gauss()));
  }
  if (!MISSION) aim();
  const before = performance.now();
  world.code = io.call();
  world.took += performance.now() - before;
  ++world.calls;
  if (world.code >= 0) memory.u.set(io.command);
  if (MISSION && controller.phase() !== world.phase) Object.assign(world, { phase: controller.phase(), since: world.time });
}

// Instant by which the scene moves: in a mission that of its plan, in which nothing is waited for.
function planned() {
  if (!MISSION) return world.time;
  const begin = MISSION.begin[world.phase], end = MISSION.begin[world.phase + 1] ?? Infinity;
  return world.opened ?? Math.min(end, begin + world.time - world.since);
}

// Let the object go, lowered first where it was lifted, or at once: then what is below it stays where it is.
function letGo(atOnce) {
  if (atOnce) world.opened = planned();
  atOnce ? controller.abort() : controller.release();
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
  const at = Math.min(planned() / dt, w.length - 1), k = Math.floor(at), share = at - k;
  const between = (rows, i) => rows[k][i] + share * ((rows[k + 1] ?? rows[k])[i] - rows[k][i]);
  for (let i = 0; i < memory.w.length; ++i) memory.w[i] = between(w, i);
  for (let k = 0; k < PLANT.pushes.sections.length; ++k) {
    for (const i of [0, 1]) memory.w[PLANT.pushes.first + 2 * k + i] += world.wind[i] / PLANT.pushes.sections.length;
  }
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
    const o = OBJECT, pose = objectPose();
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
  const o = OBJECT;
  if (o.state !== null) return [memory.x[o.state], memory.x[o.state + 1], memory.x[o.state + 2]];
  if (o.parameter !== null) return [memory.p[o.parameter], memory.p[o.parameter + 1], o.pose[2]];
  return o.pose;
}

const near = (at, x, y) => Math.hypot(at[0] - x, at[1] - y);

function grab(at, reach) {
  if (world.target && near(at, ...world.target) < reach) return { kind: "target" };
  if (moves) {
    const pose = objectPose(), place = [at[0] - pose[0], at[1] - pose[1]];
    const cos = Math.cos(pose[2]), sin = Math.sin(pose[2]);
    const own = [cos * place[0] + sin * place[1], -sin * place[0] + cos * place[1]];
    if (OBJECT.parts.some((part) => inside(part, own))) return { kind: "object", grip: place };
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
const calm = matchMedia("(prefers-reduced-motion: reduce)");
let scale = 1, colors = {};

function readColors() {
  mixed.clear();
  const style = getComputedStyle(document.documentElement);
  for (const name of ["paper", "sheet", "ink", "faint", "line", "finger", "object", "edge", "force", "target", "zone", "support", "second"]) {
    colors[name] = style.getPropertyValue(`--${name}`).trim();
  }
}

// Sizes are asked for when they change: each question would lay out the page anew, texts having been written.
const sizes = new Map(), resized = new ResizeObserver((all) => {
  for (const { target } of all) sizes.set(target, [target.clientWidth, target.clientHeight]);
});

function fit(what) {
  if (!sizes.has(what)) {
    sizes.set(what, [what.clientWidth, what.clientHeight]);
    resized.observe(what);
  }
  const ratio = window.devicePixelRatio || 1, [width, height] = sizes.get(what);
  if (what.width !== Math.round(width * ratio) || what.height !== Math.round(height * ratio)) {
    what.width = Math.round(width * ratio);
    what.height = Math.round(height * ratio);
  }
  return [width, height, ratio];
}

// Finger, object and target fill the canvas; the view follows them, but not while a hand holds something.
const view = { box: null };
function look(passed) {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  const add = (x, y, r = 0) => {
    box[0] = Math.min(box[0], x - r); box[1] = Math.min(box[1], y - r);
    box[2] = Math.max(box[2], x + r); box[3] = Math.max(box[3], y + r);
  };
  for (let k = 0; k < memory.section_x.length; ++k) add(memory.section_x[k], memory.section_y[k], 2 * PLANT.half[k]);
  if (world.target) add(...world.target, 0.06 * PLANT.length);
  for (const part of outlines()) for (const [x, y] of part) add(x, y);
  (memory.normal_force ?? []).forEach((force, k) => {
    if (force < SEEN || PLANT.touches[k] === "table") return;
    add(memory.point_x[k] + 0.25 * PLANT.length * memory.normal_x[k], memory.point_y[k] + 0.25 * PLANT.length * memory.normal_y[k]);
  });
  const edge = 0.08 * PLANT.length, most = 3 * PLANT.length, [x0, y0] = section(0), back = 0.12 * PLANT.length;
  add(x0 + back * Math.sin(memory.section_angle[0]), y0 - back * Math.cos(memory.section_angle[0]));
  const goal = box.map((v, i) => Math.max([x0, y0][i % 2] - most, Math.min([x0, y0][i % 2] + most, v + (i < 2 ? -edge : edge))));
  if (!view.box) view.box = goal;
  if (hand || world.lost || (paused && !view.follows && world.played < 0)) return;
  view.box = view.box.map((v, i) => {
    const grows = i < 2 ? goal[i] < v : goal[i] > v;
    return v + (goal[i] - v) * (1 - Math.exp(-passed / (grows ? 0.15 : 2.5)));
  });
}

// One color in another, which browsers are slow to read.
const mixed = new Map();
function mix(color, share, other = "transparent") {
  const text = `color-mix(in srgb, ${color} ${Math.round(50 * share) * 2}%, ${other})`;
  if (!mixed.has(text)) mixed.set(text, parsed(text));
  return mixed.get(text);
}
function parsed(text) {
  pen.fillStyle = "#000";
  pen.fillStyle = text;
  return pen.fillStyle;
}

// Outlines of the object in the world.
function outlines() {
  if (!OBJECT) return [];
  const [x, y, angle] = objectPose(), cos = Math.cos(angle), sin = Math.sin(angle);
  return OBJECT.parts.map((part) => part.map(([a, b]) => [x + cos * a - sin * b, y + sin * a + cos * b]));
}

// Where a point of the world is on the canvas [px]; a way through several.
const onCanvas = (x, y) => [world.origin[0] + scale * x, world.origin[1] - scale * y];
const line = (...points) => points.forEach((point, k) => pen[k ? "lineTo" : "moveTo"](...point));
function path(points, close) {
  line(...points.map(([x, y]) => onCanvas(x, y)));
  if (close) pen.closePath();
}
const circle = (x, y, radius) => pen.arc(x, y, radius, 0, 2 * Math.PI);

function stroke(color, width, trace, dash = []) {
  pen.strokeStyle = color;
  pen.lineWidth = width;
  pen.setLineDash(dash);
  pen.beginPath();
  trace();
  pen.stroke();
  pen.setLineDash([]);
}

function fill(color, trace) {
  pen.fillStyle = color;
  pen.beginPath();
  trace();
  pen.fill();
}

function draw(passed) {
  const [w, h, ratio] = fit(canvas);
  look(passed);
  const [left, bottom, right, top] = view.box;
  scale = Math.min(w / (right - left), h / (top - bottom));
  world.origin = [0.5 * (w - scale * (right + left)), 0.5 * (h + scale * (top + bottom))];
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, w, h);
  pen.lineJoin = pen.lineCap = "round";
  const far = (w + h) / scale;
  for (const zone of PLANT.zones ?? []) {
    fill(colors.zone, () => {
      if (zone.center) return circle(...onCanvas(...zone.center), scale * zone.radius);
      const [x, y] = zone.point, [a, b] = zone.normal;
      path([[x - far * b, y + far * a], [x + far * b, y - far * a], [x + far * (b - a), y - far * (a + b)], [x - far * (a + b), y + far * (a - b)]], true);
    });
  }
  for (const [x, y, a, b, half] of PLANT.walls ?? []) {
    const d = half > 5 * PLANT.length ? far : 0.08 * PLANT.length;
    fill(mix(colors.support, 0.55), () => path(
      [[x - half * b, y + half * a], [x + half * b, y - half * a], [x + half * b - d * a, y - half * a - d * b], [x - half * b - d * a, y + half * a - d * b]], true));
  }
  for (const [x, y, radius] of PLANT.pegs ?? []) fill(colors.support, () => circle(...onCanvas(x, y), Math.max(3, scale * radius)));
  drawWind(w, h);
  const parts = outlines();
  for (const part of parts) stroke(colors.edge, 4, () => path(part, true));
  for (const part of parts) fill(colors.object, () => path(part, true));
  drawTrails();
  drawPlan();
  drawFinger();
  drawForces();
  if (world.target) {
    const [x, y] = onCanvas(...world.target);
    stroke(colors.target, 2.5, () => {
      circle(x, y, 13);
      line([x - 19, y], [x + 19, y]);
      line([x, y - 19], [x, y + 19]);
    });
  }
  if (!world.touched && !calm.matches) beckon();
  if (hand && hand.at && hand.kind !== "target" && hand.kind !== "wind") {
    const from = hand.kind === "finger" ? pushed(hand.station) : objectPose().slice(0, 2).map((v, i) => v + hand.grip[i]);
    stroke(colors.second, 2.5, () => path([from, hand.at]), [6, 5]);
    if (world.push[2]) label(...onCanvas(...hand.at), `${digits(world.push[2])} N`, colors.second, 16);
  }
  drawHeight(h);
  drawScale(w, h);
}

function label(x, y, text, color, up = 0) {
  pen.font = "600 14px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  const half = 4.2 * text.length + 3; // an outline of text would cost more than all else
  pen.fillStyle = mix(colors.sheet, 0.7);
  pen.fillRect(x - half, y - up - 9, 2 * half, 18);
  pen.fillStyle = color;
  pen.fillText(text, x, y - up);
}

// A ring that spreads from what can be dragged, until something is.
function beckon() {
  const to = world.target ?? (moves ? objectPose() : null);
  if (!to) return;
  const share = (performance.now() / 1600) % 1, color = mix(world.target ? colors.target : colors.edge, 0.8 * (1 - share));
  stroke(color, 3, () => circle(...onCanvas(to[0], to[1]), 16 + 34 * share));
}

// Where tip and target have been.
const LASTED = 2; // s
function drawTrails() {
  for (const [name, color] of [["tip", colors.finger], ["target", colors.target]]) {
    const trail = world.trails[name], now = name === "tip" ? section(memory.section_x.length - 1) : world.target;
    if (now && (!trail.length || world.time > trail[trail.length - 1][0] + 0.02)) trail.push([world.time, ...now]);
    while (trail.length && trail[0][0] < world.time - LASTED) trail.shift();
    for (let part = 0; part < 4; ++part) {
      const points = trail.slice(Math.floor((part * trail.length) / 4), Math.floor(((part + 1) * trail.length) / 4) + 1);
      if (points.length > 1) stroke(mix(color, 0.12 * (part + 1)), 2, () => path(points.map(([, x, y]) => [x, y])));
    }
  }
}

// Have the sections of a node of the plan at hand, which lies in the controller's memory.
function foresee(k) {
  const nx = memory.node.length;
  memory.node.set(new Float64Array(io.command.buffer, controller.address + LOOP.plan[0] + 8 * k * nx, nx));
  c.foresee();
  return [...memory.ahead_x].map((x, i) => [x, memory.ahead_y[i]]);
}

// The plan of the controller: the finger at thirds of its horizon, and the way of the tip.
function drawPlan() {
  if (!controller || world.played >= 0 || !world.calls && !world.time) return;
  const nodes = LOOP.plan[1], last = memory.ahead_x.length - 1, way = [];
  pen.lineCap = "round";
  for (let k = 1; k < nodes; ++k) {
    const third = k % Math.round((nodes - 1) / 3) === 0;
    if (!third && k % 3) continue;
    foresee(k);
    way.push([memory.ahead_x[last], memory.ahead_y[last]]);
    if (third && Number.isFinite(memory.ahead_x[last])) stroke(mix(colors.ink, 0.45 - (0.25 * k) / nodes), 4, () => path(foresee(k)));
  }
  stroke(mix(colors.ink, 0.7), 1.5, () => path(way), [2, 5]);
}

// Place, angle and half thickness at a share of the length: between sections a cubic with their tangents.
function along(share) {
  const last = memory.section_x.length - 1, s = share * last, k = Math.min(last - 1, Math.floor(s)), t = s - k;
  const [x0, y0] = section(k), [x1, y1] = section(k + 1), a0 = memory.section_angle[k], a1 = memory.section_angle[k + 1];
  const chord = Math.hypot(x1 - x0, y1 - y0), p = t * t * (3 - 2 * t), q0 = chord * t * (1 - t) * (1 - t), q1 = chord * t * t * (t - 1);
  return [x0 + p * (x1 - x0) - q0 * Math.sin(a0) - q1 * Math.sin(a1), y0 + p * (y1 - y0) + q0 * Math.cos(a0) + q1 * Math.cos(a1),
    a0 + t * (a1 - a0), PLANT.half[k] + t * (PLANT.half[k + 1] - PLANT.half[k])];
}

// A line at a distance from the center line, with cubics between sections.
function beside(away, first = 0, last = memory.section_x.length - 1, begin = true) {
  const way = Math.sign(last - first) || 1, point = (k) => {
    const a = memory.section_angle[k], [x, y] = section(k);
    return [x - away(k) * Math.cos(a), y - away(k) * Math.sin(a), -Math.sin(a), Math.cos(a)];
  };
  let [x0, y0, a0, b0] = point(first);
  pen[begin ? "moveTo" : "lineTo"](...onCanvas(x0, y0));
  for (let k = first + way; way * k <= way * last; k += way) {
    const [x1, y1, a1, b1] = point(k), chord = (way * Math.hypot(x1 - x0, y1 - y0)) / 3;
    pen.bezierCurveTo(...onCanvas(x0 + chord * a0, y0 + chord * b0), ...onCanvas(x1 - chord * a1, y1 - chord * b1), ...onCanvas(x1, y1));
    [x0, y0, a0, b0] = [x1, y1, a1, b1];
  }
}

function drawFinger() {
  const last = memory.section_x.length - 1, thick = (k) => Math.max(PLANT.half[k], 1.2 / scale);
  const discs = PLANT.discs, links = discs[0] === 0;
  const a = memory.section_angle[0], [x, y] = section(0), w = Math.max(0.06 * PLANT.length, 1.6 * PLANT.half[0]), d = 0.035 * PLANT.length;
  const tx = -Math.sin(a), ty = Math.cos(a), base = [[-w, 0], [w, 0], [w, -d], [-w, -d]];
  fill(colors.faint, () => path(base.map(([across, back]) => [x + across * ty + back * tx, y - across * tx + back * ty]), true));
  fill(discs.length ? mix(colors.finger, 0.28) : colors.finger, () => {
    beside(thick);
    beside((k) => -thick(k), last, 0, false);
    pen.closePath();
  });
  if (discs.length) stroke(colors.finger, Math.max(2.5, 0.12 * scale * PLANT.half[0]), () => beside(() => 0));
  drawTendons();
  const wide = Math.max(4, 0.55 * scale * Math.max(...PLANT.half));
  pen.lineCap = "butt";
  for (let i = 0; i < discs.length; ++i) {
    const [px, py, angle, half] = along(discs[i]), cos = half * Math.cos(angle), sin = half * Math.sin(angle);
    if (links && i) {
      const [qx, qy, turn, other] = along(0.12 * discs[i] + 0.88 * discs[i - 1]), c1 = other * Math.cos(turn), s1 = other * Math.sin(turn);
      fill(mix(colors.finger, 0.75), () => path([[px - cos, py - sin], [px + cos, py + sin], [qx + c1, qy + s1], [qx - c1, qy - s1]], true));
    } else if (!links) stroke(colors.finger, wide, () => path([[px - cos, py - sin], [px + cos, py + sin]]));
  }
  pen.lineCap = "round";
  for (const [share, mass] of PLANT.masses) if (mass) fill(colors.ink, () => circle(...onCanvas(...along(share)), 5));
}

// Tendons are the redder and thicker the more they pull.
function drawTendons() {
  PLANT.tendons.forEach((tendon, k) => {
    const share = Math.max(0, Math.min(1, memory.tension[k] / tendon.most));
    const color = mix(colors.force, Math.sqrt(share), colors.faint);
    stroke(color, 1.5 + 5 * share, () => beside((i) => tendon.offset[i], 0, tendon.offset.length - 1));
    const a = memory.section_angle[0], [x, y] = section(0), e = Math.sign(tendon.offset[0]);
    const out = e * Math.max(tendon.offset[0] * e, 34 / scale), back = 0.035 * PLANT.length + 26 / scale;
    const place = onCanvas(x - out * Math.cos(a) + back * Math.sin(a), y - out * Math.sin(a) - back * Math.cos(a));
    if (PLANT.tendons.length < 3) label(...place, `${memory.tension[k].toFixed(1)} N`, color);
  });
}

// The wind is a vector that is dragged from the circle in the corner.
const WIND = 32; // px
const corner = () => [sizes.get(canvas)[0] - WIND - 30, WIND + 14];
function drawWind(w, h) {
  const [x, y] = corner(), most = PLANT.pushes.most, [wx, wy] = world.wind, size = Math.hypot(wx, wy);
  if (size > 0.02 * most) {
    const share = size / most, [dx, dy] = [wx / size, -wy / size], long = 26 + 50 * share, moved = calm.matches ? 0 : 0.5 * world.time * (0.3 + share);
    stroke(mix(colors.second, 0.15 + 0.3 * share), 1.5, () => {
      for (let k = 0; k < 26; ++k) {
        const sx = (((k * 0.618 + moved * dx) % 1) + 1) % 1, sy = (((k * 0.381 + 0.07 * k + moved * dy) % 1) + 1) % 1;
        line([sx * w, sy * h], [sx * w + long * dx, sy * h + long * dy]);
      }
    });
  }
  const end = [x + (WIND * wx) / most, y - (WIND * wy) / most];
  stroke(colors.second, 1.5, () => circle(x, y, WIND), [3, 4]);
  stroke(colors.second, 4, () => line([x, y], end));
  fill(colors.second, () => circle(...end, 7));
  label(x, y + WIND + 12, size > 0.02 * most ? `wind ${digits(size)} N` : "drag the wind", colors.second);
}

// An object that stands on nothing is seen from the side too.
function drawHeight(h) {
  if (!OBJECT || OBJECT.height === null || !(world.sunk > 1e-3)) return;
  const x = 14, y = h - 96, per = 2.2; // px per mm, but no more than the frame
  const frame = () => pen.rect(x, y, 92, 82), object = () => pen.rect(x + 30, y + 8 + Math.min(46, per * 1000 * world.sunk), 34, 30);
  fill(mix(colors.paper, 0.85), frame);
  stroke(colors.line, 1, frame);
  fill(colors.object, object);
  stroke(colors.edge, 2, object);
  stroke(colors.finger, 5, () => line([x + 18, y + 22], [x + 70, y + 22]));
  label(x + 46, y + 72, `${digits(1000 * world.sunk)} mm`, colors.ink);
}

// A length of one, two or five, as long as a fifth of the canvas at most.
function drawScale(w, h) {
  const most = (0.2 * w) / scale, power = 10 ** Math.floor(Math.log10(most));
  const length = power * (most >= 5 * power ? 5 : most >= 2 * power ? 2 : 1), x = w - 12, y = h - 12;
  stroke(colors.faint, 1.5, () => line([x - scale * length, y - 5], [x - scale * length, y], [x, y], [x, y - 5]));
  pen.fillStyle = colors.faint;
  pen.font = "13px system-ui, sans-serif";
  pen.textAlign = "right";
  pen.textBaseline = "alphabetic";
  pen.fillText(`${digits(1000 * length)} mm`, x, y - 9);
}

// Forces on the object at its contacts, each in its friction cone.
const limit = (k) => ROUGH.of[k] * memory.p[ROUGH.parameter];
const used = (k) => Math.hypot(memory.friction[k], memory.lift[k]) / Math.max(limit(k) * memory.normal_force[k], 1e-9);
const SEEN = 0.02; // N
// What moves by less than a pixel in a second is seen to rest, though it may bear all of its friction.
const slips = (k) => used(k) > 0.98 && memory.slip[k] * scale > 1;
function drawForces() {
  if (!memory.force_x) return;
  world.unit = Math.max(0.97 * (world.unit ?? 0), 4 * PLANT.pushes.most, ...memory.normal_force);
  PLANT.touches.forEach((name, k) => {
    const fx = memory.force_x[k], fy = memory.force_y[k], size = Math.hypot(fx, fy);
    if (name === "table" || memory.normal_force[k] < SEEN) return;
    const reach = 0.24 * PLANT.length * scale * Math.min(size / world.unit, 1.2), slipping = slips(k);
    const [x, y] = onCanvas(memory.point_x[k], memory.point_y[k]), color = slipping ? colors.second : colors.force;
    const out = Math.atan2(-memory.normal_y[k], memory.normal_x[k]), half = Math.atan(limit(k)), turn = Math.atan2(-fy, fx);
    const back = (long, angle = turn) => [x - long * Math.cos(angle), y - long * Math.sin(angle)], tail = back(reach);
    fill(mix(color, slipping ? 0.35 : 0.16), () => {
      pen.moveTo(x, y);
      pen.arc(x, y, reach + 12, out - half, out + half);
      pen.closePath();
    });
    stroke(color, 3.5, () => line(tail, back(8)));
    fill(color, () => line([x, y], back(14, turn - 0.42), back(14, turn + 0.42)));
    label(tail[0] - 24 * Math.cos(turn), tail[1] - 16 * Math.sin(turn), `${size.toFixed(1)} N`, color);
  });
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
    const [w, h, ratio] = fit(this.canvas), p = this.canvas.getContext("2d");
    if (!w) return;
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
const contacts = PLANT.touches.length ? new Plot("Normal force at each contact (arrows: with friction)", "N", PLANT.touches) : null;
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
    label.dataset.name = name;
    label.append(named, this.input, this.output);
    element("sliders").append(label);
    this.input.addEventListener("input", () => { write(Number(this.input.value)); this.show(); });
    Object.assign(this, { read, label, unit: raised(unit) });
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
if (ROUGH) {
  sliders.push(new Slider({ name: "friction", unit: "", low: 0.05, high: 1 }, () => ROUGH.law * memory.p[ROUGH.parameter], (v) => {
    takeOver();
    memory.p[ROUGH.parameter] = v / ROUGH.law;
  }));
}
const most = PLANT.pushes.most;
sliders.push(new Slider({ name: "wind", unit: "N", low: -most, high: most }, () => world.wind[0], (v) => {
  takeOver();
  world.wind = [v, 0];
}));
PLANT.parameters.forEach((slider, k) => sliders.push(new Slider(slider, () => memory.p[k], (v) => { takeOver(); slider.value = v; memory.p[k] = v; })));

let paused = false, slow = false;
function press(id, value) { element(id).setAttribute("aria-pressed", String(value)); }
const pause = () => { paused = !paused; press("pause", paused); };
element("pause").addEventListener("click", pause);
element("slow").addEventListener("click", () => { slow = !slow; press("slow", slow); });
element("reset").addEventListener("click", () => { world.pace = 1; reset(); });
element("take").addEventListener("click", takeOver);
for (const [id, atOnce] of [["lower", false], ["open", true]]) {
  element(id).hidden = !MISSION;
  element(id).addEventListener("click", () => letGo(atOnce));
}

// What depends on whether a record plays, and where it is.
function show() {
  for (const row of sliders) row.show();
  element("take").hidden = world.played < 0;
  if (scrub) scrub.label.hidden = world.played < 0;
}

function place(event) {
  const box = canvas.getBoundingClientRect(), [ox, oy] = world.origin;
  return [(event.clientX - box.left - canvas.clientLeft - ox) / scale, -(event.clientY - box.top - canvas.clientTop - oy) / scale];
}
canvas.addEventListener("pointerdown", (event) => {
  const at = place(event);
  hand = inWind(event) ? { kind: "wind" } : grab(at, 24 / scale);
  if (!hand) return;
  takeOver();
  world.touched = true;
  if (hand.kind === "wind") blow(event);
  hand.at = at;
  canvas.setPointerCapture(event.pointerId);
  if (hand.kind === "target") lead(at);
});
canvas.addEventListener("pointermove", (event) => {
  if (!hand) return;
  hand.at = place(event);
  if (hand.kind === "target") lead(hand.at);
  if (hand.kind === "wind") blow(event);
});

// The wind's circle, on the screen.
function fromCorner(event) {
  const box = canvas.getBoundingClientRect(), [x, y] = corner();
  return [event.clientX - box.left - canvas.clientLeft - x, event.clientY - box.top - canvas.clientTop - y];
}
const inWind = (event) => Math.hypot(...fromCorner(event)) < WIND + 8;
function blow(event) {
  const [x, y] = fromCorner(event), size = Math.hypot(x, y), share = size < 6 ? 0 : most / Math.max(size, WIND);
  world.wind = [share * x, -share * y];
}

function lead(to) {
  takeOver();
  world.touched = true;
  Object.assign(world, { target: to, led: true });
}
for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => { hand = null; });
document.addEventListener("keyup", (event) => { if (event.key in ARROWS) hand = null; });

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
  } else if (way && moves) {
    takeOver();
    const pose = objectPose();
    hand = { kind: "object", grip: [0, 0], at: [pose[0] + 0.02 * way[0], pose[1] + 0.02 * way[1]] };
  } else if (event.key === " ") pause();
  else if (event.key === "r") element("reset").click();
  else if (event.key === "s") element("slow").click();
  else return;
  event.preventDefault();
});

const aims = LOOP && ["tip_x", "tip_y"].every((name) => LOOP.reference.names.includes(name));
const thing = document.title.match(/mug|cup|bottle|jar|bar|post|block|flask|disc/i)?.[0].toLowerCase() ?? "object";
function help() {
  element("call").textContent = `${aims ? "Drag the target" : moves ? `Drag the ${thing}` : "Push the finger"}, drag the wind${ROUGH ? ", lower the friction" : ""}.`;
  element("help").textContent = [
    RECORD ? "The recorded run plays; whatever is moved takes over from there, Reset plays it again." : "",
    MISSION ? `The mission begins by itself, and anew by Reset. Let go lowers the ${thing} first, Open now does not.` : "",
    aims ? "Drag the target, or click where the tip should go." : "",
    moves ? `Drag the ${thing}.` : "",
    "Push the finger, drag the wind in its circle, move the sliders.",
    controller || LOOP ? "The pale fingers are the plan, a third, two thirds and the whole of the horizon ahead." : "",
    PLANT.tendons.length ? "Tendons are the redder and thicker the more they pull." : "",
    ROUGH ? "Arrows are the whole force at each contact, normal force and friction together, in its friction cone; one that slips has another color." : "",
    `Keys: arrows move ${aims ? "the target" : PLANT.inputs.length ? "the first inputs" : `the ${thing}`}, space pauses, s is slow motion, r resets.`,
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
    move(passed * pace, () => compute(passed, pace));
    if (world.lost && now - world.lost > 2500) reset();
    inputs.add([...memory.u]);
    if (contacts) contacts.add([...memory.normal_force]);
  }
  draw(passed);
  if (now - written >= REST) {
    written = now;
    if (world.pace) tell();
    show();
    for (const plot of plots) plot.draw();
  }
  ++counted;
  if (now - drawn > 1000) {
    describe(); rate = (1000 * counted) / (now - drawn); drawn = now; counted = 0; }
  requestAnimationFrame(frame);
}

// Go on by a time, by the record or by computation.
function move(seconds, computing) {
  if (world.played >= 0) play(world.time + seconds);
  else computing();
}

// For pictures: as much of the world's time, whatever it takes.
function tick(seconds) {
  move(seconds, () => advance(Math.round(seconds / PLANT.step)));
  view.follows = true;
  draw(seconds);
  view.follows = false;
  tell();
  describe();
  show();
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
  if (MISSION) parts.push(words(MISSION.phases[world.phase]));
  if (world.played >= 0) parts.push(world.played < RECORD.t.length - 1 ? "recorded" : "end of the recorded run");
  if (world.target) parts.push(`tip ${(1000 * near(section(memory.section_x.length - 1), ...world.target)).toFixed(1)} mm from the target`);
  if (world.push[2]) parts.push(`hand ${world.push[2].toPrecision(2)} N`);
  if (world.played < 0) {
    if (world.real < 0.9) parts.push(`${Math.round(100 * world.real)} % of real time`);
    if (world.code) parts.push(CODES[world.code] ?? `code ${world.code}`);
  }
  say(parts.join(", "), world.code < 0 || world.code === 6);
  if (world.played < 0) notice();
}

// What stands out is said once, on the canvas and to screen readers.
let still = 0, mean = null;
function notice() {
  const found = [], tip = section(memory.section_x.length - 1);
  if (OBJECT) {
    const pose = objectPose(), height = OBJECT.height === null ? 0 : memory.x[OBJECT.height];
    world.sunk = (OBJECT.height === null ? 0 : PLANT.start.x[OBJECT.height]) - height;
    if (OBJECT.state !== null && (world.sunk > 0.03 || near(pose, ...PLANT.start.x.slice(OBJECT.state, OBJECT.state + 2)) > 0.6 * PLANT.length)) {
      world.lost ||= performance.now();
      found.push(`The ${thing} is lost.`);
    } else if (world.sunk > 1e-3) found.push(`The ${thing} slips.`);
    else {
      const slipping = PLANT.touches.filter((name, k) => name !== "table" && memory.normal_force[k] > SEEN && slips(k));
      if (slipping.length) found.push(`${slipping.map(words).join(" and ")} ${slipping.length > 1 ? "slip" : "slips"}.`);
    }
  }
  if (LOOP) {
    memory.u.forEach((value, k) => {
      if (LOOP.high[k] < 1e29 && value > LOOP.high[k] - 2e-3 * Math.abs(LOOP.high[k])) {
        found.push(`${words(PLANT.input_names[k].split(" ")[0])} is at its limit of ${digits(LOOP.high[k])} ${unitOf(PLANT.input_names[k])}.`);
      }
    });
    // A camera's noise lets the tip tremble: it rests where it stays near its own mean.
    mean = mean ? mean.map((v, i) => v + 0.2 * (tip[i] - v)) : tip;
    still = world.target && near(tip, ...mean) < 0.01 * PLANT.length && !(hand && hand.kind === "finger") ? still + 1 : 0;
    const away = world.target ? near(tip, ...world.target) : 0;
    if (still > 8 && away > 0.025 * PLANT.length) found.push(`Out of reach: ${digits(1000 * away)} mm short.`);
  }
  const text = found.join(" ");
  element("note").hidden = !text;
  write(element("note"), text);
  write(element("said"), text);
}

// The picture in words, for those who do not see it.
function describe() {
  const last = memory.section_x.length - 1, bend = (180 / Math.PI) * (memory.section_angle[last] - memory.section_angle[0]);
  const parts = [`A finger, bent by ${Math.abs(bend).toFixed(0)} degrees to the ${bend > 0 ? "left" : "right"} of its base`];
  PLANT.tendons.forEach((_, k) => parts.push(`tendon ${k + 1} pulls with ${digits(memory.tension[k])} newtons`));
  if (world.target) parts.push(`the tip is ${(1000 * near(section(last), ...world.target)).toFixed(0)} millimeters from the target`);
  (memory.normal_force ?? []).forEach((force, k) => {
    if (force > SEEN) parts.push(`${words(PLANT.touches[k])} presses with ${digits(force)} newtons`);
  });
  canvas.setAttribute("aria-label", `${parts.join("; ")}.`);
}

readColors();
if (window.parent !== window) document.body.classList.add("embedded");
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", readColors);
await reset();
help();
// For tests and for those who look: what moves, and what it can be given.
window.page = { world, memory, plant: PLANT, record: RECORD, rate: () => rate, advance, play, takeOver, reset, tick, foresee, section, used, controller: LOOP, toScreen: (x, y) => {
  const box = canvas.getBoundingClientRect(), [left, top] = onCanvas(x, y);
  return [box.left + canvas.clientLeft + left, box.top + canvas.clientTop + top];
} };
requestAnimationFrame(frame);
