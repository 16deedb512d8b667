// What the operator may do besides driving: a goal, an initial pose and zones on the map; answers; a wheel that is calibrated.
import {act, ask, control, onControl} from './control.js';
import {jog, onHand} from './hand.js';
import * as map from './map.js';
import {element} from './browser.js';
import {announce} from './panels.js';

const $ = id => document.getElementById(id);
const TURN = Math.PI / 180, LEAST = 12, SAID = 8000, SURE = 3000; // a drag is as long as that [px]; what was said is shown [ms]
const WORDS = {
  goal: ['Drive here', 'Press the goal position, and drag in the direction of the heading.'],
  pose: ['The robot is here', 'Press the position of the robot, and drag in the direction of its heading.'],
  zone: ['Keep out of it', 'Press each corner of the keep-out zone.'],
};
let about = null, state = null, zones = [], tool = '', draft = null, corners = [], from = null, said = 0;

export function showAbout(told) { about = told; choose(''); }
export function showState(told) { state = told; show(); }
export function showZones(told) { zones = told; map.showZones(plan()?.zones ?? []); listZones(); show(); }

// The zones of the map on which the present step plans, or else of the first.
const plan = () => zones.find(each => each.steps.includes(state?.step)) ?? zones[0];
const goes = () => Boolean(about && state && ['ready', 'follow'].includes(state.mode) && about.acts.goals.includes(state.step));

// ------------------------------------------------------------------------------------------ what is said of it

function say(words, bad = false) {
  said = performance.now();
  $('act-said').textContent = words;
  $('act-said').classList.toggle('bad', bad);
  $('act-said').hidden = !words;
  if (words) announce(words);
}
setInterval(() => { if (said && performance.now() - said > SAID) { said = 0; say(''); } }, 500);
onControl((what, detail) => {
  if (what === 'act') { if (detail) say(`Refused: ${detail}.`, true); else if (pending) { say(pending); choose(''); } pending = ''; }
  if (what === 'seat' || what === 'closed' || what === 'lost') show();
});
let pending = '';
// The run's own words: what was taken, or why not.
export function showLog(lines) {
  for (const {kind, text, level} of lines) {
    if (kind === 'request' && text.includes(': ignored, ')) say(`${text[0].toUpperCase()}${text.slice(1)}.`, true);
    if (kind === 'goal' || kind === 'pose' || /^(NET-14|NET-04|LOC-07) /.test(text)) say(text, level >= 3);
  }
}

// ------------------------------------------------------------------------------------------ tools on the map

function choose(name) {
  tool = name === tool ? '' : name;
  draft = from = null;
  corners = [];
  for (const each of ['goal', 'pose', 'zone']) $(`tool-${each}`).setAttribute('aria-pressed', tool === each);
  $('act').hidden = !tool;
  document.body.classList.toggle('acting', Boolean(tool));
  if (tool) {
    [$('act-do').textContent, $('act-hint').textContent] = WORDS[tool];
    $('act-place').hidden = tool === 'zone';
    $('act-zone').hidden = tool !== 'zone';
    $('zone-corners').value = '';
    for (const field of ['act-x', 'act-y', 'act-heading']) $(field).value = '';
  }
  map.setTool(tool ? gestures : null);
  show();
}
const gestures = {
  begin(point) {
    if (tool === 'zone') { corners.push(point); writeCorners(); return; }
    from = point;
    draft = {x: point[0], y: point[1], heading: draft?.heading ?? state?.pose[2] ?? 0};
    writePlace();
  },
  move(point, pixels) {
    if (!from || tool === 'zone' || pixels < LEAST) return;
    draft.heading = Math.atan2(point[1] - from[1], point[0] - from[0]);
    writePlace();
  },
  end() { from = null; },
  // A second finger moves the map: what the first began is taken back.
  cancel() { if (tool === 'zone') { corners.pop(); writeCorners(); } else { draft = null; writePlace(); } from = null; },
};
function writePlace() {
  const values = draft ? [draft.x.toFixed(2), draft.y.toFixed(2), (draft.heading / TURN).toFixed(0)] : ['', '', ''];
  [$('act-x').value, $('act-y').value, $('act-heading').value] = values;
  show();
}
function readPlace() {
  const fields = ['act-x', 'act-y', 'act-heading'].map(id => $(id)), numbers = fields.map(field => field.valueAsNumber);
  draft = numbers.every(Number.isFinite) ? {x: numbers[0], y: numbers[1], heading: numbers[2] * TURN} : null;
  show();
}
function writeCorners() {
  $('zone-corners').value = corners.map(([x, y]) => `${x.toFixed(2)} ${y.toFixed(2)}`).join('\n');
  show();
}
function readCorners() {
  const rows = $('zone-corners').value.trim().split(/[\n;]+/).filter(row => row.trim());
  const read = rows.map(row => row.trim().split(/[\s,]+/).map(Number));
  corners = read.filter(pair => pair.length === 2 && pair.every(Number.isFinite));
  show(corners.length < read.length);
}

function perform() {
  if (tool === 'zone') {
    const {map: name, tag} = plan();
    if (act({t: 'zone', map: name, known: tag, name: $('zone-name').value.trim(), corners})) pending = 'The zone is saved. Routes planned from now on avoid it.';
    return;
  }
  const {x, y, heading} = draft, kind = tool === 'goal' ? 'goal_pose' : 'initialpose';
  if (act({t: 'pose', kind, x, y, heading: Math.atan2(Math.sin(heading), Math.cos(heading))})) { say('Sent.'); choose(''); }
}

// ------------------------------------------------------------------------------------------ what is shown of all this

