// The small recognizer's network on a stream: SmallNet of fapengine/recognition/small_net.py.

import { small_net } from "./constants.js";

const { FRONT, PAIR } = small_net;

// Matrices as float64 numbers, so that the inner loop converts nothing.
function matrixOf(arrays, name) {
  const { [`${name}.matrix`]: rows, [`${name}.scale`]: scale, [`${name}.bias`]: bias } = arrays;
  const [outputs, inputs] = [bias.length, rows.length / bias.length];
  const weights = Float64Array.from(rows, (value, index) => value * scale[Math.floor(index / inputs)]);
  return { weights, bias: Float64Array.from(bias), inputs, outputs, given: new Float64Array(inputs) };
}

// out = matrix x input + bias, for every step; two rows of the matrix at a time.
function multiply({ weights, bias, inputs, outputs, given }, input, out, steps) {
  for (let step = 0; step < steps; ++step) {
    given.set(input.subarray(step * inputs, (step + 1) * inputs));
    const to = step * outputs;
    for (let row = 0; row < outputs; row += 2) {
      let [one, other] = [bias[row], bias[row + 1]];
      for (let index = 0, at = row * inputs; index < inputs; ++index, ++at) {
        const value = given[index];
        one += value * weights[at];
        other += value * weights[at + inputs];
      }
      out[to + row] = one;
      if (row + 1 < outputs) out[to + row + 1] = other;
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
    this.front = matrixOf(arrays, "front");
    this.head = matrixOf(arrays, "head");
    const channels = (this.channels = this.front.outputs);
    this.seen = new Kept(FRONT, PAIR, steps);
    this.layers = offsets.map((places, number) => {
      const late = Math.max(...places);
      return {
        late, near: new Kept(places, channels, steps), delayed: late ? new Kept([-late], channels, steps) : null,
        mix: matrixOf(arrays, `mix${number}`), out: matrixOf(arrays, `out${number}`),
      };
    });
    [this.x, this.h, this.y] = [0, 1, 2].map(() => new Float32Array(steps * channels));
    this.scores = new Float32Array(steps * this.head.outputs);
    this.now = -FRONT.at(-1); // number of the first step that the first layer gives next
  }

  // Takes 2 * steps frames; returns the scores of as many, small_net.AHEAD steps before.
  push(frames) {
    const { x, h, y, channels, steps } = this;
    multiply(this.front, this.seen.push(frames), x, steps);
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
      multiply(mix, input, h, steps);
      rectify(h);
      multiply(out, h, y, steps);
      for (let index = 0; index < x.length; ++index) x[index] += y[index];
      forget();
    }
    normalise(x, h, channels);
    multiply(this.head, h, this.scores, steps);
    return this.scores;
  }
}
