// Replays past runs on the map of the live page.
import * as map from './map.js';
import * as panels from './panels.js';
import {PastRun} from './runs_data.js';
import {bindLine, showRuns, showTime} from './runs_line.js';
import {element} from './browser.js';
import {bindStopNow, clock, longTime, makeIt, place, stateOf} from './runs_shared.js';

const $ = id => document.getElementById(id);
const asked = new URLSearchParams(location.search), id = asked.get('run') ?? '', MOST_OTHERS = 100;
const OTHER = {light: '#8a2f72', dark: '#e7a3c8'}; // after Okabe and Ito; its trail is dashed, too
const dark = matchMedia('(prefers-color-scheme: dark)');
const play = window.artemis = {time: 0, playing: false, rate: 1, shown: null};
let run = null, other = null, shift = 0, partsShown = {}, last = 0, lines = [], stale = true;
bindStopNow();

async function opened(which, tell) { // a run with what replays it made; null: it was told why not
  if (!await makeIt(which, 'replay', tell)) return null;
  tell('opening …');
  try {
    const found = await PastRun.open(which);
    found.arrived = () => { stale = true; };
    if (!found.index.whole) growing(found, tell);
    return found;
  } catch (error) { tell(`it could not be opened: ${error.message}`); return null; }
}
async function growing(found, tell) { // its beginning is there, the rest is being made
  while (!found.index.whole) {
    await new Promise(done => setTimeout(done, 1000));
    try {
      const made = await stateOf(found.id, 'replay');
      tell(made.state === 'failed' ? `The rest could not be made: ${made.problem}` : `The rest is being made: ${Math.round((made.share ?? 0) * 100)} %`);
      if (made.state === 'failed') return;
      if (made.state === 'none') await makeIt(found.id, 'replay', tell); // the server was started again
      if (!await found.more()) continue;
    } catch { tell('not connected: trying again'); continue; }
    if (found === run) { map.showMap(run.map); showLine(); }
    if (found === run || found === other) map.showExtent([...run.points, ...(other?.points ?? [])]);
    stale = true;
  }
  tell('');
}

async function begin() {
  const tell = words => { $('making').textContent = words; $('making').hidden = !words; };
  if (!id) { tell('No run selected: select one in the list.'); return; }
  run = await opened(id, tell);
  if (!run) return;
  if (run.index.whole) tell(run.index.pieces.length ? '' : 'Nothing of this run was recorded.');
  const {about, index} = run;
  panels.showAbout(about);
  panels.showFaults([]);
  document.title = `Replay: ${about.mission} · ${about.robot}`;
  map.showAbout(about);
  map.showMap(run.map);
  map.showExtent(run.points);
  showLog(index.log);
  $('download').href = `${place(id)}/run.zip`;
  showFacts();
  showLine();
  for (const button of ['fault-before', 'fault-next']) $(button).disabled = !index.faults.length;
  go(Math.min(Math.max(Number(asked.get('at')) || run.begin, run.begin), run.end));
  listOthers();
  if (asked.get('with')) lay(asked.get('with'));
}

function showFacts() {
  const {index, about} = run;
  const began = new Date(index.start).toLocaleString(undefined, {dateStyle: 'full', timeStyle: 'medium'});
  $('past-of').textContent = `of ${new Date(index.start).toLocaleString(undefined, {dateStyle: 'medium', timeStyle: 'short'})}: not the present state of the robot`;
  $('facts').replaceChildren(...[`${began}, ${longTime(index.end - index.begin)}`, index.outcome ? `ended: ${index.outcome}` : 'interrupted', `${index.faults.length} faults`,
    index.problem ? `incomplete: ${index.problem}` : '', `${about.robot}, artemis ${index.versions.artemis ?? '?'}`].filter(Boolean).flatMap(words => [words, element('br')]));
}

// ------------------------------------------------------------------------------------------ playing

function go(time) {
  play.time = Math.min(run.end, Math.max(run.begin, time));
  stale = true;
}
function setPlaying(on) {
  if (!run) return;
  if (on && play.time >= run.end - 1e-3) go(run.begin);
  play.playing = on;
  $('play').textContent = on ? 'Pause' : 'Play';
  $('play').setAttribute('aria-pressed', on);
}
function frame(now) {
  requestAnimationFrame(frame);
  const passed = Math.min(0.25, (now - last) / 1000);
  last = now;
  if (!run) return;
  if (play.playing && !document.body.classList.contains('loading')) {
    go(play.time + passed * play.rate);
    if (play.time >= run.end) setPlaying(false);
  }
  if (stale) { stale = false; show(); }
}
requestAnimationFrame(frame);

