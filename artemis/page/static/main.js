// Joins the parts of the page: what is told of the robot, what the operator wants.
import {control, onControl, take, giveBack, ask, stop} from './control.js';
import {bindKeys, bindStick, hand, onHand, onPadStop, reason, setRange} from './hand.js';
import * as map from './map.js';
import * as panels from './panels.js';
import * as charts from './charts.js';
import * as acts from './acts.js';
import {bindInvite, bindStop, reloadIfOther} from './browser.js';

const $ = id => document.getElementById(id);
const RETRY = 500, QUIET = 1000, OLD = 1.0;
const stats = window.artemis = {messages: 0, bytes: 0, control, hand};
let link = null, came = 0, stateAge = 0, over = false, everCame = false;

// ------------------------------------------------------------------------------------------ what the robot does

function connect() {
  link = new WebSocket(`${location.protocol === 'https:' ? 'wss://' : 'ws://'}${location.host}/telemetry`);
  link.onmessage = event => { stats.messages++; stats.bytes += event.data.length; hear(JSON.parse(event.data)); };
  link.onclose = () => {
    reloadIfOther('/history');
    setTimeout(connect, RETRY);
  };
}

function hear(message) {
  came = performance.now();
  everCame = true;
  stateAge = message.age ?? 0;
  if (message.about) {
    panels.clearLog();
    map.showAbout(message.about);
    panels.showAbout(message.about);
    if (over) panels.forgetFaults(); // of the run before
    charts.begin(message.about);
    acts.showAbout(message.about);
    over = false;
  }
  if (message.trail) map.showTrail(message.trail);
  if ('map' in message) map.showMap(message.map);
  if ('path' in message) map.showPath(message.path);
  if (message.about && map.hasPlace()) follow(false);
  if (message.faults) panels.showFaults(message.faults);
  if (message.progress) panels.showProgress(message.progress);
  if (message.zones) acts.showZones(message.zones);
  if (message.log) {
    panels.showLog(message.log);
    if (!message.about) acts.showLog(message.log); // not what was before this page came
  }
  if (message.state) {
    stats.state = message.state;
    over = message.state.over;
    map.showState(message.state);
    panels.showState(message.state);
    charts.see(message.state.sample);
    acts.showState(message.state);
    showAsks(message.state);
  }
  if ('scan' in message) map.showScan(message.scan);
}

const isStale = () => performance.now() - came > QUIET || stateAge > OLD;
control.stale = isStale;

function showLink() {
  const age = performance.now() - came, gone = age > QUIET;
  let state = 'ok', words = control.trip === null ? 'connected' : `${Math.round(control.trip)} ms`;
  if (!everCame) { state = 'none'; words = 'connecting'; }
  else if (gone) { state = 'none'; words = `lost ${(age / 1000).toFixed(0)} s ago`; }
  else if (stateAge > OLD) { state = 'slow'; words = over ? 'run ended' : `no state for ${stateAge.toFixed(0)} s`; }
  else if (age > 400) { state = 'slow'; words = `${Math.round(age)} ms old`; }
  document.body.dataset.link = state;
  $('link').textContent = words;
  let banner = '';
  if (everCame && gone && !over) banner = 'NOT CONNECTED. The displayed state is old. The robot stops if it was driven from here; Stop is still sent.';
  else if (over) banner = 'The run has ended.';
  else if (stats.state?.alarm) banner = 'THE ROBOT DOES NOT STOP: PRESS THE EMERGENCY STOP';
  else if (unconfirmed) banner = 'Stop was not confirmed. Use the emergency stop on the robot.';
  if ($('banner').textContent !== banner) { $('banner').textContent = banner; $('banner').hidden = !banner; }
  $('banner').classList.toggle('calm', over);
}
setInterval(showLink, 200);

// ------------------------------------------------------------------------------------------ control