let shown = '';
function show(wrong = false) {
  if (!about) return;
  const mine = control.mine, {goals, allow, questions, records} = about.acts;
  $('tool-goal').hidden = !goals.length || !allow.includes('goal_pose');
  $('tool-pose').hidden = !allow.includes('initialpose');
  $('tool-zone').hidden = !zones.length;
  const whole = tool === 'zone' ? corners.length >= 3 && !wrong : draft !== null;
  let why = '';
  if (!mine) why = 'Take control first.';
  else if (tool === 'goal' && !goes()) why = 'No step of the mission asks for a goal now.';
  else if (tool === 'zone' && wrong) why = 'Enter two numbers for each corner: x and y in metres.';
  $('act-do').disabled = !whole || Boolean(why);
  $('act-why').textContent = why;
  map.showDraft(tool === 'zone' ? null : draft, tool === 'zone' ? corners : []);

  const question = state && state.mode === 'ready' ? questions[state.step] : null;
  const key = question ? `${state.step} ${mine}` : '';
  if (key !== shown) {
    shown = key;
    $('question').hidden = !question;
    if (question) {
      const step = state.step;
      $('question-text').textContent = question.question;
      $('answers').replaceChildren(...question.answers.map(answer => {
        const button = element('button', {type: 'button', class: 'primary', disabled: !mine}, answer);
        button.addEventListener('click', () => act({t: 'answer', step, text: answer}));
        return button;
      }));
      announce(`The mission asks: ${question.question}`);
    }
  }

  const record = document.querySelector('[data-ask=record]'), presses = state?.presses ?? 0;
  record.disabled = !mine || state?.mode !== 'teleop' || !records.includes(state.step);
  record.title = records.length ? '' : 'No step of this mission records a path.';
  record.textContent = presses % 2 ? 'Record until here' : presses ? 'Record anew' : 'Record from here';
  record.setAttribute('aria-pressed', presses % 2 === 1);
  showCalibration(mine);
}

function showCalibration(mine) {
  const [accepts, turns] = state?.hand ?? [false, false], here = accepts || turns || state?.mode === 'calibrate';
  $('calibration').hidden = !here;
  document.body.classList.toggle('calibrating', here); // the stick drives nothing then
  $('jog').hidden = !turns;
  $('accept').hidden = !accepts;
  $('accept').disabled = !mine;
  for (const button of $('jog').querySelectorAll('button')) button.disabled = !mine;
  if (!turns) jog(0);
  if (!here) return;
  $('calibration-phase').textContent = state.phase;
  const rows = state.drives.flatMap(([, , , angle, volts], index) => volts ? [[about.drives[index].name, angle, volts]] : []);
  $('potentiometers').replaceChildren(...rows.map(([name, angle, volts]) => element('tr', {},
    element('th', {scope: 'row'}, name), element('td', {class: 'number'}, `${(angle / TURN).toFixed(2)}°`),
    ...volts.map(value => element('td', {class: 'number'}, `${value.toFixed(3)} V`)))));
}

function listZones() {
  const of = plan();
  $('tab-zones').hidden = !of;
  if (!of) return;
  const rows = of.zones.map((zone, index) => {
    const button = element('button', {type: 'button'}, 'Remove');
    let sure = -Infinity;
    button.addEventListener('click', () => {
      if (performance.now() - sure > SURE) {
        sure = performance.now();
        button.textContent = 'Press again';
        setTimeout(() => { button.textContent = 'Remove'; }, SURE);
      } else if (!act({t: 'zone', map: of.map, known: of.tag, remove: index + 1})) say('Refused: take control first.', true);
      else pending = 'The zone is removed. Routes planned from now on may cross it.';
    });
    const kind = {'keep-out': 'keep out', slow: `at most ${zone.speed} m/s`, prefer: 'preferred'}[zone.kind];
    return element('tr', {}, element('th', {scope: 'row'}, zone.name || `${index + 1}`), element('td', {}, kind),
      element('td', {}, zone.corners.map(([x, y]) => `${x} ${y}`).join(', ')), element('td', {}, button));
  });
  $('zones-of').textContent = of.problem ? of.problem : `Beside ${of.map}. The next route that is planned heeds them.`;
  $('zones').querySelector('tbody').replaceChildren(...rows);
}

// ------------------------------------------------------------------------------------------ buttons

export function bindActs() {
  for (const name of ['goal', 'pose', 'zone']) $(`tool-${name}`).addEventListener('click', () => choose(name));
  for (const field of ['act-x', 'act-y', 'act-heading']) $(field).addEventListener('input', readPlace);
  $('zone-corners').addEventListener('input', readCorners);
  $('act').addEventListener('submit', event => { event.preventDefault(); perform(); });
  $('act-cancel').addEventListener('click', () => choose(''));
  $('zone-undo').addEventListener('click', () => { corners.pop(); writeCorners(); });
  $('accept').addEventListener('click', () => ask('accept'));
  for (const button of $('jog').querySelectorAll('button')) {
    const turn = Number(button.dataset.turn);
    button.addEventListener('pointerdown', event => { if (event.button > 0 || button.disabled) return; button.setPointerCapture(event.pointerId); jog(turn); });
    for (const end of ['pointerup', 'pointercancel', 'lostpointercapture', 'blur']) button.addEventListener(end, () => jog(0));
    button.addEventListener('keydown', event => { if (event.key === 'Enter' && !event.repeat) { event.preventDefault(); jog(turn); } });
    button.addEventListener('keyup', () => jog(0));
    button.addEventListener('contextmenu', event => event.preventDefault());
  }
  onHand(() => { for (const button of $('jog').querySelectorAll('button')) button.classList.toggle('held', jog.now === Number(button.dataset.turn)); });
}
