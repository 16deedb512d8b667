// What the pages of a run and of a robot that waits have in common: this browser's name, pairing another one, and which page is served.
const $ = id => document.getElementById(id);

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