let unconfirmed = false, wake = null;
function showSeat() {
  const mine = control.mine, usable = control.open && control.run && !over;
  document.body.classList.toggle('mine', mine);
  $('take').hidden = mine;
  $('take').disabled = !usable;
  $('give').hidden = !mine;
  $('hand').hidden = !mine;
  let words = 'No operator has control.';
  if (!control.open) words = 'Not connected.';
  else if (!control.run) words = over ? 'The run has ended.' : 'This run does not accept requests from the page yet.';
  else if (mine) words = 'You have control.';
  else if (control.who) words = `${control.who} has control. You can watch, and stop.`;
  if (control.refused && !mine) words = `Refused: ${control.refused}.`;
  if ($('seat').textContent !== words) $('seat').textContent = words;
  for (const button of document.querySelectorAll('[data-ask]:not([data-ask=record])')) button.disabled = !mine;
  if (mine && !wake && navigator.wakeLock) navigator.wakeLock.request('screen').then(lock => { wake = lock; }, () => {});
  if (!mine && wake) { wake.release(); wake = null; }
}
function showHand() {
  const {held, x, y, by} = hand(), turns = by === 'jog', counts = turns || (stats.state?.mode === 'teleop' && stats.state.phase.startsWith('driving'));
  let words = turns ? 'turning the wheel' : held ? `${y > 0.02 ? 'forward' : y < -0.02 ? 'backward' : 'stand'} ${Math.round(Math.abs(y) * 100)} %` : reason() || 'released';
  if (held && Math.abs(x) > 0.02) words += `, ${x < 0 ? 'left' : 'right'} ${Math.round(Math.abs(x) * 100)} %`;
  $('wish').classList.toggle('idle', held && !counts);
  $('wish').title = held && !counts ? 'The robot is not being driven by hand now.' : '';
  if (held && !counts) words = `not driving: ${words}`;
  if ($('wish').textContent !== words) $('wish').textContent = words;
}
function showAsks(state) {
  const next = {fault: 'acknowledge', quickstop: /acknowledge/.test(state.phase) ? 'acknowledge' : /arm/.test(state.phase) ? 'arm' : '', init: /waiting for arm/.test(state.phase) ? 'arm' : ''}[state.mode] ?? '';
  for (const button of document.querySelectorAll('[data-ask]')) button.classList.toggle('next', button.dataset.ask === next);
  showHand();
}

onControl((what, detail) => {
  if (what === 'stopping') { unconfirmed = false; stats.stopAfter = detail.after; panels.announce('Stop was sent to the robot.'); $('stop').classList.add('sent'); setTimeout(() => $('stop').classList.remove('sent'), 1200); }
  if (what === 'unconfirmed') unconfirmed = true;
  if (what === 'lost') panels.announce('Control was lost.');
  showSeat();
});
onHand(showHand);

bindStop(stop);
onPadStop(stop);

$('take').addEventListener('click', take);
$('give').addEventListener('click', giveBack);
let sure = -Infinity;
for (const button of document.querySelectorAll('[data-ask]')) {
  const words = button.textContent;
  button.addEventListener('click', () => {
    if (button.dataset.ask === 'end' && performance.now() - sure > 3000) {
      sure = performance.now();
      button.textContent = 'Press again to end';
      setTimeout(() => { button.textContent = words; }, 3000);
      return;
    }
    ask(button.dataset.ask);
  });
}
const share = () => { setRange($('range').value / 100); $('range-shown').textContent = `${$('range').value} %`; };
$('range').addEventListener('input', share);
share();
bindStick($('stick'), $('knob'), () => control.mine);
bindKeys(() => control.mine);

// ------------------------------------------------------------------------------------------ map, tabs, pairing

map.bindMap(() => follow(false));
acts.bindActs();
function follow(on) { map.setFollow(on); $('follow').setAttribute('aria-pressed', on); }
$('follow').addEventListener('click', () => follow($('follow').getAttribute('aria-pressed') !== 'true'));
$('fit').addEventListener('click', () => { follow(false); map.fit(); });
$('zoom-in').addEventListener('click', () => map.zoom(1.4));
$('zoom-out').addEventListener('click', () => map.zoom(1 / 1.4));
panels.bindTabs(shown => charts.show(shown === 'charts'));
panels.showFaults([]);

bindInvite();

connect();
showSeat();
