// The grasp of a hand in space: tubes, a surface and arrows, drawn by WebGL. Lengths in millimeters, z is up.
const known = JSON.parse(document.getElementById("known").textContent);
const canvas = document.getElementById("world"), labels = document.getElementById("labels"), note = document.getElementById("note");
const gl = canvas.getContext("webgl", { antialias: true, preserveDrawingBuffer: true });
const COLORS = [[0.25, 0.5, 0.8], [0.16, 0.6, 0.42], [0.8, 0.42, 0.2], [0.55, 0.38, 0.7], [0.2, 0.6, 0.66], [0.68, 0.58, 0.2]];
const OBJECT = [0.85, 0.68, 0.42], SLIPS = [0.82, 0.2, 0.13], BASE = [0.5, 0.54, 0.58];
const AROUND = 20; // points around a tube

const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
const flat = new Float32Array(bytes(known.object.corners)), corners = Array.from({ length: flat.length / 3 }, (_, k) => [...flat.slice(3 * k, 3 * k + 3)]);
const triangles = known.object.wide ? new Uint32Array(bytes(known.object.triangles)) : new Uint16Array(bytes(known.object.triangles));

const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scaled = (a, s) => [s * a[0], s * a[1], s * a[2]];
const unit = (a) => scaled(a, 1 / (Math.hypot(...a) || 1));

// -- the state: tensions as shares of those of the grasp, and what follows to first order

const shares = known.tensions.map(() => 1);
let all = 1;

function changes() { // of all tensions [N], by finger
  return known.tensions.flatMap((pair, k) => pair.map((tension) => (all * shares[k] - 1) * tension));
}
const linear = (row, by) => row.reduce((sum, value, j) => sum + value * by[j], 0);
const moved = (point, rows, by) => rows === null ? point : point.map((v, j) => v + linear(rows[j], by));

function carried(point, by) { // a point of the object, by its shift and its turn
  if (known.pose === null) return point;
  const [x, y, z, a, b, c] = known.pose.map((row) => linear(row, by)), angle = Math.hypot(a, b, c);
  const arm = add(point, known.center, -1), axis = unit([a, b, c]);
  const turned = add(add(scaled(arm, Math.cos(angle)), cross(axis, arm), Math.sin(angle)), axis, (1 - Math.cos(angle)) * dot(axis, arm));
  return add(add(known.center, turned), [x, y, z]);
}

function carriedBody(by) {
  const places = corners.map((p) => carried(p, by));
  return { positions: places.flat(), normals: corners.flatMap((p, k) => add(carried(add(p, still[k]), by), places[k], -1)), indices: triangles };
}

function contacts(by) {
  return known.contacts.map((contact) => {
    const force = moved(contact.force, contact.changes, by), press = dot(force, contact.normal);
    const aside = Math.hypot(...add(force, contact.normal, -press));
    const cone = press > 0 ? aside / (contact.friction * press) : Infinity;
    return { ...contact, force, press, aside, cone, slips: cone > 1, at: carried(contact.at, by) };
  });
}

// -- meshes: positions, normals and indices

function grid(rows, closed = false) { // of rows of points, with normals of the surface
  const n = rows[0].length, normals = rows.map((row) => row.map(() => [0, 0, 0])), indices = [];
  const last = closed ? n : n - 1;
  for (let i = 0; i + 1 < rows.length; i++)
    for (let j = 0; j < last; j++) {
      const k = (j + 1) % n, [a, b, c, d] = [rows[i][j], rows[i + 1][j], rows[i + 1][k], rows[i][k]];
      const normal = cross(add(c, a, -1), add(d, b, -1));
      for (const [p, q] of [[i, j], [i + 1, j], [i + 1, k], [i, k]]) normals[p][q] = add(normals[p][q], normal);
      const at = (p, q) => p * n + q;
      indices.push(at(i, j), at(i + 1, j), at(i + 1, k), at(i, j), at(i + 1, k), at(i, k));
    }
  return { positions: rows.flat(2), normals: normals.flat().flatMap(unit), indices };
}

