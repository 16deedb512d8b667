// A robot that waits: the missions of its folder, who has control, what was started, and how that ended.
import {bindInvite, browserName, element, reloadIfOther} from './browser.js';

const $ = id => document.getElementById(id);
const RETRY = 500, READ = 1000;
let socket = null, told = null, sureAbout = null;

const write = (id, words) => { if ($(id).textContent !== words) $(id).textContent = words; };
const say = message => { if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message)); };

function connect() {
  socket = new WebSocket(`${location.protocol === 'https:' ? 'wss://' : 'ws://'}${location.host}/waiting`);
  socket.onmessage = event => { told = JSON.parse(event.data); document.body.dataset.link = 'ok'; show(); };
  socket.onclose = () => {
    document.body.dataset.link = 'none';
    write('state', told?.run ? 'opening the page of the run' : 'not connected');
    ask(null);
    for (const button of document.querySelectorAll('main button')) button.disabled = true;
    reloadIfOther('/missions');
    setTimeout(connect, RETRY);
  };
}

// ------------------------------------------------------------------------------------------ what is there

const STATES = {waiting: 'ready', starting: 'run starting', running: 'run active', ending: 'run ending'};

function show() {
  const {folder, note, state, seat, run, last} = told;
  write('folder', folder);
  write('state', STATES[state]);
  $('note').hidden = !note;
  write('note', note);
  document.body.classList.toggle('mine', seat.mine);
  $('take').hidden = seat.mine;
  $('take').disabled = Boolean(seat.who);
  $('give').hidden = !seat.mine;
  $('give').disabled = $('check').disabled = $('invite').disabled = $('cancel').disabled = false;
  write('seat', seat.mine ? 'You have control: you may start a mission.' : seat.who ? `${seat.who} has control. You can watch.` : 'No operator has control.');
  const refused = seat.refused ? `Refused: ${seat.refused}.` : '';
  write('banner', refused);
  $('banner').hidden = !refused;
  showRun(run, state);
  showLast(last);
  showMissions();
  ask(seat.asked);
}

function showLines(id, lines) {
  const place = $(id), text = lines.join('\n');
  if (place.textContent === text) return;
  place.textContent = text;
  place.scrollTop = place.scrollHeight;
}
function showRun(run, state) {
  $('run').hidden = !run;
  if (!run) return;
  write('run-title', state === 'ending' ? `${run.mission} is ending` : `${run.mission} is starting`);
  const cancelled = run.cancelled === null ? '' : `It was asked to end, and is killed if it has not ended within ${run.cancelled} s. `;
  write('run-status', cancelled + (state === 'ending' ? 'The drives are disabled; summary and report are being written. If that takes too long, do not wait for them: the report can be created later under Past runs.' : cancelled ? 'No drive was enabled.' : `Started by ${run.who}. When it is ready, its page opens here; nothing moves before an operator arms there.`));
  showLines('run-lines', run.lines);
  write('cancel', state === 'ending' ? 'Do not wait for its report' : 'Cancel the start');
  $('cancel').hidden = state !== 'starting' && state !== 'ending';
}
function showLast(last) {
  $('last').hidden = !last;
  if (!last) return;
  $('last').dataset.well = last.status === 0 ? 'yes' : 'no';
  $('last-run').hidden = $('past').hidden || last.status === 2; // what was refused left no run
  write('last-title', `${last.status === 0 ? '✓' : '✖'} ${last.mission || last.file}: ${last.outcome}`);
  write('last-how', `exit status ${last.status}, ${new Date(last.date).toLocaleString()}, started by ${last.who}`);
  showLines('last-lines', last.lines);
}

// ------------------------------------------------------------------------------------------ missions

