// The best path through the phones, as scores come: Search of fapengine/recognition/small_recognizer.py. Stateful.

import { protocol } from "./constants.js";

const { MIN_FRAMES } = protocol;
const { fround } = Math;
const FIRST = -4; // score of each label but silence before the first frame

export class Search {
  // tables: bonus (C), order (C before x C after).
  constructor({ bonus, order }) {
    const count = (this.count = bonus.length);
    this.bonus = bonus;
    this.order = Float32Array.from(order, (_, index) => order[(index % count) * count + Math.floor(index / count)]); // after x before
    this.state = new Float32Array(MIN_FRAMES * count).fill(-Infinity);
    this.began = new Int32Array(MIN_FRAMES * count);
    this.before = []; // best label before each, of each frame at which it begins
    this.last = []; // frame at which each label began that may end, of each frame
    this.first = this.now = 0;
    this.row = new Float32Array(count);
  }

  // Adds the scores of one frame, which begin at a place; returns the best label and the logarithm of its probability.
  push(scores, at) {
    const { count, row, bonus } = this;
    let [top, sum, best] = [-Infinity, 0, 0];
    for (let label = 0; label < count; ++label) if (scores[at + label] > top) [top, best] = [scores[at + label], label];
    for (let label = 0; label < count; ++label) sum += fround(Math.exp(fround(scores[at + label] - top)));
    const log = fround(Math.log(fround(sum)));
    for (let label = 0; label < count; ++label) row[label] = fround(fround(scores[at + label] - top) - log) + bonus[label];
    this.step();
    return [best, -log];
  }

  step() {
    const { count, state, began, order, row, now } = this;
    const ending = (MIN_FRAMES - 1) * count;
    const [before, fresh, since] = [new Uint8Array(count), new Float32Array(MIN_FRAMES * count), new Int32Array(MIN_FRAMES * count)];
    for (let label = 0; label < count; ++label) {
      let [best, from] = [now || !label ? -Infinity : FIRST, 0];
      if (now === 0 && !label) best = 0;
      for (let other = 0, place = label * count; now && other < count; ++other, ++place) {
        const way = fround(state[ending + other] + order[place]);
        if (way > best) [best, from] = [way, other];
      }
      [before[label], fresh[label], since[label]] = [from, best, now];
    }
    fresh.set(state.subarray(0, ending), count);
    since.set(began.subarray(0, ending), count);
    for (let place = ending; place < fresh.length; ++place) {
      if (state[place] >= fresh[place]) [fresh[place], since[place]] = [state[place], began[place]];
    }
    let most = -Infinity;
    for (let place = 0; place < fresh.length; ++place) {
      fresh[place] += row[place % count];
      most = Math.max(most, fresh[place]);
    }
    for (let place = 0; place < fresh.length; ++place) fresh[place] -= most;
    [this.state, this.began] = [fresh, since];
    this.before.push(before);
    this.last.push(since.slice(ending));
    this.now += 1;
  }

  // The best path back to a frame: [number of the label, first frame, the one after the last].
  segments(told) {
    const { count, state } = this;
    let best = 0;
    state.forEach((value, place) => value > state[best] && (best = place));
    let [label, stop, first] = [best % count, this.now, this.began[best]];
    const found = [];
    while (stop > told) {
      found.push([label, Math.max(first, told), stop]);
      if (first <= Math.max(told, this.first)) break;
      [label, stop] = [this.before[first - this.first][label], first];
      first = this.last[stop - 1 - this.first][label];
    }
    return found.reverse();
  }

  // Drops the history of frames before one.
  forget(told) {
    const gone = Math.max(Math.min(told, this.now - 1) - this.first, 0);
    this.before.splice(0, gone);
    this.last.splice(0, gone);
    this.first += gone;
  }
}
