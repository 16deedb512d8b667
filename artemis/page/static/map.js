// The map: what the robot knows of its surroundings, its path, where it drove, and itself to scale.
const canvas = document.getElementById('map'), pen = canvas.getContext('2d');
const view = {x: 0, y: 0, scale: 60, follow: true};
const world = {about: null, state: null, path: [], trail: [], scan: null, map: null, image: null, odometry: null, extent: [], zones: [], draft: null, corners: []};
export const layers = []; // drawn between the trail and the robot: layer(pen, size of a pixel in metres, colours)
let dirty = true, colours = {};

const scheme = matchMedia('(prefers-color-scheme: dark)');
function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ['ground', 'grid', 'wall', 'free', 'path', 'trail', 'scan', 'body', 'body-line', 'wheel', 'doubt', 'text', 'goal', 'zone-keep-out', 'zone-slow', 'zone-prefer']) {
    colours[name] = style.getPropertyValue(`--map-${name}`).trim();
  }
  if (world.map) paintMap();
  dirty = true;
}
scheme.addEventListener('change', readColours);

export function showAbout(about) { world.about = about; dirty = true; }
export function showState(state) {
  const before = world.state;
  if (before && state.frame !== before.frame) world.trail = [];
  world.state = state;
  const [x, y] = state.pose, last = world.trail.at(-1);
  if (!state.lost && (!last || Math.hypot(x - last[0], y - last[1]) >= 0.05)) {
    world.trail.push([x, y]);
    if (world.trail.length > 8000) world.trail.splice(0, 2000);
  }
  if (view.follow) { view.x = x; view.y = y; }
  dirty = true;
}
export function showPath(part) { world.path = part?.points ?? []; if (!world.moved) fit(); dirty = true; }
export const hasPlace = () => world.path.length > 0 || world.map !== null;
export function showExtent(points) { world.extent = points; if (!world.moved) fit(); } // seen with "All", too
export function showTrail(points) { world.trail = points; dirty = true; }
export function showScan(packed) {
  if (!packed) { world.scan = null; dirty = true; return; }
  const bytes = Uint8Array.from(atob(packed), letter => letter.charCodeAt(0));
  world.scan = new Int32Array(bytes.buffer);
  dirty = true;
}
export function showMap(part) {
  world.map = part;
  world.image = null;
  if (part) paintMap();
  if (!world.moved) fit();
  dirty = true;
}

export function showZones(zones) { world.zones = zones; dirty = true; }
// What is being set: a pose, or the corners of a zone.
export function showDraft(draft, corners) { Object.assign(world, {draft, corners}); dirty = true; }
let tool = null;
// Has presses and drags of one finger told instead of moving the map: begin, move, end, cancel.
export function setTool(gestures) { tool = gestures; canvas.classList.toggle('tool', tool !== null); }

function paintMap() {
  const {size: [columns, rows], runs} = world.map, shades = [colours.free, colours.wall].map(rgb);
  const image = new ImageData(columns, rows), cells = new Uint32Array(image.data.buffer);
  let place = 0;
  for (let index = 0; index < runs.length; index += 2) {
    const shade = shades[runs[index]] ?? 0;
    cells.fill(shade, place, place += runs[index + 1]);
  }
  const made = world.image = document.createElement('canvas');
  [made.width, made.height] = [columns, rows];
  made.getContext('2d').putImageData(image, 0, 0);
}
function rgb(colour) {
  const number = Number.parseInt(colour.slice(1), 16);
  return (255 << 24 | (number & 255) << 16 | (number >> 8 & 255) << 8 | number >> 16) >>> 0;
}

// ------------------------------------------------------------------------------------------ the view

