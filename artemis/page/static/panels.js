// Everything in words: mode, faults, drives, steps, log.
import {element} from './browser.js';

const $ = id => document.getElementById(id);
const SEVERITY = ['', 'warning', 'speed limited', 'controlled stop', 'quick stop', 'drives off'];
const MARK = ['', '⚠', '⚠', '✖', '✖', '✖']; // signs that plain fonts have
let about = null, numbered = [], lastStep = -1, lastMode = '';

export const announce = words => { $('announce').textContent = words; };
const degrees = angle => angle * 180 / Math.PI;
const signed = (value, digits) => (value < 0 ? '−' : value > 0 ? '+' : '') + Math.abs(value).toFixed(digits);

export function showAbout(told) {
  about = told;
  $('robot').textContent = told.robot;
  $('mission').textContent = told.mission;
  $('simulated').hidden = !told.simulated;
  document.title = `${told.mission || 'artemis'} · ${told.robot}`;
  const body = $('drives').querySelector('tbody');
  body.replaceChildren(...told.drives.map(drive => element('tr', {},
    element('th', {scope: 'row'}, drive.name, element('small', {}, ` node ${drive.node}`)), element('td', {class: 'state'}, '–'),
    ...['', 'temperature', '', 'heard'].map(name => element('td', {class: `number ${name}`}, '–')))));
  numbered = told.steps.numbered;
  lastStep = -1;
  showSteps(told.steps.tree);
}

export function showState(state) {
  const {mode, phase, sample, pose, std, drives, track, clear} = state;
  const speed = sample[1], steering = sample[3], battery = sample[5];
  $('mode-name').textContent = mode;
  $('mode-name').dataset.mode = mode;
  let words = phase;
  if (track) words = `${track[0].toFixed(1)} of ${track[1].toFixed(1)} m, ${Math.abs(sample[4] * 1000).toFixed(0)} mm ${sample[4] < 0 ? 'right' : 'left'} of the path`;
  if (clear?.[3]) words = phase; // it waits for a scan
  else if (clear && clear[2] > 0) words = `stopped for an obstacle for ${clear[2].toFixed(0)} s`;
  $('phase').textContent = words;
  if (mode !== lastMode && lastMode) announce(`Mode ${mode}. ${phase}`);
  lastMode = mode;
  $('speed').textContent = `${signed(speed, 2)} m/s`;
  $('steering').textContent = `${degrees(steering) > 0.5 ? '↰ ' : degrees(steering) < -0.5 ? '↱ ' : ''}${Math.abs(degrees(steering)).toFixed(0)}°${Math.abs(degrees(steering)) < 0.5 ? '' : steering > 0 ? ' left' : ' right'}`;
  $('battery-box').hidden = battery === null;
  if (battery !== null) $('battery').textContent = (state.battery ? `${Math.round(state.battery[0] * 100)} % · ` : '') + `${battery.toFixed(1)} V`;
  $('battery').title = state.battery?.[1] ? `about ${Math.round(state.battery[1])} m left` : '';
  const doubt = std ? ` ± ${(Math.sqrt(Math.max(std[0], std[2])) * 100).toFixed(0)} cm, ± ${degrees(Math.sqrt(std[3])).toFixed(1)}°` : '';
  $('pose').firstChild.textContent = state.lost ? 'position lost' : `x ${pose[0].toFixed(2)} m, y ${pose[1].toFixed(2)} m, ${degrees(pose[2]).toFixed(0)}°`;
  $('pose').lastChild.textContent = state.lost ? '' : `${doubt} (${state.source}), driven ${state.distance.toFixed(1)} m`;
  showDrives(drives, sample, state.temperatures);
  showInputs(state.inputs);
  if (state.step !== lastStep) { lastStep = state.step; markStep(); }
  showRan(state.ran);
}

function showDrives(drives, sample, temperatures) {
  if ($('drives').hidden) return;
  const warm = temperatures.some(value => value !== null);
  for (const cell of $('drives').querySelectorAll('.temperature')) cell.hidden = !warm;
  const rows = $('drives').querySelectorAll('tbody tr');
  drives.forEach(([state, on, age, position], index) => {
    const cells = rows[index]?.children;
    if (!cells) return;
    cells[1].textContent = `${on ? '●' : '○'} ${state}`;
    cells[1].classList.toggle('on', on);
    const current = sample[7 + index];
    cells[2].textContent = current === null ? '–' : `${signed(current, 2)} A`;
    cells[3].textContent = temperatures[index] === null ? '–' : `${temperatures[index].toFixed(0)} °C`;
    cells[4].textContent = about.drives[index].role === 'steering' ? `${signed(degrees(position), 1)}°` : `${position.toFixed(2)} m`;
    cells[5].textContent = age === null ? 'never' : `${(age * 1000).toFixed(0)} ms`;
  });
}
function showInputs(inputs) {
  if ($('drives').hidden) return;
  $('inputs').replaceChildren(...inputs.map(([name, enabled, age]) => element('li', {}, element('b', {}, name), ` ${enabled ? 'held' : 'not held'}, ${age === null ? 'no data' : `last data ${(age * 1000).toFixed(0)} ms ago`}`)));
  if (!inputs.length) $('inputs').replaceChildren(element('li', {}, 'This mission has no inputs.'));
}

// ------------------------------------------------------------------------------------------ faults

