// The way of commands: who has control, what the hand does every 50 ms, and Stop by two ways at once.
import {browserName, newId} from './browser.js';
import {hand, onHand, release} from './hand.js';

const BEAT = 50, GAP = 300, NO_ANSWER = 1000, RETRY = 400;
const scheme = location.protocol === 'https:' ? 'wss://' : 'ws://';
const listeners = new Set();
let socket = null, beat = 0, beatCame = 0, sequence = 0, asked = [], pressed = new Map();

export const control = {
  open: false, mine: false, who: '', run: false, trip: null, age: null, refused: '',
  stale: () => false, // set by who hears the robot
};
export const onControl = listener => listeners.add(listener);
const changed = (what, detail) => { for (const listener of listeners) listener(what, detail); };

function say(message) {
  if (socket?.readyState !== WebSocket.OPEN || socket.bufferedAmount > 4096) return false;
  try { socket.send(JSON.stringify(message)); } catch { return false; } // whatever fails here: Stop has a second way
  return true;
}

function connect() {
  const made = socket = new WebSocket(`${scheme}${location.host}/control`);
  made.onopen = () => { control.open = true; changed('open'); };
  made.onmessage = event => hear(JSON.parse(event.data));
  made.onclose = event => {
    const had = control.mine;
    Object.assign(control, {open: false, mine: false, trip: null, age: null});
    release('the connection was lost');
    changed(had ? 'lost' : 'closed', event.code);
    setTimeout(connect, RETRY);
  };
}

function hear(message) {
  switch (message.t) {
    case 'seat':
      if (message.mine && !control.mine) { sequence = beat = 0; beatCame = 0; asked = []; release(''); }
      if (!message.mine && control.mine) release('control was given back');
      Object.assign(control, {mine: message.mine, who: message.who, run: message.run});
      changed('seat');
      break;
    case 'beat':
      beat = message.n; beatCame = performance.now(); control.age = message.age;
      break;
    case 'pong':
      control.trip = performance.now() - message.at;
      changed('trip');
      break;
    case 'stopping': confirmed(message.id, 'connection'); break;
    case 'refused': control.refused = message.why; changed('refused', message.why); break;
    case 'act': changed('act', message.why); break;
    case 'parted': release(message.why); changed('parted', message.why); break;
  }
}

export const take = () => { control.refused = ''; say({t: 'take', who: browserName()}); };
export const giveBack = () => { release(''); hold(); say({t: 'release'}); };
export function ask(word) {
  if (control.mine && asked.length < 8 && !asked.includes(word)) { asked.push(word); hold(); }
}

// What is neither driving nor a request: a pose, an answer, a zone. Whether it was sent; what became of it comes as `act`.
export function act(message) {
  return control.mine && beatCame > 0 && say({...message, seq: ++sequence, beat});
}

// ------------------------------------------------------------------------------------------ the hand

let last = 0, told = false; // when the hand was told of, and whether it held something
export function hold() {
  if (!control.mine || !beatCame) return;
  const now = performance.now(), since = last && now - last;
  last = now;
  told = false;
  if (since > GAP) release('this page was delayed: press again'); // its own timers were
  else if (now - beatCame > GAP) release('the link was delayed: press again');
  const {held, x, y, jog = 0} = hand();
  told = held;
  say({
    t: 'hold', seq: ++sequence, beat, waited: now - beatCame, held, neutral: !held && x === 0 && y === 0, x, y, jog, ask: asked,
  });
  asked = []; // what could not be sent now is not asked for later
}
onHand(() => { if (hand().held !== told) hold(); }); // who lets go does not wait for the timer
setInterval(() => { if (control.mine) hold(); else last = 0; }, BEAT);
setInterval(() => say({t: 'ping', at: performance.now()}), 1000);

function leave(why) {
  if (hand().held || control.mine) { release(why); hold(); }
}
window.addEventListener('blur', () => leave('this window lost the focus'));
window.addEventListener('pagehide', () => { if (control.mine) { leave('the page was left'); say({t: 'release'}); } });
document.addEventListener('freeze', () => { if (control.mine) { leave('the page was left'); say({t: 'release'}); } });
document.addEventListener('visibilitychange', () => {
  if (document.hidden && control.mine) { leave('the page was hidden'); say({t: 'release'}); }
});

// ------------------------------------------------------------------------------------------ Stop

function confirmed(id, way) {
  const press = pressed.get(id);
  if (!press) return;
  pressed.delete(id);
  clearTimeout(press.timer);
  changed('stopping', {way, after: performance.now() - press.at});
}

export function stop() {
  const id = newId(), message = {t: 'stop', id, stale: control.stale()};
  pressed.set(id, {at: performance.now(), timer: setTimeout(() => {
    if (pressed.delete(id)) changed('unconfirmed');
  }, NO_ANSWER)});
  say(message); // both ways at once
  fetch('/stop', {
    method: 'POST', keepalive: true, priority: 'high', headers: {'content-type': 'application/json'}, body: JSON.stringify(message),
  }).then(answer => { if (answer.status === 202) confirmed(id, 'request'); }, () => {});
  release('Stop was pressed');
  hold();
  changed('stop');
  return id;
}

connect();