const cards = new Map(); // by file: what it was made from, and its element
function showMissions() {
  const mine = told.seat.mine && told.state === 'waiting', shown = new Set(), list = $('missions');
  told.missions.forEach((mission, place) => {
    const key = JSON.stringify([mission, mine]);
    let card = cards.get(mission.file);
    if (card?.key !== key) {
      const open = card?.made.querySelector('details')?.open, focused = card?.made.contains(document.activeElement);
      const made = cardOf(mission, mine);
      if (open !== undefined && made.querySelector('details')) made.querySelector('details').open = open;
      if (card) card.made.replaceWith(made);
      if (focused) made.querySelector('button, summary')?.focus();
      cards.set(mission.file, card = {key, made});
    }
    if (list.children[place] !== card.made) list.insertBefore(card.made, list.children[place] ?? null);
    shown.add(mission.file);
  });
  for (const [file, card] of cards) if (!shown.has(file)) { card.made.remove(); cards.delete(file); }
  const empty = told.missions.length === 0 && !told.note;
  if (empty) { $('note').hidden = false; write('note', 'There is no mission in this folder.'); }
}

function cardOf(mission, mine) {
  const {file, problems, remarks, checked, simulated, may_start: good} = mission;
  const kind = !checked ? 'unknown' : !good ? 'wrong' : simulated ? 'simulated' : 'real';
  const title = element('h3', {id: `mission-${file}`}, mission.mission || file);
  const where = element('p', {class: 'where'}, element('span', {}, file));
  if (mission.robot) where.append(element('span', {}, 'robot ', element('b', {}, mission.robot)));
  if (mission.bus) where.append(element('span', {class: simulated ? 'simulated' : 'real'}, simulated ? 'simulated' : `real, on ${mission.bus}`));
  if (!checked) where.append(element('span', {}, 'checking…'));
  const made = element('li', {class: `mission ${kind}`, 'aria-labelledby': `mission-${file}`}, title, where);
  if (mission.about) made.append(element('p', {}, mission.about));
  if (checked && problems.length) {
    made.append(element('details', {open: problems.length <= 3}, element('summary', {}, problems.length === 1 ? 'One error' : `${problems.length} errors`),
      element('ul', {class: 'problems'}, ...problems.map(words => element('li', {}, words)))));
  } else if (remarks.length) {
    made.append(element('details', {}, element('summary', {}, 'Remarks'), element('ul', {class: 'problems'}, ...remarks.map(words => element('li', {}, words)))));
  }
  const button = element('button', {type: 'button', disabled: !(mine && good), 'aria-label': `Start ${mission.mission || file}`, class: good ? 'primary' : null}, simulated || !good ? 'Start' : 'Start…');
  button.addEventListener('click', () => say({t: 'start', file, hash: mission.hash}));
  made.append(button);
  return made;
}

// ------------------------------------------------------------------------------------------ a real robot: asked once more

function ask(file) {
  const mission = file && told.missions.find(each => each.file === file);
  if (!mission) {
    sureAbout = null;
    if ($('sure').open) $('sure').close();
    return;
  }
  if (sureAbout?.file === file && sureAbout.hash === mission.hash) return;
  sureAbout = mission;
  $('sure-text').textContent = `${mission.mission} runs on the robot ${mission.robot}, on ${mission.bus}. It is not simulated.`;
  $('start-real').disabled = true;
  setTimeout(() => { $('start-real').disabled = false; }, READ);
  if (!$('sure').open) $('sure').showModal();
}
$('start-real').addEventListener('click', () => { if (sureAbout) say({t: 'confirm', file: sureAbout.file, hash: sureAbout.hash}); });
$('not-sure').addEventListener('click', () => $('sure').close());
$('sure').addEventListener('close', () => { if (sureAbout) { sureAbout = null; say({t: 'cancel'}); } });

$('take').addEventListener('click', () => say({t: 'take', who: browserName()}));
$('give').addEventListener('click', () => say({t: 'release'}));
$('cancel').addEventListener('click', () => say({t: 'cancel'}));
$('check').addEventListener('click', () => say({t: 'check'}));
bindInvite();
fetch('/runs/', {method: 'HEAD'}).then(answer => { $('past').hidden = !answer.ok; showLast(told?.last); }, () => {});
connect();
