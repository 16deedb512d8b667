// What all pages have in common: elements, this browser's name, Stop by button and by key, pairing another browser, and which page is served.
const $ = id => document.getElementById(id);

export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) if (value !== null && value !== false) made.setAttribute(key, value === true ? '' : value);
  made.append(...children.filter(child => child !== null));
  return made;
}

export const newId = () => Array.from(crypto.getRandomValues(new Uint8Array(8)), byte => byte.toString(16).padStart(2, '0')).join('');

// Space and Escape are Stop wherever the focus is, and press nothing else; where text is typed only Escape is.
const TYPED = 'textarea, input:not([type=range], [type=checkbox])';
export function bindStop(stop) {
  const isStop = event => event.key === 'Escape' || (event.key === ' ' && !(event.target instanceof Element && event.target.closest(TYPED)));
  window.addEventListener('keydown', event => {
    if (!isStop(event)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (!event.repeat) stop();
  }, true);
  window.addEventListener('keyup', event => { if (isStop(event)) event.preventDefault(); }, true); // Firefox presses a button then
  $('stop').addEventListener('pointerdown', event => { if (event.button > 0) return; event.preventDefault(); stop(); });
  $('stop').addEventListener('click', event => { if (event.detail === 0) stop(); }); // Enter, switch, screen reader
}

export function browserName() {
  const agent = navigator.userAgent;
  const browser = /Firefox/.test(agent) ? 'Firefox' : /Edg/.test(agent) ? 'Edge' : /Chrom/.test(agent) ? 'Chromium' : /Safari/.test(agent) ? 'Safari' : 'a browser';
  return browser + (/Android|iPhone|Mobile/.test(agent) ? ' on a phone' : /iPad/.test(agent) ? ' on a tablet' : '');
}

// The connection has ended. A run has begun or ended: another page is served here, which does not know what this one asks for.
export async function reloadIfOther(own) {
  try {
    const answer = await fetch(own);
    if (answer.status === 403) location.replace('/pair');
    if (answer.status === 404) location.reload();
  } catch { /* not there */ }
}

export function bindInvite() {
  $('invite').addEventListener('click', async () => {
    const answer = await fetch('/invite', {method: 'POST'});
    if (!answer.ok) return;
    const {url, code, rows} = await answer.json(), canvas = $('qr'), edge = 4, size = rows.length + 2 * edge, dot = 5;
    canvas.width = canvas.height = size * dot;
    const pen = canvas.getContext('2d');
    pen.fillStyle = '#fff'; pen.fillRect(0, 0, size * dot, size * dot);
    pen.fillStyle = '#000';
    rows.forEach((row, y) => [...row].forEach((dark, x) => { if (dark === '1') pen.fillRect((x + edge) * dot, (y + edge) * dot, dot, dot); }));
    $('qr-url').textContent = $('qr-url').href = url;
    $('qr-code').textContent = code;
    $('invitation').hidden = false;
  });
}
