// FAPs as ARKit's 52 blend shapes, for rigs of one's own: the same answer as fapengine/retarget/arkit.py, whose comments
// say why; a test compares them. The numbers (arkit-table.js) are made from Python's when the package is built.

import { ARKIT } from "./arkit-table.js";

const SWEEPS = 400;
const SETTLED = 1e-7;
const LEAST_PIVOT = 1e-12;
const { names, spoken, upper, jaw, close } = ARKIT;
export const ARKIT_NAMES = names;

const fapOf = (faps, number) => faps[number - 1];
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
const flat = (matrix) => Float64Array.from(matrix.flat());
const product = (row, matrix, width) => {
  const out = new Float64Array(width);
  for (let index = 0, at = 0; index < row.length; ++index, at += width) {
    const value = row[index];
    if (value) for (let column = 0; column < width; ++column) out[column] += value * matrix[at + column];
  }
  return out;
};

const [moodFaps, moodShapes] = [flat(ARKIT.moodFaps), flat(ARKIT.moodShapes)];

// Weights between 0 and the limit that show FAPs best. Coordinate descent, from those of the frame before, finds which are
// between these bounds; of these, the best are then found at once, by Cholesky's decomposition.
class Solver {
  constructor(map) {
    this.map = map;
    this.count = map.names.length;
    this.gram = flat(map.gram);
    this.goals = flat(map.goals);
    this.rates = Float64Array.from(map.gram, (row, shape) => 1 / row[shape]);
    this.most = Float64Array.from(map.lengths, (length) => map.limit * length);
    this.first = new Float64Array(this.count);
    this.second = new Float64Array(this.count);
    this.slopes = new Float64Array(this.count);
    this.factor = new Float64Array(this.count ** 2);
    this.step = new Float64Array(this.count);
  }

  solve(goal, scaled, cost) {
    const { reluctance, lengths } = this.map;
    for (let shape = 0; shape < this.count; ++shape) this.slopes[shape] = goal[shape] - reluctance[shape] * (cost ? cost[shape] : 1);
    for (let shape = 0; shape < this.count; ++shape) this.moved(shape, scaled[shape]);
    for (let sweep = 0; sweep < SWEEPS && this.sweep(scaled) > SETTLED; ++sweep) this.leap(scaled);
    return scaled.map((value, shape) => value / lengths[shape]);
  }

  moved(shape, step) {
    const { count, gram, slopes } = this;
    if (!step) return;
    for (let other = 0, at = shape * count; other < count; ++other, ++at) slopes[other] -= gram[at] * step;
  }

  // Moves one weight after the other to where it is best; returns the largest step.
  sweep(scaled) {
    const { count, most, rates, slopes } = this;
    let largest = 0;
    for (let shape = 0; shape < count; ++shape) {
      const before = scaled[shape];
      const value = clamp(before + slopes[shape] * rates[shape], 0, most[shape]);
      if (value === before) continue;
      scaled[shape] = value;
      this.moved(shape, value - before);
      largest = Math.max(largest, Math.abs(value - before));
    }
    return largest;
  }

  // Moves all weights between their bounds to where they are best together, as far as these allow.
  leap(scaled) {
    const { count, factor, gram, most, slopes, step } = this;
    const free = [];
    for (let shape = 0; shape < count; ++shape) if (scaled[shape] > 0 && scaled[shape] < most[shape]) free.push(shape);
    for (const [row, shape] of free.entries()) {
      let rest = slopes[shape];
      for (let column = 0; column <= row; ++column) {
        let value = gram[shape * count + free[column]];
        for (let k = 0; k < column; ++k) value -= factor[row * count + k] * factor[column * count + k];
        if (column === row && !(value > LEAST_PIVOT)) return;
        factor[row * count + column] = column < row ? value / factor[column * (count + 1)] : Math.sqrt(value);
      }
      for (let k = 0; k < row; ++k) rest -= factor[row * count + k] * step[k];
      step[row] = rest / factor[row * (count + 1)];
    }
    let share = 1;
    for (let row = free.length - 1; row >= 0; --row) {
      for (let k = row + 1; k < free.length; ++k) step[row] -= factor[k * count + row] * step[k];
      step[row] /= factor[row * (count + 1)];
      const [value, shape] = [scaled[free[row]], free[row]];
      if (step[row] < 0) share = Math.min(share, -value / step[row]);
      else if (step[row] > 0) share = Math.min(share, (most[shape] - value) / step[row]);
    }
    for (const [row, shape] of free.entries()) {
      const value = clamp(scaled[shape] + share * step[row], 0, most[shape]);
      this.moved(shape, value - scaled[shape]);
      scaled[shape] = value;
    }
  }

  // Found twice: what is large the first time is meant, and bears none of its reluctance the second.
  follow(faps) {
    const { plain, helpers } = this.map;
    const goal = product(faps, this.goals, this.count);
    const cost = this.solve(goal, this.first).map((weight) => clamp((plain[1] - weight) / (plain[1] - plain[0]), 0, 1));
    for (const helper of helpers) cost[helper] = 1;
    return this.solve(goal, this.second, cost);
  }
}

