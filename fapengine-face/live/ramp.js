// A value that glides to goals, C2 whatever comes when: fapengine/trajectory/ramps.py, for one channel. Stateful.

import { ramps } from "./constants.js";
import { clamp, jetOf, quintic } from "./path.js";

const { MOMENTUM_S } = ramps;
const STILL = [0, 0, 0];

export class Ramp {
  constructor() {
    this.waiting = []; // ramps that have not begun, by time
    this.motion = { at: -Infinity, over: 1, momentumOver: 1, way: new Array(6).fill(0), momentum: new Array(6).fill(0) };
  }

  // Goes to a goal from a time on, s; those that were to begin later are dropped.
  to(goal, at, over) {
    this.waiting = this.waiting.filter((one) => one.at < at);
    this.then(goal, at, over);
  }

  // Goes to a goal after what is waiting.
  then(goal, at, over) {
    this.waiting.push({ goal, at, over });
    this.waiting.sort((one, other) => one.at - other.at);
  }

  // The value at a time that never goes back.
  value(now) {
    while (this.waiting.length && this.waiting[0].at <= now) this.takeOver(this.waiting.shift());
    const { at, over, momentumOver, way, momentum } = this.motion;
    const at01 = (length) => (at === -Infinity ? 0 : clamp((now - at) / length, 0, 1));
    return jetOf(way, at01(over), over)[0] + jetOf(momentum, at01(momentumOver), momentumOver)[0];
  }

  takeOver({ goal, at, over }) {
    const jet = [0, 0, 0];
    let momentumOver = Math.min(over, MOMENTUM_S);
    for (const [curve, length] of [[this.motion.way, this.motion.over], [this.motion.momentum, this.motion.momentumOver]]) {
      const share = clamp((at - this.motion.at) / length, 0, 1);
      jetOf(curve, share, length).forEach((value, order) => (jet[order] += value));
      if (share < 1) momentumOver = Math.min(momentumOver, length);
    }
    const [value, velocity, acceleration] = jet;
    const way = quintic(over, [value, 0, 0], [goal, 0, 0]);
    this.motion = { at, over, momentumOver, way, momentum: quintic(momentumOver, [0, velocity, acceleration], STILL) };
  }
}
