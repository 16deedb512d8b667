// What the pages of past runs share: elements, times, what the third process makes, and Stop for a robot that runs now.
export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) if (value !== null && value !== false) made.setAttribute(key, value === true ? '' : value);
  made.append(...children.filter(child => child !== null && child !== undefined));
  return made;
}

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
      if (!answer.ok) { tell('there is no such run'); return false; }
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

const newId = () => Array.from(crypto.getRandomValues(new Uint8Array(8)), byte => byte.toString(16).padStart(2, '0')).join('');
export function bindStop() { // by a request alone: these pages have no connection for commands
  const button = document.getElementById('stop'), banner = document.getElementById('banner');
  const say = words => { banner.textContent = words; banner.hidden = !words; };
  const stop = async () => {
    const id = newId();
    let words = 'Stop was not confirmed. Use the emergency stop on the robot.';
    try {
      const answer = await fetch('/stop', {method: 'POST', body: JSON.stringify({t: 'stop', id}), keepalive: true, signal: AbortSignal.timeout(1000)});
      if (answer.status === 202) words = 'Stop was sent to the robot.';
      else if (answer.status === 503) words = 'No run takes Stop at present.';
    } catch { /* it was not confirmed */ }
    say(words);
  };
  button.addEventListener('pointerdown', event => { if (event.button > 0) return; event.preventDefault(); stop(); });
  button.addEventListener('click', event => { if (event.detail === 0) stop(); });
}