function smooth(corners, indices) { // normals: corners that lie at one place share theirs
  const sums = new Map(), key = (p) => p.map((v) => v.toFixed(2)).join();
  for (let k = 0; k < indices.length; k += 3) {
    const [a, b, c] = [0, 1, 2].map((j) => corners[indices[k + j]]), normal = cross(add(b, a, -1), add(c, a, -1));
    for (const p of [a, b, c]) sums.set(key(p), add(sums.get(key(p)) || [0, 0, 0], normal));
  }
  return corners.map((p) => unit(sums.get(key(p)) || [0, 0, 1]));
}
const still = smooth(corners, triangles); // normals of the object in the grasp

function tube(points, radii, tangents) { // around a line, along which the frame is carried without twist
  let across = unit(cross(tangents[0], Math.abs(tangents[0][2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));
  return grid(points.map((point, k) => {
    const t = tangents[k];
    across = unit(add(across, t, -dot(across, t)));
    const other = cross(t, across);
    return Array.from({ length: AROUND }, (_, j) => {
      const turn = 2 * Math.PI * j / AROUND;
      return add(add(point, across, radii[k] * Math.cos(turn)), other, radii[k] * Math.sin(turn));
    });
  }), true);
}

function finger(points, thick) { // a tube with a flat base and a round end, with half its thickness at each point
  const tangents = points.map((_, k) => unit(add(points[Math.min(k + 1, points.length - 1)], points[Math.max(k - 1, 0)], -1)));
  const line = [points[0], ...points], radii = [0, ...thick], along = [tangents[0], ...tangents];
  for (let k = 1; k <= 8; k++) {
    const turn = k * Math.PI / 16, end = tangents[tangents.length - 1], radius = thick[thick.length - 1];
    line.push(add(points[points.length - 1], end, radius * Math.sin(turn)));
    radii.push(radius * Math.cos(turn));
    along.push(end);
  }
  return tube(line, radii, along);
}

function arrow(tip, force, thick) { // that ends at its tip
  const length = known.arrow * Math.hypot(...force), way = unit(force), head = Math.min(0.5 * length, 5 * thick);
  const places = [-length, -length, -head, -head, 0], radii = [0, thick, thick, 2.4 * thick, 0];
  return tube(places.map((s) => add(tip, way, s)), radii, places.map(() => way));
}

function disc(center, normal, radius, thick) { // of a palm or a table, behind its surface
  const places = [0, 0, -thick, -thick].map((s) => add(center, normal, s));
  return tube(places, [0, radius, radius, 0], places.map(() => normal));
}

function plate(points, radius) { // what carries the bases: a sheet through them
  const middle = scaled(points.reduce((sum, p) => add(sum, p)), 1 / points.length);
  if (points.length < 3) return null;
  const normal = unit(points.reduce((sum, p, k) => add(sum, cross(add(p, middle, -1), add(points[(k + 1) % points.length], middle, -1))), [0, 0, 0]));
  const rim = points.map((p) => add(p, unit(add(p, middle, -1)), 1.2 * radius)), low = add(middle, normal, 0), high = add(middle, normal, 0.5 * radius);
  const raised = rim.map((p) => add(p, normal, 0.5 * radius));
  return grid([rim.map(() => low), rim, raised, rim.map(() => high)].map((row) => [...row, row[0]]));
}

// -- drawing

const SHADERS = [`
attribute vec3 position, normal; uniform mat4 view, projection; varying vec3 n, p;
void main() { vec4 at = view * vec4(position, 1.0); n = mat3(view) * normal; p = at.xyz; gl_Position = projection * at; }`, `
precision mediump float; uniform vec3 color; uniform float alpha; varying vec3 n, p;
void main() {
  vec3 m = normalize(n), eye = normalize(-p); if (dot(m, eye) < 0.0) m = -m;
  float light = 0.5 + 0.4 * max(dot(m, normalize(vec3(-0.4, 0.7, 0.6))), 0.0) + 0.16 * max(dot(m, normalize(vec3(0.7, -0.1, 0.5))), 0.0);
  float gloss = pow(max(dot(reflect(-normalize(vec3(-0.4, 0.7, 0.6)), m), eye), 0.0), 24.0);
  gl_FragColor = vec4(color * light + 0.08 * gloss, alpha + (1.0 - alpha) * 0.6 * pow(1.0 - abs(dot(m, eye)), 3.0));
}`];
let program, places;
const dark = matchMedia("(prefers-color-scheme: dark)");

function prepare() {
  program = gl.createProgram();
  [gl.VERTEX_SHADER, gl.FRAGMENT_SHADER].forEach((kind, k) => {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, SHADERS[k]);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  });
  gl.linkProgram(program);
  gl.useProgram(program);
  places = { position: gl.getAttribLocation(program, "position"), normal: gl.getAttribLocation(program, "normal") };
  for (const name of ["view", "projection", "color", "alpha"]) places[name] = gl.getUniformLocation(program, name);
  gl.enable(gl.DEPTH_TEST);
  gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
}

const wide = gl && gl.getExtension("OES_element_index_uint"); // meshes of more than 65,536 corners
function buffered(mesh, color, alpha = 1) {
  const buffer = (target, data) => { const made = gl.createBuffer(); gl.bindBuffer(target, made); gl.bufferData(target, data, gl.STATIC_DRAW); return made; };
  return { color, alpha, count: mesh.indices.length,
    position: buffer(gl.ARRAY_BUFFER, new Float32Array(mesh.positions)), normal: buffer(gl.ARRAY_BUFFER, new Float32Array(mesh.normals)),
    indices: buffer(gl.ELEMENT_ARRAY_BUFFER, new (wide ? Uint32Array : Uint16Array)(mesh.indices)) };
}

let bodies = [], shown = [], through = true, labeled = true;

function build() {
  for (const body of bodies) for (const name of ["position", "normal", "indices"]) gl.deleteBuffer(body[name]);
  const ink = dark.matches ? [0.95, 0.96, 0.98] : [0.12, 0.13, 0.16]; // of arrows, by the paper
  const by = changes(), radius = Math.max(...known.fingers.flatMap((f) => f.radii));
  shown = contacts(by);
  bodies = known.fingers.map((f, k) => buffered(
    finger(f.points.map((point, i) => moved(point, f.changes === null ? null : f.changes[i], by)), f.radii), COLORS[k % COLORS.length]));
  const base = plate(known.fingers.map((f) => f.points[0]), radius);
  if (base && !known.supports.length) bodies.push(buffered(base, BASE));
  bodies.push(buffered(carriedBody(by), OBJECT, through ? 0.55 : 1));
  for (const support of known.supports) bodies.push(buffered(disc(support.center, support.normal, support.radius, 0.5 * radius), BASE, 0.4));
  for (const c of labeled ? shown : []) bodies.push({ ...buffered(arrow(c.at, scaled(c.force, -1), 0.16 * radius), c.slips ? SLIPS : ink), above: true });
  tell();
  requestAnimationFrame(draw);
}

// -- the camera: around a place, by two angles and a distance

const points = [...known.fingers.flatMap((f) => f.points), ...corners, ...known.supports.map((s) => s.center)];
const bound = (of) => points.reduce((sum, p) => p.map((v, j) => of(v, sum[j]))), low = bound(Math.min), high = bound(Math.max);
const START = { around: -0.9, up: 0.3, size: 0.52 * Math.hypot(...add(high, low, -1)), at: scaled(add(low, high), 0.5) };
let camera = { ...START };

function axes() {
  const [c, s, u, v] = [Math.cos(camera.around), Math.sin(camera.around), Math.cos(camera.up), Math.sin(camera.up)];
  return { right: [-s, c, 0], top: [-v * c, -v * s, u], back: [u * c, u * s, v] };
}

function views() {
  const { right, top, back } = axes(), wide = canvas.clientWidth / Math.max(canvas.clientHeight, 1);
  const angle = 0.26, far = camera.size / Math.tan(angle) / Math.min(wide, 1), eye = add(camera.at, back, far);
  const view = [right[0], top[0], back[0], 0, right[1], top[1], back[1], 0, right[2], top[2], back[2], 0, -dot(right, eye), -dot(top, eye), -dot(back, eye), 1];
  const f = 1 / Math.tan(angle), near = 0.05 * far, end = far + 20 * START.size;
  return { view, projection: [f / wide, 0, 0, 0, 0, f, 0, 0, 0, 0, (end + near) / (near - end), -1, 0, 0, 2 * end * near / (near - end), 0], far, angle };
}

function draw() {
  const ratio = Math.min(window.devicePixelRatio || 1, 2), { view, projection } = views();
  canvas.width = Math.round(canvas.clientWidth * ratio);
  canvas.height = Math.round(canvas.clientHeight * ratio);
  gl.viewport(0, 0, canvas.width, canvas.height);
  gl.clearColor(0, 0, 0, 0);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  gl.uniformMatrix4fv(places.view, false, view);
  gl.uniformMatrix4fv(places.projection, false, projection);
  for (const body of bodies) {
    gl[body.alpha < 1 ? "enable" : "disable"](gl.BLEND);
    gl.depthMask(body.alpha === 1);
    for (const name of ["position", "normal"]) {
      gl.bindBuffer(gl.ARRAY_BUFFER, body[name]);
      gl.enableVertexAttribArray(places[name]);
      gl.vertexAttribPointer(places[name], 3, gl.FLOAT, false, 0, 0);
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, body.indices);
    gl.uniform3fv(places.color, body.color);
    gl.uniform1f(places.alpha, body.alpha);
    if (body.above) { // seen through what is before it, too
      gl.enable(gl.BLEND);
      gl.depthFunc(gl.GREATER);
      gl.depthMask(false);
      gl.uniform1f(places.alpha, 0.4);
      gl.drawElements(gl.TRIANGLES, body.count, wide ? gl.UNSIGNED_INT : gl.UNSIGNED_SHORT, 0);
      gl.disable(gl.BLEND);
      gl.depthFunc(gl.LESS);
      gl.depthMask(true);
      gl.uniform1f(places.alpha, 1);
    }
    if (body.alpha < 1) { // what is behind first
      gl.enable(gl.CULL_FACE);
      for (const side of [gl.FRONT, gl.BACK]) { gl.cullFace(side); gl.drawElements(gl.TRIANGLES, body.count, wide ? gl.UNSIGNED_INT : gl.UNSIGNED_SHORT, 0); }
      gl.disable(gl.CULL_FACE);
    } else gl.drawElements(gl.TRIANGLES, body.count, wide ? gl.UNSIGNED_INT : gl.UNSIGNED_SHORT, 0);
  }
  gl.depthMask(true);
  const texts = labeled ? shown : [];
  while (labels.children.length > texts.length) labels.lastChild.remove();
  texts.forEach((contact, k) => {
    const label = labels.children[k] || labels.appendChild(document.createElement("span"));
    const tail = add(contact.at, contact.force, known.arrow), [x, y] = projected(tail, view, projection);
    label.textContent = `${contact.press.toFixed(2)} N`;
    label.classList.toggle("slips", contact.slips);
    label.style.left = `${x}px`;
    label.style.top = `${y}px`;
  });
}

function projected(point, view, projection) {
  const times = (m, v) => [0, 1, 2, 3].map((i) => m[i] * v[0] + m[4 + i] * v[1] + m[8 + i] * v[2] + m[12 + i] * v[3]);
  const [x, y, , w] = times(projection, times(view, [...point, 1]));
  return [0.5 * (1 + x / w) * canvas.clientWidth, 0.5 * (1 - y / w) * canvas.clientHeight];
}

// -- words

function tell() {
  const rows = document.querySelectorAll("#contacts tbody tr");
  shown.forEach((contact, k) => {
    const cells = rows[k].children, finger = known.fingers.findIndex((f) => contact.name.startsWith(`${f.name}.`));
    cells[0].style.setProperty("--own", `rgb(${(finger < 0 ? BASE : COLORS[finger % COLORS.length]).map((v) => Math.round(255 * v))})`);
    cells[1].textContent = contact.press.toFixed(3);
    cells[2].textContent = contact.aside.toFixed(3);
    cells[3].textContent = Number.isFinite(contact.cone) ? `${(100 * contact.cone).toFixed(0)} %` : "off";
    for (const cell of cells) cell.classList.toggle("slips", contact.slips);
  });
  const lost = shown.filter((contact) => contact.slips).map((contact) => contact.name);
  document.getElementById("state").textContent = lost.length ? `At these tensions ${lost.join(" and ")} would slip.` : "";
  document.getElementById("state").classList.toggle("bad", lost.length > 0);
}

function sliders() {
  const box = document.getElementById("sliders");
  if (!box) return;
  const slider = (name, total, set) => {
    const label = document.createElement("label"), text = document.createElement("span"), input = document.createElement("input"), out = document.createElement("output");
    Object.assign(input, { type: "range", min: 1 - known.span, max: 1 + known.span, step: 0.005, value: 1 });
    text.textContent = name;
    const show = () => { out.textContent = `${(total() * Number(input.value)).toFixed(2)} N`; };
    input.addEventListener("input", () => { set(Number(input.value)); update(); });
    label.append(text, input, out);
    box.append(label);
    return { input, show, set };
  };
  const sum = (pair) => pair.reduce((a, b) => a + b, 0);
  const made = [slider("all tensions", () => known.tensions.reduce((total, pair, k) => total + shares[k] * sum(pair), 0), (v) => { all = v; }),
    ...known.tensions.map((pair, k) => slider(known.fingers[k].name, () => all * sum(pair), (v) => { shares[k] = v; }))];
  const update = () => { made.forEach((one) => one.show()); build(); };
  made.forEach((one) => one.show());
  return () => { made.forEach((one) => { one.input.value = 1; one.set(1); }); update(); };
}

// -- hands on

function turn(dx, dy) {
  camera.around -= 0.008 * dx;
  camera.up = Math.min(Math.max(camera.up + 0.008 * dy, -1.5), 1.5);
}
function shift(dx, dy) {
  const { right, top } = axes(), { far, angle } = views(), scale = 2 * far * Math.tan(angle) / canvas.clientHeight;
  camera.at = add(add(camera.at, right, -dx * scale), top, dy * scale);
}
function zoom(factor) { camera.size = Math.min(Math.max(camera.size * factor, 0.1 * START.size), 4 * START.size); }

const held = new Map();
canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); held.set(event.pointerId, [event.clientX, event.clientY]); });
for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => held.delete(event.pointerId));
canvas.addEventListener("pointermove", (event) => {
  const before = held.get(event.pointerId);
  if (!before) return;
  const apart = () => { const [a, b] = [...held.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
  const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]], wide = held.size === 2 ? apart() : 0;
  held.set(event.pointerId, [event.clientX, event.clientY]);
  if (held.size === 2) { zoom(wide / Math.max(apart(), 1)); shift(0.5 * dx, 0.5 * dy); }
  else if (event.buttons & 2 || event.shiftKey) shift(dx, dy);
  else turn(dx, dy);
  requestAnimationFrame(draw);
});
canvas.addEventListener("contextmenu", (event) => event.preventDefault());
canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoom(Math.exp(0.001 * event.deltaY)); requestAnimationFrame(draw); }, { passive: false });
canvas.addEventListener("keydown", (event) => {
  const does = { ArrowLeft: () => turn(-12, 0), ArrowRight: () => turn(12, 0), ArrowUp: () => turn(0, -12), ArrowDown: () => turn(0, 12), "+": () => zoom(0.9), "-": () => zoom(1.1) }[event.key];
  if (!does) return;
  event.preventDefault();
  does();
  requestAnimationFrame(draw);
});

if (gl === null) {
  note.textContent = "This page needs WebGL, which this browser does not give.";
  note.hidden = false;
  shown = contacts(changes());
  tell();
} else {
  prepare();
  const restore = sliders();
  document.getElementById("reset").addEventListener("click", () => { camera = { ...START }; if (restore) restore(); else requestAnimationFrame(draw); });
  const toggle = (id, set) => document.getElementById(id).addEventListener("click", (event) => {
    const on = event.target.getAttribute("aria-pressed") !== "true";
    event.target.setAttribute("aria-pressed", String(on));
    set(on);
    build();
  });
  toggle("through", (on) => { through = on; });
  toggle("labeled", (on) => { labeled = on; });
  new ResizeObserver(() => requestAnimationFrame(draw)).observe(canvas);
  dark.addEventListener("change", build);
  build();
}
// For tests, and for who looks from the console.
window.page = { known, corners, camera: () => camera, shown: () => shown, changes, carried, finger: (k) => known.fingers[k].points.map((p, i) => moved(p, known.fingers[k].changes && known.fingers[k].changes[i], changes())) };
