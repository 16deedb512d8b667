// The time line: modes, steps and faults of a run, and where the replay is. A slider for hands, keys and screen readers.
import {clock} from './runs_shared.js';

const MODES = {init: '#b8c4d0', ready: '#9ccbac', calibrate: '#dcb850', teleop: '#b09ad8', follow: '#7db2e3', act: '#dc9cbf', quickstop: '#f0a058', fault: '#e0525e', end: '#aab0b6'};
const LANE = 20, GAP = 3, FAULT = 16, AXIS = 18, FONT = '12px system-ui, "DejaVu Sans", sans-serif';
const box = document.getElementById('line'), canvas = box.querySelector('canvas'), pen = canvas.getContext('2d');
let runs = [], begin = 0, end = 1, now = 0, seek = () => {}, dirty = true;

// Each run: {modes, steps, faults, end}, and `shift`: added to its times.
export function showRuns(shown) {
  runs = shown;
  begin = runs[0].begin;
  end = Math.max(runs[0].end, begin + 0.1);
  box.setAttribute('aria-valuemin', begin);
  box.setAttribute('aria-valuemax', end);
  box.style.height = `${FAULT + runs.length * (LANE + GAP) + LANE + GAP + AXIS}px`;
  dirty = true;
}
export function showTime(time, words) {
  now = time;
  box.setAttribute('aria-valuenow', time.toFixed(1));
  box.setAttribute('aria-valuetext', words);
  dirty = true;
}

export function bindLine(onSeek) {
  seek = onSeek;
  const go = event => {
    const place = box.getBoundingClientRect();
    seek(begin + (end - begin) * Math.min(1, Math.max(0, (event.clientX - place.left) / place.width)));
  };
  let held = null;
  box.addEventListener('pointerdown', event => { if (event.button > 0) return; held = event.pointerId; box.setPointerCapture(held); go(event); });
  box.addEventListener('pointermove', event => { if (event.pointerId === held) go(event); });
  for (const kind of ['pointerup', 'pointercancel', 'lostpointercapture']) box.addEventListener(kind, () => { held = null; });
  new ResizeObserver(() => { dirty = true; }).observe(box);
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => { dirty = true; });
  requestAnimationFrame(draw);
}

function draw() {
  requestAnimationFrame(draw);
  if (!dirty || !runs.length) return;
  dirty = false;
  const ratio = devicePixelRatio || 1, {width, height} = box.getBoundingClientRect(), style = getComputedStyle(document.documentElement);
  const colour = name => style.getPropertyValue(`--${name}`).trim(), x = time => (time - begin) / (end - begin) * width;
  [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  Object.assign(pen, {font: FONT, textBaseline: 'middle'});
  const block = (from, to, top, fill, words, ink) => {
    const left = Math.max(x(from), 0), wide = Math.min(x(to), width) - left;
    if (wide < 0 || left > width) return;
    pen.fillStyle = fill;
    pen.fillRect(left, top, Math.max(wide, 1), LANE);
    if (wide < 26) return;
    pen.save();
    pen.beginPath(); pen.rect(left, top, wide - 3, LANE); pen.clip();
    pen.fillStyle = ink;
    pen.fillText(words, left + 4, top + LANE / 2 + 1);
    pen.restore();
  };
  let top = FAULT;
  runs.forEach(({modes, shift, end: last, letter}) => {
    modes.forEach(([time, mode], at) => block(time + shift, (modes[at + 1]?.[0] ?? last) + shift, top, MODES[mode] ?? MODES.end, letter ? `${letter} ${mode}` : mode, '#15202b'));
    top += LANE + GAP;
  });
  const {steps, end: last} = runs[0], shades = [colour('line'), colour('ground')];
  steps.forEach(([time, number, name], at) => { if (name) block(time, steps[at + 1]?.[0] ?? last, top, shades[at % 2], `${number + 1} ${name}`, colour('text')); });
  top += LANE + GAP;
  pen.fillStyle = colour('stop');
  for (const [time] of runs[0].faults) {
    pen.beginPath(); pen.moveTo(x(time) - 6, 1); pen.lineTo(x(time) + 6, 1); pen.lineTo(x(time), 14); pen.fill();
  }
  pen.fillStyle = colour('soft');
  let step = 1;
  for (const each of [1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400]) { step = each; if (x(begin + each) > 70) break; }
  for (let time = Math.ceil(begin / step) * step; x(time) < width - 30; time += step) { pen.fillRect(x(time), top, 1, 4); pen.fillText(clock(time), x(time) + 3, top + 10); }
  pen.fillStyle = colour('text');
  pen.fillRect(Math.min(Math.max(x(now) - 1, 0), width - 2), 0, 2, height);
  pen.beginPath(); pen.arc(Math.min(Math.max(x(now), 5), width - 5), height - 6, 5, 0, 7); pen.fill();
}
