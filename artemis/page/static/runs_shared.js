// What the pages of past runs share: times, what the third process makes, and Stop for a robot that runs now.
import {bindStop, newId} from './browser.js';


export const place = id => `/runs/${id.split('/').map(encodeURIComponent).join('/')}`;
const two = number => String(number).padStart(2, '0');
export function clock(seconds, digits = 0) {
  const sign = seconds < 0 ? '−' : '', all = Math.abs(seconds), whole = Math.floor(all + 1e-6);
  const rest = digits ? (all - whole).toFixed(digits).slice(1) : '';
  const hours = Math.floor(whole / 3600), minutes = Math.floor(whole / 60) % 60;
  return `${sign}${hours ? `${hours}:${two(minutes)}` : minutes}:${two(whole % 60)}${rest}`;
}
export function longTime(seconds) {
  if (seconds < 60) return `${seconds.toFixed(1)} s`;
  return seconds < 3600 ? `${Math.floor(seconds / 60)} min ${Math.floor(seconds % 60)} s` : `${Math.floor(seconds / 3600)} h ${Math.floor(seconds / 60) % 60} min`;
}

const wait = time => new Promise(done => setTimeout(done, time));
export async function stateOf(id, what) { return (await fetch(`${place(id)}/${what}`)).json(); }
export async function makeIt(id, what, tell) { // true: it is there; else it was told why not
  let method = 'POST';
  for (;;) {
    let made;
    try {
      const answer = await fetch(`${place(id)}/${what}`, {method});
      if (answer.status === 403) { location.replace('/pair'); return false; }
      if (!answer.ok) { tell('this run does not exist'); return false; }
      made = await answer.json();
    } catch {
      tell('not connected: trying again');
      await wait(1500);
      continue;
    }
    if (made.state === 'ready' || (made.state === 'making' && made.share !== null)) { tell(''); return true; } // a part can be shown already
    if (made.state === 'failed') { tell(`it could not be made: ${made.problem}`); return false; }
    method = made.state === 'none' ? 'POST' : 'GET'; // none: the server was started again
    tell(made.state === 'making' ? `${what} is being made …` : `${what} waits for others that are being made …`);
    await wait(400);
  }
}

// By requests alone, as these pages have no connection for commands: the same press again until it is confirmed.
const STOP_AGAIN = 300, STOP_FOR = 30000; // [ms]
export function bindStopNow() {
  const banner = document.getElementById('banner');
  let newest = '';
  bindStop(async () => {
    const id = newest = newId(), begun = performance.now();
    const say = words => { if (id === newest) { banner.textContent = words; banner.hidden = false; } };
    while (id === newest && performance.now() - begun < STOP_FOR) {
      let status = 0;
      try {
        status = (await fetch('/stop', {method: 'POST', body: JSON.stringify({t: 'stop', id}), keepalive: true, signal: AbortSignal.timeout(1000)})).status;
      } catch { /* not there at present */ }
      if (status === 202) { say('Stop was sent to the robot.'); return; }
      if (status === 403 || status === 404) { say(status === 403 ? 'Stop was refused: pair this browser again. Use the emergency stop on the robot.' : 'No run is active here.'); return; }
      say(`Stop is not confirmed${status === 503 ? ': no run is active' : ''}. It is sent again. Use the emergency stop on the robot.`);
      await wait(STOP_AGAIN);
    }
    say('Stop was not confirmed. Use the emergency stop on the robot.');
  });
}