function show() {
  const time = play.time, found = run.at(time, play.rate >= 60 ? 4 : 1);
  document.body.classList.toggle('loading', !found && run.index.pieces.length > 0);
  const mode = found?.state.mode ?? '', words = `${clock(time, 1)} of ${clock(run.end)}`;
  $('time').textContent = found ? words : `${words}, ${run.failed ? `not loaded: ${run.failed}` : !run.index.whole && time > run.index.known ? 'being computed' : 'loading'}`;
  showTime(time, [words, mode, stepAt(time)].filter(Boolean).join(', '));
  markLog(time);
  if (!found) return;
  const {state, parts} = found;
  play.shown = state;
  for (const [name, part] of Object.entries(parts)) {
    if (partsShown[name] === part) continue;
    partsShown[name] = part;
    if (name === 'path') map.showPath(part);
    else if (name === 'scan') map.showScan(part);
    else if (name === 'faults') panels.showFaults(part, true);
    else if (name === 'progress') panels.showProgress(part);
  }
  map.showState(state);
  map.showTrail([...run.trailUntil(time), ...(state.lost ? [] : [state.pose])]);
  panels.showState(state);
  showOther(time);
}
function stepAt(time) {
  let name = '';
  for (const [from, number, words] of run.index.steps) { if (from > time) break; name = words ? `step ${number + 1} ${words}` : ''; }
  return name;
}
function toFault(direction) {
  const times = run.index.faults.map(([time]) => time), at = play.time;
  const to = direction > 0 ? times.find(time => time > at + 0.05) : times.findLast(time => time < at - 0.05);
  if (to === undefined) { panels.announce(direction > 0 ? 'There is no later fault.' : 'There is no earlier fault.'); return; }
  setPlaying(false);
  go(to);
  panels.announce(run.index.faults.filter(([time]) => time === to).map(([, text]) => text).join('. '));
}

// ------------------------------------------------------------------------------------------ another run over it

async function listOthers() {
  try {
    const {runs} = await (await fetch(`/runs/list?count=${MOST_OTHERS}`)).json();
    for (const each of runs) if (each.id !== id && each.facts?.state !== 'running') $('other').append(element('option', {value: each.id}, each.facts ? `${each.facts.mission || each.name}, ${new Date(each.facts.start).toLocaleString(undefined, {dateStyle: 'short', timeStyle: 'medium'})}` : each.name));
  } catch { /* without a choice */ }
  if (asked.get('with')) $('other').value = asked.get('with');
}
async function lay(which) {
  other = null;
  $('at-box').hidden = true;
  $('other-said').textContent = '';
  showLine();
  if (which) {
    const tell = words => { $('other-said').textContent = words; }, found = await opened(which, tell);
    if ($('other').value !== which && asked.get('with') !== which) return; // another one was chosen meanwhile
    if (!found) { $('tab-with').click(); return; }
    other = found;
    const steps = [...run.began].filter(([name]) => other.began.has(name));
    $('at').replaceChildren(element('option', {value: 'start'}, 'the start'), element('option', {value: 'clock'}, 'the time of day'), ...steps.map(([name]) => element('option', {value: name}, `step ${name}`)));
    $('at-box').hidden = false;
    align();
  }
  map.showExtent([...run.points, ...(other?.points ?? [])]);
  stale = true;
}
function align() { // what is added to a time of the other run to have that of this one
  const at = $('at').value;
  if (at === 'start') shift = run.begin - other.begin;
  else if (at === 'clock') shift = (new Date(other.index.start) - new Date(run.index.start)) / 1000;
  else shift = run.began.get(at) - other.began.get(at);
  const meets = other.begin + shift < run.end && other.end + shift > run.begin;
  $('other-said').textContent = [meets ? '' : 'With this alignment the two runs do not overlap.',
    other.index.about.robot === run.about.robot ? '' : `The other run is of another robot: ${other.index.about.robot}.`].filter(Boolean).join(' ');
  showLine();
  stale = true;
}
function showLine() {
  const {index} = run, both = other !== null;
  showRuns([{...index, shift: 0, letter: both ? 'A' : ''}, ...(both ? [{...other.index, shift, letter: 'B'}] : [])]);
  $('legend').hidden = !both;
  if (both) $('legend').replaceChildren(...[run, other].map((each, number) => element('li', {class: number ? 'second' : 'first'}, `${'AB'[number]} ${each.about.mission}, ${new Date(each.index.start).toLocaleString(undefined, {dateStyle: 'short', timeStyle: 'short'})}`)));
}
let beside = null;
function showOther(time) {
  const there = time - shift;
  beside = play.beside = null;
  if (!other) return;
  const held = Math.min(Math.max(there, other.begin), other.end), found = other.at(held);
  beside = {trail: other.trailUntil(held), state: found?.state, on: there >= other.begin && there <= other.end};
  play.beside = beside;
  map.redraw();
}
map.layers.push((pen, pixel, colours) => {
  if (run) { pen.save(); pen.globalAlpha = 0.4; map.line(run.points, colours.trail, 1.2 * pixel, []); pen.restore(); } // all of it
  if (!beside) return;
  const colour = dark.matches ? OTHER.dark : OTHER.light;
  map.line(beside.trail, colour, 2.4 * pixel, [8 * pixel, 5 * pixel]);
  if (!beside.state || beside.state.lost) return;
  pen.save();
  pen.globalAlpha = beside.on ? 1 : 0.4;
  map.drawRobot(pixel, other.about, beside.state, {...colours, body: `${colour}88`, 'body-line': colour, wheel: colour});
  pen.restore();
});