const clamp = scale => Math.max(2, Math.min(600, scale));
export function zoom(factor, at) {
  const box = canvas.getBoundingClientRect(), [px, py] = at ?? [box.width / 2, box.height / 2];
  const before = toWorld(px, py);
  view.scale = clamp(view.scale * factor);
  if (!view.follow) { const after = toWorld(px, py); view.x += before[0] - after[0]; view.y += before[1] - after[1]; }
  world.moved = dirty = true;
}
function toWorld(px, py) {
  const box = canvas.getBoundingClientRect();
  return [view.x + (px - box.width / 2) / view.scale, view.y - (py - box.height / 2) / view.scale];
}
export function setFollow(on) {
  view.follow = on;
  if (on && world.state) [view.x, view.y] = world.state.pose;
  dirty = true;
}
export function fit() {
  let points = [...world.path, ...world.trail, ...world.extent];
  if (world.state) points.push(world.state.pose);
  if (world.map) {
    const {resolution: r, origin: [x, y], size: [columns, rows]} = world.map;
    points.push([x, y], [x + columns * r, y + rows * r]);
  }
  if (!points.length) return;
  const xs = points.map(point => point[0]), ys = points.map(point => point[1]);
  const [low, high] = [xs.reduce((a, b) => Math.min(a, b)), xs.reduce((a, b) => Math.max(a, b))];
  const [bottom, top] = [ys.reduce((a, b) => Math.min(a, b)), ys.reduce((a, b) => Math.max(a, b))];
  const box = canvas.getBoundingClientRect(), margin = 1.2;
  view.scale = clamp(Math.min(box.width / (high - low + margin), box.height / (top - bottom + margin), 160));
  [view.x, view.y] = [(low + high) / 2, (bottom + top) / 2];
  dirty = true;
}

const touches = new Map();
let pinch = 0;
export function bindMap(onMoved) {
  const moved = () => { world.moved = true; onMoved(); };
  canvas.addEventListener('wheel', event => {
    event.preventDefault();
    const box = canvas.getBoundingClientRect();
    zoom(Math.exp(-event.deltaY * 0.0015), [event.clientX - box.left, event.clientY - box.top]);
  }, {passive: false});
  let begun = null; // where the press of a tool began
  const place = event => { const box = canvas.getBoundingClientRect(); return toWorld(event.clientX - box.left, event.clientY - box.top); };
  canvas.addEventListener('pointerdown', event => {
    if (event.button > 0) return;
    touches.set(event.pointerId, [event.clientX, event.clientY]);
    canvas.setPointerCapture(event.pointerId);
    pinch = 0;
    if (begun && touches.size > 1) { begun = null; tool?.cancel(); }
    else if (tool && touches.size === 1) { begun = [event.clientX, event.clientY]; if (view.follow) moved(); tool.begin(place(event)); }
  });
  canvas.addEventListener('pointermove', event => {
    const before = touches.get(event.pointerId);
    if (!before) return;
    touches.set(event.pointerId, [event.clientX, event.clientY]);
    if (begun) {
      tool?.move(place(event), Math.hypot(event.clientX - begun[0], event.clientY - begun[1]));
    } else if (touches.size === 1) {
      if (view.follow) setFollow(false);
      view.x -= (event.clientX - before[0]) / view.scale;
      view.y += (event.clientY - before[1]) / view.scale;
      moved();
    } else {
      const [a, b] = [...touches.values()], apart = Math.hypot(a[0] - b[0], a[1] - b[1]);
      if (pinch) zoom(apart / pinch);
      pinch = apart;
    }
    dirty = true;
  });
  const end = event => { touches.delete(event.pointerId); pinch = 0; if (begun) { begun = null; tool?.end(); } };
  canvas.addEventListener('pointerup', end);
  canvas.addEventListener('pointercancel', end);
  canvas.addEventListener('keydown', event => {
    if (event.key === '+' || event.key === '=') zoom(1.25);
    else if (event.key === '-') zoom(0.8);
    else return;
    event.preventDefault();
  });
  new ResizeObserver(() => { dirty = true; if (!world.moved) fit(); }).observe(canvas);
  readColours();
  requestAnimationFrame(draw);
}

// ------------------------------------------------------------------------------------------ drawing

export const drawn = {frames: 0, ms: 0};
function draw() {
  requestAnimationFrame(draw);
  if (!dirty) return;
  dirty = false;
  const begun = performance.now(), ratio = devicePixelRatio || 1, box = canvas.getBoundingClientRect();
  const [width, height] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const scale = view.scale * ratio;
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.fillStyle = colours.ground;
  pen.fillRect(0, 0, width, height);
  pen.setTransform(scale, 0, 0, -scale, width / 2 - view.x * scale, height / 2 + view.y * scale);
  const pixel = ratio / scale;
  drawMap();
  drawGrid(width / scale, height / scale, pixel);
  drawZones(pixel);
  line(world.path, colours.path, Math.max(0.05, 5 * pixel), []);
  line(world.trail, colours.trail, 2.4 * pixel, []);
  for (const layer of layers) layer(pen, pixel, colours);
  drawScan(pixel);
  if (world.about && world.state && !world.state.lost) drawRobot(pixel, world.about, world.state, colours);
  drawGoal(pixel);
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  nameZones(box);
  drawScale(box);
  drawn.frames++; drawn.ms += performance.now() - begun;
}

