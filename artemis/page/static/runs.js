// The list of past runs: what each was, and its replay, report and files.
import {element} from './browser.js';
import {bindStopNow, longTime, makeIt, place} from './runs_shared.js';

const $ = id => document.getElementById(id);
const AGAIN = 700, COUNT = 40;
let wanted = COUNT, shown = new Map(), chosen = [], timer = null, failures = 0;
bindStopNow();

async function load() {
  clearTimeout(timer);
  const runs = [];
  let all = 0;
  try {
    for (let skip = 0; skip < wanted; skip += COUNT) {
      const answer = await fetch(`/runs/list?skip=${skip}&count=${Math.min(COUNT, wanted - skip)}`);
      if (answer.status === 403) { location.replace('/pair'); return; }
      const part = await answer.json();
      all = part.all;
      runs.push(...part.runs);
      if (runs.length >= all) break;
    }
    failures = 0;
  } catch { // not there at present
    failures++;
    $('number').textContent = 'not connected';
    timer = setTimeout(load, Math.min(8000, AGAIN * 2 ** failures));
    return;
  }
  show(runs, all);
  const busy = runs.some(run => run.facts === null), live = runs.some(run => run.facts?.state === 'running');
  if (busy || live) timer = setTimeout(load, busy ? AGAIN : 10000);
}

function show(runs, all) {
  $('number').textContent = `${all} run${all === 1 ? '' : 's'}`;
  $('none').hidden = all > 0;
  $('more').hidden = runs.length >= all;
  $('both').hidden = all < 2;
  const list = $('list'), known = shown;
  shown = new Map();
  runs.forEach((run, index) => {
    const told = JSON.stringify(run);
    let item = known.get(run.id);
    if (item?.told !== told) {
      const made = line(run), focus = item?.row.contains(document.activeElement) ? document.activeElement.dataset.act : null;
      if (item) item.row.replaceWith(made);
      item = {told, row: made};
      if (focus) made.querySelector(`[data-act="${focus}"]`)?.focus();
    }
    if (list.children[index] !== item.row) list.insertBefore(item.row, list.children[index] ?? null);
    shown.set(run.id, item);
  });
  while (list.children.length > runs.length) list.lastElementChild.remove();
  showChosen();
}

const when = text => text ? new Date(text).toLocaleString(undefined, {dateStyle: 'medium', timeStyle: 'medium'}) : '';
function line({id, name, facts}) {
  if (!facts) return element('li', {class: 'run'}, element('h2', {}, name), element('p', {class: 'hint'}, 'reading …'));
  const over = facts.state !== 'running', normal = facts.outcome === 'done' || facts.outcome === 'ended normally';
  const faults = Object.entries(facts.faults), number = faults.reduce((all, [, times]) => all + times, 0);
  const outcome = {running: 'is running', unfinished: 'interrupted'}[facts.state] ?? facts.outcome;
  const sign = facts.state === 'running' ? '▶' : normal ? '✓' : '✖', title = facts.mission || name;
  const box = element('input', {type: 'checkbox', 'data-act': 'choose', 'aria-label': `Choose ${title}, ${when(facts.start)}`});
  box.checked = chosen.includes(id);
  box.disabled = !over;
  box.addEventListener('change', () => choose(id, box.checked));
  box.addEventListener('keydown', event => { if (event.key === 'Enter') box.click(); }); // the space bar is Stop
  const row = element('li', {class: 'run', 'data-run': id},
    element('label', {class: 'choose'}, box),
    element('div', {class: 'told'},
      element('h2', {}, title, facts.simulated ? element('span', {class: 'tag'}, 'simulation') : null),
      element('p', {}, element('time', {datetime: facts.start}, when(facts.start)), facts.robot ? ` · ${facts.robot}` : ''),
      element('p', {class: `outcome ${normal ? 'good' : over ? 'bad' : ''}`}, `${sign} ${outcome || 'ended'}`),
      facts.problem ? element('p', {class: 'damaged'}, `⚠ Incomplete: ${facts.problem}`) : null,
      faults.length ? element('details', {}, element('summary', {}, `✖ ${number} fault${number === 1 ? '' : 's'}`),
        element('ul', {}, ...faults.map(([text, times]) => element('li', {}, times > 1 ? `${text} (${times} times)` : text)))) : null),
    element('dl', {},
      element('div', {}, element('dt', {}, 'Duration'), element('dd', {}, longTime(facts.duration))),
      element('div', {}, element('dt', {}, 'Distance'), element('dd', {}, facts.distance === null ? '–' : `${facts.distance.toFixed(1)} m`))),
    acts(id, title, over));
  return row;
}

function acts(id, title, over) {
  const said = element('span', {class: 'made', role: 'status'});
  const report = element('button', {type: 'button', 'data-act': 'report', 'aria-label': `Report of ${title}`, disabled: !over}, 'Report');
  report.addEventListener('click', async () => {
    report.disabled = true;
    const made = await makeIt(id, 'report', words => { said.textContent = words; });
    report.disabled = false;
    said.textContent = made ? 'the report is ready: ' : said.textContent;
    if (!made) return;
    said.append(element('a', {href: `${place(id)}/report.html`, target: '_blank', rel: 'noopener'}, 'open it'));
    if (!window.open(`${place(id)}/report.html`, '_blank')) said.lastElementChild.focus();
  });
  return element('div', {class: 'row acts'},
    over ? element('a', {class: 'link primary', 'data-act': 'replay', href: `/runs/replay?run=${encodeURIComponent(id)}`, 'aria-label': `Replay of ${title}`}, 'Replay')
      : element('a', {class: 'link', 'data-act': 'replay', href: '/'}, 'Live page'),
    report,
    element('a', {class: 'link', 'data-act': 'download', href: `${place(id)}/run.zip`, download: '', 'aria-label': `Download all files of ${title}`}, 'Download'), said);
}

function choose(id, on) {
  chosen = chosen.filter(each => each !== id);
  if (on) chosen.push(id);
  if (chosen.length > 2) {
    const box = shown.get(chosen.shift())?.row.querySelector('input');
    if (box) box.checked = false;
  }
  showChosen();
}
function showChosen() {
  chosen = chosen.filter(id => shown.has(id));
  $('replay-both').disabled = chosen.length !== 2;
  $('chosen').textContent = chosen.length === 0 ? 'Select two runs to replay them together.' : chosen.length === 1 ? 'One run selected: select another.' : 'Two runs selected.';
}
$('replay-both').addEventListener('click', () => { location.href = `/runs/replay?run=${encodeURIComponent(chosen[0])}&with=${encodeURIComponent(chosen[1])}`; });
$('more').addEventListener('click', () => { wanted += COUNT; load(); });
load();