// Moods are kept while a blink shuts the eyes and opens them.
class MoodHold {
  constructor() {
    this.lid = this.open = this.frames = 0;
    this.moods = null;
    this.held = false;
  }

  follow(moods, faps) {
    const lid = Math.max(fapOf(faps, 19), fapOf(faps, 20));
    const step = lid - this.lid;
    this.lid = lid;
    if (this.moods === null) this.moods = moods;
    else if (!this.held && step > ARKIT.blinkStep) {
      [this.held, this.frames, this.open] = [true, 0, Math.max(lid - step, 0)]; // wide eyes may close to normal ones
    } else if (this.held) {
      this.frames++;
      const isOpen = step > -ARKIT.blinkStep && lid < this.open + ARKIT.openAgain;
      this.held = !isOpen && this.frames < ARKIT.maxBlinkFrames;
    }
    if (!this.held) this.moods = moods;
    return this.moods;
  }
}

// The shapes of one face, frame by frame.
export class ArkitFollower {
  constructor() {
    this.upper = new Solver(upper);
    this.spoken = new Solver(spoken);
    this.hold = new MoodHold();
  }

  // faps: 68 numbers, FAPU. Returns 52 weights, 0..1, in the order of ARKIT_NAMES.
  follow(faps) {
    const { faint, oneWay } = ARKIT;
    const found = this.upper.follow(faps).subarray(0, ARKIT.moodFaps.length);
    const moods = this.hold.follow(found.map((mood) => mood * clamp((mood - faint[0]) / (faint[1] - faint[0]), 0, 1)), faps);
    const done = product(moods, moodFaps, 68);
    for (const column of oneWay) done[column] = Math.max(done[column], 0);
    const asked = Float64Array.from(faps, (value, column) => value - done[column]);
    const lip = fapOf(asked, 16);
    asked[15] += Math.min(Math.max(-lip, 0), ARKIT.swing * Math.max(fapOf(asked, 3), 0));
    asked[13] = Math.max(asked[13], 0);
    const felt = product(moods, moodShapes, names.length);
    return this.joined(this.spoken.follow(asked).map((weight, shape) => weight + felt[shape]), faps);
  }

  joined(weights, faps) {
    weights[jaw] += weights[close];
    for (const [one, other] of ARKIT.opposites) {
      const common = Math.min(weights[one], weights[other]);
      weights[one] -= common;
      weights[other] -= common;
    }
    return this.fitted(weights.map((weight) => clamp(weight, 0, 1)), faps);
  }

  // Lips open as far as FAPs do, and in closures by no shape at all.
  fitted(weights, faps) {
    const { openings, openers, inner, outer, shut, parted } = ARKIT;
    const moved = (pairs) => pairs.reduce((sum, [number, mm]) => sum + mm * fapOf(faps, number), 0);
    const wanted = Math.max(-moved(inner), 0);
    const ajar = weights[jaw] - Math.min(weights[close], weights[jaw]);
    const shown = ajar * openings[jaw] + openers.reduce((sum, shape) => sum + weights[shape] * openings[shape], 0);
    const fits = Math.min((wanted + shut) / Math.max(shown, shut), 1);
    const share = 1 - (1 - fits) * Math.max(1 - wanted / parted, 0);
    weights[close] = weights[jaw] - share * ajar;
    for (const shape of openers) weights[shape] *= share;
    const opened = -0.75 * moved(inner) - 0.25 * moved(outer);
    const given = weights.reduce((sum, weight, shape) => sum + weight * openings[shape], 0);
    const lacking = ((opened - given) / openings[jaw]) * Math.min(wanted / parted, 1);
    weights[jaw] = clamp(weights[jaw] + lacking, weights[close], 1);
    return weights;
  }
}

const followers = new WeakMap();

// Shows FAPs on a mesh of three.js whose morph targets have ARKit's names, or through a VRM's expressionManager (three-vrm)
// whose expressions have them. Others are left alone. Head and eyes: see turns.
export function applyARKit(target, faps) {
  if (!followers.has(target)) followers.set(target, new ArkitFollower());
  const weights = followers.get(target).follow(faps);
  const places = target.morphTargetDictionary;
  names.forEach((name, shape) => {
    if (places) {
      if (name in places) target.morphTargetInfluences[places[name]] = weights[shape];
    } else if (target.getExpression?.(name)) {
      target.setValue(name, weights[shape]);
    }
  });
}

// Turns of head, left eye and right eye, rad: { yaw, pitch, roll }, positive to the subject's left, down, right ear down.
export function turns(faps) {
  const angle = (number) => fapOf(faps, number) * 1e-5;
  return {
    head: { yaw: angle(49), pitch: angle(48), roll: angle(50) },
    leftEye: { yaw: angle(23), pitch: angle(25), roll: 0 },
    rightEye: { yaw: angle(24), pitch: angle(26), roll: 0 },
  };
}