function drawMap() {
  if (!world.image) return;
  const {resolution, origin: [x, y, heading], size: [columns, rows]} = world.map;
  pen.save();
  pen.translate(x, y);
  pen.rotate(heading);
  pen.imageSmoothingEnabled = false;
  pen.drawImage(world.image, 0, 0, columns * resolution, rows * resolution);
  pen.restore();
}

function drawGrid(width, height, pixel) {
  let step = 1;
  for (const each of [0.25, 0.5, 1, 2, 5, 10, 20, 50]) { step = each; if (each / pixel > 45) break; }
  pen.lineWidth = pixel;
  pen.strokeStyle = colours.grid;
  pen.beginPath();
  for (let x = Math.floor((view.x - width / 2) / step) * step; x < view.x + width / 2; x += step) { pen.moveTo(x, view.y - height / 2); pen.lineTo(x, view.y + height / 2); }
  for (let y = Math.floor((view.y - height / 2) / step) * step; y < view.y + height / 2; y += step) { pen.moveTo(view.x - width / 2, y); pen.lineTo(view.x + width / 2, y); }
  pen.stroke();
}

export function line(points, colour, width, dash) {
  if (points.length < 2) return;
  pen.beginPath();
  pen.moveTo(points[0][0], points[0][1]);
  for (let index = 1; index < points.length; index++) pen.lineTo(points[index][0], points[index][1]);
  Object.assign(pen, {strokeStyle: colour, lineWidth: width, lineJoin: 'round', lineCap: 'round'});
  pen.setLineDash(dash);
  pen.stroke();
  pen.setLineDash([]);
}

const SIGNS = {'keep-out': 'keep out', slow: 'slow', prefer: 'preferred'};
function drawZones(pixel) {
  const outline = (corners, closed) => {
    pen.beginPath();
    corners.forEach(([x, y], index) => { if (index) pen.lineTo(x, y); else pen.moveTo(x, y); });
    if (closed) pen.closePath();
  };
  for (const {kind, corners} of world.zones) {
    const colour = colours[`zone-${kind}`];
    outline(corners, true);
    pen.globalAlpha = 0.22;
    pen.fillStyle = colour;
    pen.fill();
    pen.globalAlpha = 1;
    Object.assign(pen, {strokeStyle: colour, lineWidth: 2 * pixel});
    pen.setLineDash(kind === 'keep-out' ? [] : [6 * pixel, 4 * pixel]);
    pen.stroke();
    pen.setLineDash([]);
  }
  if (!world.corners.length) return;
  outline(world.corners, world.corners.length > 2);
  Object.assign(pen, {strokeStyle: colours['zone-keep-out'], lineWidth: 3 * pixel, fillStyle: colours['zone-keep-out']});
  pen.stroke();
  for (const [x, y] of world.corners) { pen.beginPath(); pen.arc(x, y, 5 * pixel, 0, 7); pen.fill(); }
}
function nameZones(box) {
  Object.assign(pen, {fillStyle: colours.text, font: '600 12px system-ui, "DejaVu Sans", sans-serif', textAlign: 'center'});
  for (const {name, kind, corners} of world.zones) {
    const sum = corners.reduce(([x, y], corner) => [x + corner[0], y + corner[1]], [0, 0]), [x, y] = sum.map(all => all / corners.length);
    const words = name ? `${name}: ${SIGNS[kind]}` : SIGNS[kind];
    pen.fillText(words, (x - view.x) * view.scale + box.width / 2, box.height / 2 - (y - view.y) * view.scale);
  }
  pen.textAlign = 'start';
}

