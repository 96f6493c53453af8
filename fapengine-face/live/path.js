// A C2 path through keyframes that later keys do not change, by quintics: fapengine/trajectory/hermite.py. A jet is value,
// velocity and acceleration, an array of numbers each.

import { hermite } from "./constants.js";

const { MAX_DERIVATIVES } = hermite;

export const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
export const smoothstep = (x) => {
  const t = clamp(x, 0, 1);
  return t * t * t * (10 + t * (6 * t - 15));
};
export const bump = (x, start, stop, rise, fall) => smoothstep((x - start + rise) / rise) * smoothstep((stop + fall - x) / fall);
export const softPositive = (x, width) => {
  const s = clamp(x / width, 0, 1);
  return width * s * s * s * (1 - s / 2) + Math.max(x - width, 0);
};

export const emptyJet = (width) => [0, 1, 2].map(() => new Float64Array(width));
export const neutralPath = (width) => ({ times: [0, 1], jets: emptyJet(2 * width), width });

// First place in a sorted list whose value is at least (more than) a number.
export const placeOf = (list, number, of = (one) => one) => search(list, (one) => of(one) < number);
export const placeAfter = (list, number, of = (one) => one) => search(list, (one) => of(one) <= number);
function search(list, isBefore) {
  let [low, high] = [0, list.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (isBefore(list[middle])) low = middle + 1;
    else high = middle;
  }
  return low;
}

// times: N, s; values: N * width.
export function pathThrough(times, values, width) {
  const count = times.length;
  if (count < 2) return neutralPath(width);
  const [velocity, acceleration] = [new Float64Array(count * width), new Float64Array(count * width)];
  for (let n = 1; n < count - 1; ++n) {
    const [before, after] = [times[n] - times[n - 1], times[n + 1] - times[n]];
    const [both, longer] = [before + after, Math.max(before, after)];
    for (let k = 0, at = n * width; k < width; ++k, ++at) {
      const [one, two, three] = [values[at - width], values[at], values[at + width]];
      const range = Math.max(one, two, three) - Math.min(one, two, three);
      const [first, second] = [(two - one) / before, (three - two) / after];
      const [fastest, sharpest] = [(MAX_DERIVATIVES[0] / longer) * range, (MAX_DERIVATIVES[1] / (longer * longer)) * range];
      velocity[at] = clamp((after / both) * first + (before / both) * second, -fastest, fastest);
      acceleration[at] = clamp((second - first) * (2 / both), -sharpest, sharpest);
    }
  }
  return { times, jets: [values, velocity, acceleration], width };
}

// Coefficients of 1, s .. s^5 of the quintic between two jets of one number.
export function quintic(length, first, last) {
  const [a0, a1, a2] = [first[0], first[1] * length, first[2] * length * length];
  const [b0, b1, b2] = [last[0], last[1] * length, last[2] * length * length];
  const [rest, slope, bend] = [b0 - a0 - a1 - a2 / 2, b1 - a1 - a2, b2 - a2];
  return [a0, a1, a2 / 2, 10 * rest - 4 * slope + bend / 2, -15 * rest + 7 * slope - bend, 6 * rest - 3 * slope + bend / 2];
}

export function jetOf([c0, c1, c2, c3, c4, c5], s, length) {
  const value = c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))));
  const velocity = c1 + s * (2 * c2 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)));
  const acceleration = 2 * c2 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5));
  return [value, velocity / length, acceleration / (length * length)];
}

// Where a path is at a time: writes a jet.
export function jetAt({ times, jets, width }, time, out) {
  const last = times.length - 1;
  const at = clamp(time, times[0], times[last]);
  const left = clamp(placeAfter(times, at) - 1, 0, last - 1);
  const length = times[left + 1] - times[left];
  const s = (at - times[left]) / length;
  for (let k = 0, from = left * width, to = from + width; k < width; ++k, ++from, ++to) {
    const jet = jetOf(quintic(length, jets.map((one) => one[from]), jets.map((one) => one[to])), s, length);
    for (let order = 0; order < 3; ++order) out[order][k] = jet[order];
  }
  return out;
}

// Adds what is left of the values (orders 0 to 0) or velocity and acceleration (1 to 2) of a jet that fades within a time.
export function addFading(left, [lowest, highest], since, length, out) {
  if (since >= length) return;
  for (let k = 0; k < left[0].length; ++k) {
    const first = left.map((one, order) => (order >= lowest && order <= highest ? one[k] : 0));
    const jet = jetOf(quintic(length, first, [0, 0, 0]), since / length, length);
    for (let order = 0; order < 3; ++order) out[order][k] += jet[order];
  }
}
