// One past run: its index, and its pieces as far as they are needed.
import {place} from './runs_shared.js';

const KEPT = 12, AGAIN = 1500;
const before = (list, time, of = value => value) => { // how many of a sorted list are not after a time
  let low = 0, high = list.length;
  while (low < high) { const middle = (low + high) >> 1; if (of(list[middle]) <= time) low = middle + 1; else high = middle; }
  return low;
};
async function got(id, file) {
  const answer = await fetch(`${place(id)}/replay/${file}`);
  if (!answer.ok) throw new Error(`${file}: ${answer.status}`);
  return answer.json();
}

export class PastRun {
  static async open(id) {
    const index = await got(id, 'index');
    return new PastRun(id, index, index.map ? await got(id, 'map') : null);
  }
  constructor(id, index, map) {
    Object.assign(this, {id, map, about: index.about, begin: index.begin, end: index.end, pieces: new Map(), asked: new Set(), failed: ''});
    this.arrived = () => {};
    this.take(index);
  }
  take(index) {
    this.index = index;
    this.trail = index.trail.filter(Boolean);
    this.cuts = []; // where poses begin that are of another frame
    for (const [at, point] of index.trail.entries()) if (!point) this.cuts.push(at - this.cuts.length);
  }
  // Goes on with a run that is still being made; true: there is more of it.
  async more() {
    const pieces = this.index.pieces.length, index = await got(this.id, 'index');
    if (index.map && !this.map) this.map = await got(this.id, 'map');
    this.take(index);
    return index.whole || index.pieces.length !== pieces;
  }
  // What was at a time: {state, parts}, or null while it is being loaded.
  at(time, ahead = 1) {
    if (!this.index.whole && time > this.index.known) return null; // not made yet
    const number = Math.max(0, before(this.index.pieces, time + 1e-6) - 1), piece = this.piece(number);
    for (let next = 1; next <= ahead; next++) if (number + next < this.index.pieces.length) this.piece(number + next);
    if (!piece) return null;
    const place = Math.max(0, before(piece.states, time + 1e-6, each => each[0]) - 1);
    const [from, state] = piece.states[place], [to, next] = piece.states[place + 1] ?? [from, state], parts = {};
    for (const [when, part] of piece.parts) { if (when > Math.max(time, from) + 1e-6) break; Object.assign(parts, part); }
    return {state: between(state, next, from, to, time), parts};
  }
  piece(number) {
    const piece = this.pieces.get(number);
    if (piece) { this.pieces.delete(number); this.pieces.set(number, piece); return piece; } // the newest is the last
    if (!this.asked.has(number)) this.load(number);
    return null;
  }
  async load(number) {
    this.asked.add(number);
    try {
      const {states, parts} = await got(this.id, number);
      let state = {};
      this.pieces.set(number, {parts, states: states.map(([time, changed]) => [time, state = {...state, ...changed}])});
      if (this.pieces.size > KEPT) this.pieces.delete(this.pieces.keys().next().value);
      this.failed = '';
    } catch (error) {
      this.failed = error.message;
      await new Promise(done => setTimeout(done, AGAIN));
    }
    this.asked.delete(number);
    this.arrived();
  }
  // What was driven until a time, in the frame of the poses then.
  trailUntil(time) {
    const end = before(this.trail, time, point => point[0]), cut = before(this.cuts, end - 1);
    return this.trail.slice(cut ? this.cuts[cut - 1] : 0, end).map(([, x, y]) => [x, y]);
  }
  get points() { return this.trail.slice(this.cuts.at(-1) ?? 0).map(([, x, y]) => [x, y]); }
  get began() { // names of steps, with when they began first
    const found = new Map();
    for (const [time, number, name] of this.index.steps) if (name && !found.has(`${number + 1} ${name}`)) found.set(`${number + 1} ${name}`, time);
    return found;
  }
}

const turned = angle => Math.atan2(Math.sin(angle), Math.cos(angle));
function between(state, next, from, to, time) {
  const share = to > from ? Math.min(1, Math.max(0, (time - from) / (to - from))) : 0;
  if (!share || state.frame !== next.frame || state.lost || next.lost) return state;
  const mix = (a, b) => a + share * (b - a), [x, y, heading] = state.pose, [X, Y, Heading] = next.pose;
  if (Math.hypot(X - x, Y - y) > 0.5) return state; // a pose that was corrected does not travel
  return {...state, pose: [mix(x, X), mix(y, Y), heading + share * turned(Heading - heading)], wheels: state.wheels.map((angle, side) => mix(angle, next.wheels[side]))};
}