// The end of the path, and a pose that is being set: a ring, and an arrow to where the front points.
function drawGoal(pixel) {
  const end = world.path.at(-1);
  Object.assign(pen, {strokeStyle: colours.goal, fillStyle: colours.goal, lineWidth: 3 * pixel});
  if (end) { pen.beginPath(); pen.arc(end[0], end[1], 8 * pixel, 0, 7); pen.stroke(); }
  if (!world.draft) return;
  const {x, y, heading} = world.draft, long = Math.max(0.5, 46 * pixel);
  pen.save();
  pen.translate(x, y);
  pen.rotate(heading);
  if (world.about) {
    const {outline: [front, rear, half]} = world.about;
    pen.strokeRect(-rear, -half, front + rear, 2 * half);
  }
  pen.beginPath();
  pen.moveTo(0, 0); pen.lineTo(long, 0);
  pen.stroke();
  pen.beginPath();
  pen.moveTo(long + 10 * pixel, 0); pen.lineTo(long - 4 * pixel, 7 * pixel); pen.lineTo(long - 4 * pixel, -7 * pixel);
  pen.fill();
  pen.beginPath();
  pen.arc(0, 0, 6 * pixel, 0, 7);
  pen.fill();
  pen.restore();
}

function drawScan(pixel) {
  if (!world.scan) return;
  pen.fillStyle = colours.scan;
  const size = Math.max(0.03, 3 * pixel);
  for (let index = 0; index < world.scan.length; index += 2) pen.fillRect(world.scan[index] / 100 - size / 2, world.scan[index + 1] / 100 - size / 2, size, size);
}

export function redraw() { dirty = true; }
export function drawRobot(pixel, about, state, colours) {
  const {outline: [front, rear, half], wheelbase, track, scrub, front_wheels, wheel} = about, {pose: [x, y, heading], std, wheels} = state;
  pen.save();
  pen.translate(x, y);
  if (std) {
    const [xx, xy, yy] = std, mean = (xx + yy) / 2, apart = Math.hypot((xx - yy) / 2, xy);
    pen.save();
    pen.rotate(Math.atan2(2 * xy, xx - yy) / 2);
    pen.beginPath();
    pen.ellipse(0, 0, Math.max(2 * Math.sqrt(mean + apart), 2 * pixel), Math.max(2 * Math.sqrt(Math.max(mean - apart, 0)), 2 * pixel), 0, 0, 7);
    pen.fillStyle = colours.doubt;
    pen.fill();
    pen.restore();
  }
  pen.rotate(heading);
  Object.assign(pen, {fillStyle: colours.body, strokeStyle: colours['body-line'], lineWidth: 2 * pixel, lineJoin: 'round'});
  pen.beginPath();
  pen.roundRect(-rear, -half, front + rear, 2 * half, Math.min(0.06, half / 2));
  pen.fill();
  pen.stroke();
  pen.fillStyle = colours.wheel;
  const tyre = (px, py, angle) => {
    pen.save();
    pen.translate(px, py);
    pen.rotate(angle);
    pen.beginPath();
    pen.roundRect(-wheel, -Math.max(wheel * 0.3, 1.5 * pixel), 2 * wheel, 2 * Math.max(wheel * 0.3, 1.5 * pixel), wheel * 0.15);
    pen.fill();
    pen.restore();
  };
  for (const [side, angle] of [[1, wheels[0]], [-1, wheels[1]]]) {
    tyre(0, side * track / 2, 0);
    if (front_wheels === 2) tyre(wheelbase - side * scrub * Math.sin(angle), side * (track / 2 - scrub + scrub * Math.cos(angle)), angle);
  }
  if (front_wheels === 1) tyre(wheelbase, 0, wheels[0]);
  pen.fillStyle = colours['body-line'];
  pen.beginPath();
  pen.moveTo(front - 0.03, 0); pen.lineTo(front - 0.16, 0.07); pen.lineTo(front - 0.16, -0.07);
  pen.fill();
  pen.beginPath();
  pen.arc(0, 0, Math.max(0.02, 2 * pixel), 0, 7);
  pen.fill();
  pen.restore();
}

function drawScale(box) {
  let length = 1;
  for (const each of [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50]) { length = each; if (each * view.scale > 60) break; }
  const [x, y] = [16, box.height - 16], wide = length * view.scale;
  Object.assign(pen, {strokeStyle: colours.text, fillStyle: colours.text, lineWidth: 2, font: '600 13px system-ui, "DejaVu Sans", sans-serif'});
  pen.beginPath();
  pen.moveTo(x, y - 5); pen.lineTo(x, y); pen.lineTo(x + wide, y); pen.lineTo(x + wide, y - 5);
  pen.stroke();
  pen.fillText(`${length} m`, x + 4, y - 8);
}
