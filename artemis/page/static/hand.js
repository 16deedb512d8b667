// What the hand does: a stick on the screen, the arrow keys, a gamepad. Whoever lets go, in whatever way, drives no more.
const STEER = 1.6, BACK = 4; // how fast the arrow keys turn the wheels, and how fast these go back [of the way, per second]
const KNOB = 46; // half of the knob and the rim [px]
const stick = {held: false, x: 0, y: 0}, keys = {down: new Set(), x: 0, at: 0}, pad = {held: false, x: 0, y: 0, armed: false, stop: false};
const listeners = new Set();
let range = 0.4, why = '', padStop = () => {};

export const onHand = listener => listeners.add(listener);
export const onPadStop = listener => { padStop = listener; };
export const setRange = share => { range = share; };
const changed = () => { for (const listener of listeners) listener(); };
export const reason = () => why;

// A wheel that is calibrated is turned as long as its button is held: to the left above 0, slowly up to a half.
export function jog(turn) {
  if (jog.now === turn) return;
  jog.now = turn;
  why = '';
  changed();
}
jog.now = 0;

export function release(words) {
  if (stick.held || keys.down.size || pad.held || jog.now) why = words;
  jog.now = 0;
  Object.assign(stick, {held: false, x: 0, y: 0});
  keys.down.clear();
  keys.x = 0;
  Object.assign(pad, {held: false, x: 0, y: 0, armed: false});
  changed();
}

export function hand() {
  readPad();
  if (jog.now) return {held: true, x: 0, y: 0, jog: jog.now, by: 'jog'};
  if (stick.held) return {held: true, x: stick.x, y: stick.y * range, by: 'stick'};
  if (keys.down.size) return {held: true, x: turned(), y: ((keys.down.has('ArrowUp') ? 1 : 0) - (keys.down.has('ArrowDown') ? 1 : 0)) * range, by: 'keys'};
  if (pad.held) return {held: true, x: pad.x, y: pad.y * range, by: 'gamepad'};
  return {held: false, x: 0, y: 0, by: ''};
}

// ------------------------------------------------------------------------------------------ the stick

export function bindStick(element, knob, allowed) {
  let pointer = null;
  const move = event => {
    const box = element.getBoundingClientRect();
    const share = (way, length) => Math.max(-1, Math.min(1, way / (length / 2 - KNOB)));
    stick.x = share(event.clientX - box.left - box.width / 2, box.width);
    stick.y = -share(event.clientY - box.top - box.height / 2, box.height);
    changed();
  };
  const end = words => event => {
    if (event.pointerId !== pointer) return;
    pointer = null;
    release(words);
  };
  element.addEventListener('pointerdown', event => {
    if (pointer !== null || !allowed() || event.button > 0) return;
    event.preventDefault();
    element.focus({preventScroll: true});
    pointer = event.pointerId;
    element.setPointerCapture(pointer);
    stick.held = true;
    why = '';
    move(event);
  });
  element.addEventListener('pointermove', event => { if (event.pointerId === pointer && stick.held) move(event); });
  element.addEventListener('pointerup', end(''));
  element.addEventListener('pointercancel', end('the touch was interrupted'));
  element.addEventListener('lostpointercapture', end('the touch was interrupted'));
  element.addEventListener('contextmenu', event => event.preventDefault());
  element.addEventListener('touchstart', event => event.preventDefault(), {passive: false});
  onHand(() => {
    const {held, x, y, by} = hand(), box = element.getBoundingClientRect(), shown = by === 'stick' ? stick.y : y;
    knob.style.transform = `translate(${x * (box.width / 2 - KNOB)}px, ${-shown * (box.height / 2 - KNOB)}px)`;
    element.classList.toggle('held', held);
  });
}

// ------------------------------------------------------------------------------------------ the arrow keys

const ARROWS = new Set(['ArrowUp', 'ArrowDown', 'ArrowLeft', 'ArrowRight']);

function turned() {
  const now = performance.now(), passed = Math.min((now - keys.at) / 1000, 0.2);
  const wished = (keys.down.has('ArrowRight') ? 1 : 0) - (keys.down.has('ArrowLeft') ? 1 : 0);
  const step = (wished === 0 ? BACK : STEER) * passed;
  keys.at = now;
  keys.x += Math.max(-step, Math.min(step, wished - keys.x));
  return keys.x;
}

export function bindKeys(allowed) {
  const elsewhere = target => target instanceof Element && target.closest('input, textarea, select, [role=tab], #jog');
  window.addEventListener('keydown', event => {
    if (!ARROWS.has(event.key) || event.ctrlKey || event.metaKey || event.altKey || !allowed() || elsewhere(event.target)) return;
    event.preventDefault();
    if (event.repeat) return; // held since before it was released: press again
    if (!keys.down.size) keys.at = performance.now();
    why = '';
    keys.down.add(event.key);
    changed();
  });
  window.addEventListener('keyup', event => { if (keys.down.delete(event.key)) { if (!keys.down.size) keys.x = 0; changed(); } });
}

// ------------------------------------------------------------------------------------------ a gamepad

setInterval(readPad, 50); // its Stop counts without control, and while nothing is heard of the robot
function readPad() {
  const found = navigator.getGamepads ? Array.from(navigator.getGamepads()).find(each => each?.connected && each.mapping === 'standard') : null;
  if (!found) { if (pad.held) { pad.held = false; why = 'the gamepad was disconnected'; } pad.armed = false; return; }
  const enable = found.buttons[5]?.pressed, stop = found.buttons[1]?.pressed;
  if (stop && !pad.stop) { pad.stop = true; padStop(); return; }
  pad.stop = stop;
  if (!enable) pad.armed = true; // released once since it was plugged in, or since the last release
  pad.held = Boolean(enable && pad.armed);
  const dead = value => Math.abs(value) < 0.08 ? 0 : (value - Math.sign(value) * 0.08) / 0.92;
  pad.x = pad.held ? dead(found.axes[0] ?? 0) : 0;
  pad.y = pad.held ? -dead(found.axes[1] ?? 0) : 0;
}