const keyOf = fault => `${fault.id} ${fault.device}`;
let known = new Set();
const seen = new Set(); // which the tab was opened for: one that comes and goes does not take the view from the operator
export const forgetFaults = () => { known = new Set(); seen.clear(); };
export function showFaults(faults, past = false) {
  const panel = $('faults'), now = new Set(faults.map(keyOf));
  $('fault-count').textContent = faults.length;
  $('fault-count').classList.toggle('some', faults.some(fault => fault.severity >= 3));
  panel.replaceChildren(...faults.map(fault => element('article', {class: 'fault', 'data-severity': fault.severity},
    element('h3', {}, `${MARK[fault.severity]} ${fault.id} ${fault.text}`),
    element('p', {class: 'severity'}, SEVERITY[fault.severity]),
    element('dl', {}, ...[['look', fault.look], ['artemis', fault.artemis], ['next', fault.next]].filter(row => row[1]).flatMap(
      ([term, words]) => [element('dt', {}, term), element('dd', {}, words)])))));
  if (!faults.length) panel.replaceChildren(element('p', {class: 'calm'}, '✓ No faults.'));
  const fresh = faults.filter(fault => !known.has(keyOf(fault)) && fault.severity >= 3);
  if (fresh.length && !past) {
    if (fresh.some(fault => !seen.has(keyOf(fault)))) $('tab-faults').click();
    for (const fault of fresh) seen.add(keyOf(fault));
    announce(fresh.map(fault => `${SEVERITY[fault.severity]}: ${fault.id} ${fault.text}`).join('. '));
    if (navigator.userActivation?.hasBeenActive) navigator.vibrate?.(200);
  }
  known = now;
}

// ------------------------------------------------------------------------------------------ steps

function showSteps(tree) {
  const shown = tree ? branch(tree.steps ?? []) : element('p', {class: 'hint'}, 'The steps are unknown.');
  $('steps').replaceChildren(shown, element('p', {id: 'before', class: 'hint'}));
  markStep();
}
function branch(steps) {
  return element('ul', {class: 'tree'}, ...steps.map(step => element('li', {'data-path': step.path},
    element('span', {class: 'step'}, element('b', {}, step.word), step.text ? ` ${step.text}` : ''), ' ', element('small', {class: 'ran'}),
    step.steps ? branch(step.steps) : null,
    step.beside ? element('div', {class: 'arrow'}, element('em', {}, 'beside'), branch(step.beside)) : null,
    ...(step.arrows ?? []).map(arrow => element('div', {class: 'arrow'}, element('em', {}, arrow.label + (arrow.then ? ` → ${arrow.then}` : '')), arrow.steps.length ? branch(arrow.steps) : null)))));
}
let progress = {marks: {}, counts: [], before: ''};
export function showProgress(told) {
  progress = told;
  for (const item of $('steps').querySelectorAll('li')) item.querySelector(':scope > .ran').textContent = told.marks[item.dataset.path] ?? '';
  $('before').textContent = told.before ? `before: ${told.before}` : '';
}
function showRan(ran) {
  const here = $('steps').querySelector('[aria-current] > .ran');
  if (here && ran) here.textContent = [...progress.counts, `${ran[0]}x`, `${ran[1].toFixed(0)} s`].join(' · ');
}
function markStep() {
  const path = numbered[lastStep];
  const flat = !$('steps').querySelector('.tree .tree, .arrow');
  for (const item of $('steps').querySelectorAll('li')) {
    const here = item.dataset.path === path, place = numbered.indexOf(item.dataset.path);
    if (here) item.setAttribute('aria-current', 'step'); else item.removeAttribute('aria-current');
    item.classList.toggle('around', Boolean(path) && !here && path.startsWith(item.dataset.path));
    item.classList.toggle('past', flat && place >= 0 && lastStep > place);
  }
  $('steps').querySelector('[aria-current]')?.scrollIntoView?.({block: 'nearest'});
}

// ------------------------------------------------------------------------------------------ log

const LEVEL = {3: 'warning: ', 4: 'error: '};
export const worded = ({level, text}) => (LEVEL[level] ?? '') + text;
export function showLog(lines) {
  const list = $('log').querySelector('ol');
  for (const line of lines) {
    list.prepend(element('li', {'data-level': line.level},
      element('time', {}, `${line.time.toFixed(2)} s`), element('b', {}, line.kind), element('span', {}, worded(line))));
  }
  while (list.children.length > 300) list.lastElementChild.remove();
}
export function clearLog() { $('log').querySelector('ol').replaceChildren(); }

// ------------------------------------------------------------------------------------------ tabs

export function bindTabs(shown) {
  const tabs = [...document.querySelectorAll('[role=tab]')];
  const select = (tab, focus) => {
    for (const each of tabs) {
      const on = each === tab;
      each.setAttribute('aria-selected', on);
      each.tabIndex = on ? 0 : -1;
      $(each.getAttribute('aria-controls')).hidden = !on;
    }
    if (focus) tab.focus();
    shown(tab.getAttribute('aria-controls'));
  };
  tabs.forEach(tab => {
    tab.addEventListener('click', () => select(tab, false));
    tab.addEventListener('keydown', event => {
      const there = tabs.filter(each => !each.hidden), here = there.indexOf(tab);
      const to = {ArrowRight: here + 1, ArrowLeft: here - 1, Home: 0, End: there.length - 1}[event.key];
      if (to === undefined) return;
      event.preventDefault();
      select(there[(to + there.length) % there.length], true);
    });
  });
}
