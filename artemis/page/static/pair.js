// A code in the address is used at once, and taken out of it; a typed one when it is sent.
const said = document.getElementById('said'), field = document.getElementById('code');

async function pair(code) {
  said.textContent = 'Pairing…';
  try {
    const answer = await fetch('/pair', {
      method: 'POST', headers: {'content-type': 'application/json'}, body: JSON.stringify({code}),
    });
    if (answer.ok) { location.replace('/'); return; }
    const {problem} = await answer.json();
    said.textContent = problem ? `The robot’s computer takes no code now: ${problem}.` : 'This code is wrong, older than ten minutes, or was used already. ' +
      'On the robot’s computer, "artemis page pair" makes a new one.';
  } catch {
    said.textContent = 'The robot’s computer does not answer.';
  }
  field.focus();
}

document.getElementById('form').addEventListener('submit', event => { event.preventDefault(); pair(field.value); });
function pairByAddress() {
  const given = location.hash.slice(1);
  if (given) { history.replaceState(null, '', '/pair'); pair(given); }
}
window.addEventListener('hashchange', pairByAddress); // pasted where this page is open already
pairByAddress();
