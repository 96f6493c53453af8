// The small recognizer's network on a stream: SmallNet of fapengine/recognition/small_net.py.

import { small_net } from "./constants.js";
import { newKernel } from "./kernel.js";

const { FRONT, PAIR } = small_net;
const ROWS = 4;
const PLAIN = { place: (matrix) => matrix, run: (...given) => multiply(...given) };

// Matrices as float64 numbers, so that the inner loop converts nothing; rows of zeros fill them up to a multiple of four.
export function matrixOf(arrays, name) {
  const { [`${name}.matrix`]: rows, [`${name}.scale`]: scale, [`${name}.bias`]: offsets } = arrays;
  const [outputs, inputs] = [offsets.length, rows.length / offsets.length];
  const whole = Math.ceil(outputs / ROWS) * ROWS;
  const [weights, bias] = [new Float64Array(whole * inputs), new Float64Array(whole)];
  bias.set(offsets);
  for (let index = 0; index < rows.length; ++index) weights[index] = rows[index] * scale[Math.floor(index / inputs)];
  return { weights, bias, inputs, outputs, given: new Float64Array(inputs) };
}

// out = matrix x input + bias, for every step; each input is read once for four rows.
export function multiply({ weights, bias, inputs, outputs, given }, input, out, steps) {
  for (let step = 0, to = 0; step < steps; ++step, to += outputs) {
    given.set(input.subarray(step * inputs, (step + 1) * inputs));
    for (let row = 0; row < outputs; row += ROWS) {
      let [a, b, c, d] = [bias[row], bias[row + 1], bias[row + 2], bias[row + 3]];
      let first = row * inputs;
      let [second, third, fourth] = [first + inputs, first + 2 * inputs, first + 3 * inputs];
      for (let index = 0; index < inputs; ++index) {
        const value = given[index];
        a += value * weights[first++];
        b += value * weights[second++];
        c += value * weights[third++];
        d += value * weights[fourth++];
      }
      out[to + row] = a;
      if (row + 1 < outputs) out[to + row + 1] = b;
      if (row + 2 < outputs) out[to + row + 2] = c;
      if (row + 3 < outputs) out[to + row + 3] = d;
    }
  }
}

function normalise(values, out, width) {
  for (let from = 0; from < values.length; from += width) {
    let power = 0;
    for (let index = from; index < from + width; ++index) power += values[index] * values[index];
    const scale = 1 / Math.sqrt(power / width + 1e-5);
    for (let index = from; index < from + width; ++index) out[index] = values[index] * scale;
  }
}

function rectify(values) {
  for (let index = 0; index < values.length; ++index) if (values[index] < 0) values[index] = 0;
}

// The last steps that a layer needs. Stateful.
class Kept {
  constructor(offsets, width, steps) {
    const least = Math.min(...offsets);
    Object.assign(this, { width, steps, rows: offsets.map((offset) => offset - least) });
    this.values = new Float32Array((Math.max(...offsets, 0) - least + steps) * width);
    this.out = new Float32Array(steps * offsets.length * width);
  }

  // Adds steps; returns the inputs of those that are due.
  push(added) {
    const { width, steps, rows, values, out } = this;
    values.copyWithin(0, steps * width);
    values.set(added, values.length - steps * width);
    for (let step = 0; step < steps; ++step) {
      rows.forEach((row, number) => out.set(values.subarray((row + step) * width, (row + step + 1) * width), (step * rows.length + number) * width));
    }
    return out;
  }
}

// Stateful. steps: of 20 ms, that are run at a time.
export class SmallNet {
  constructor({ offsets, arrays }, steps) {
    this.steps = steps;
    this.kernel = newKernel() ?? PLAIN;
    const placed = (name) => this.kernel.place(matrixOf(arrays, name));
    this.front = placed("front");
    this.head = placed("head");
    const channels = (this.channels = this.front.outputs);
    this.seen = new Kept(FRONT, PAIR, steps);
    this.layers = offsets.map((places, number) => {
      const late = Math.max(...places);
      return {
        late, near: new Kept(places, channels, steps), delayed: late ? new Kept([-late], channels, steps) : null,
        mix: placed(`mix${number}`), out: placed(`out${number}`),
      };
    });
    [this.x, this.h, this.y] = [0, 1, 2].map(() => new Float32Array(steps * channels));
    this.scores = new Float32Array(steps * this.head.outputs);
    this.reset();
  }

  reset() {
    this.now = -FRONT.at(-1); // number of the first step that the first layer gives next
    for (const kept of [this.seen, ...this.layers.flatMap(({ near, delayed }) => [near, delayed])]) kept?.values.fill(0);
  }

  // Takes 2 * steps frames; returns the scores of as many, small_net.AHEAD steps before.
  push(frames) {
    const { x, h, y, channels, steps, kernel } = this;
    kernel.run(this.front, this.seen.push(frames), x, steps);
    rectify(x);
    let first = this.now;
    this.now += steps;
    const forget = () => first < 0 && x.fill(0, 0, Math.min(-first, steps) * channels);
    forget();
    for (const { late, near, delayed, mix, out } of this.layers) {
      normalise(x, h, channels);
      const input = near.push(h);
      if (delayed) x.set(delayed.push(x));
      first -= late;
      kernel.run(mix, input, h, steps);
      rectify(h);
      kernel.run(out, h, y, steps);
      for (let index = 0; index < x.length; ++index) x[index] += y[index];
      forget();
    }
    normalise(x, h, channels);
    kernel.run(this.head, h, this.scores, steps);
    return this.scores;
  }
}