// ------------------------------------------------------------------------------------------ the log

function showLog(entries) {
  lines = entries.map(entry => {
    const {time, kind, level} = entry;
    const button = element('button', {type: 'button', 'data-at': time}, element('time', {}, clock(time, 2)), element('b', {}, kind), element('span', {}, panels.worded(entry)));
    return {time, row: element('li', {'data-level': level}, button)};
  });
  $('log').querySelector('ol').replaceChildren(...lines.map(({row}) => row));
}
$('log').addEventListener('click', event => {
  const button = event.target.closest('button[data-at]');
  if (button) { setPlaying(false); go(Number(button.dataset.at)); }
});
let marked = null;
function markLog(time) {
  const at = lines.findLast(line => line.time <= time + 1e-6)?.row ?? null;
  if (at === marked) return;
  marked?.removeAttribute('aria-current');
  at?.setAttribute('aria-current', 'true');
  marked = at;
  const list = $('log');
  if (at && !list.hidden && !list.contains(document.activeElement)) list.scrollTop = at.offsetTop - list.offsetTop - list.clientHeight / 2;
}

// ------------------------------------------------------------------------------------------ hands and keys

bindLine(time => { if (run) go(time); });
$('play').addEventListener('click', () => setPlaying(!play.playing));
$('back').addEventListener('click', () => go(play.time - 10));
$('on').addEventListener('click', () => go(play.time + 10));
$('fault-before').addEventListener('click', () => toFault(-1));
$('fault-next').addEventListener('click', () => toFault(1));
$('rate').addEventListener('change', () => { play.rate = Number($('rate').value); });
$('other').addEventListener('change', () => { asked.delete('with'); lay($('other').value); });
$('at').addEventListener('change', align);
const KEYS = {
  k: () => setPlaying(!play.playing), j: () => go(play.time - 10), l: () => go(play.time + 10), n: () => toFault(1), p: () => toFault(-1),
  ArrowLeft: event => go(play.time - (event.shiftKey ? 0.1 : 1)), ArrowRight: event => go(play.time + (event.shiftKey ? 0.1 : 1)),
  PageDown: () => go(play.time - 60), PageUp: () => go(play.time + 60), Home: () => go(run.begin), End: () => go(run.end),
};
window.addEventListener('keydown', event => {
  const act = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!run || !act || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.target.closest('input, select, textarea, [role=tab]')) return;
  if (/^(Page|Home|End)/.test(event.key) && event.target.closest('[role=tabpanel]')) return; // scrolls there
  event.preventDefault();
  act(event);
});

map.bindMap(() => follow(false));
function follow(on) { map.setFollow(on); $('follow').setAttribute('aria-pressed', on); }
follow(false);
$('follow').addEventListener('click', () => follow($('follow').getAttribute('aria-pressed') !== 'true'));
$('fit').addEventListener('click', () => { follow(false); map.fit(); });
$('zoom-in').addEventListener('click', () => map.zoom(1.4));
$('zoom-out').addEventListener('click', () => map.zoom(1 / 1.4));
panels.bindTabs(() => { stale = true; });
begin();
