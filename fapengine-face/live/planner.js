// Phones in as they come, FAPs out as they are due: fapengine/trajectory/stream.py for one stream, and planner.py for a
// finished list of phones. The same phones give the same FAPs as there; a test compares every value.

import { closures, fap, phone_track, phonetics, speaking, stream, style as styles, targets } from "./constants.js";
import { heldAt, holdLate, holdOf, holdUntil, settle } from "./closures.js";
import { addGestures } from "./gestures.js";
import { layerGain, speechPath } from "./keys.js";
import { addFading, clamp, emptyJet, jetAt, neutralPath, placeAfter, placeOf, smoothstep, softPositive } from "./path.js";

const { AHEAD_PHONES, BEHIND_PHONES, FADE_S, KEYS_BEHIND, LATEST_CLOSURE_S, LONG_S, MAX_PULL, MIN_FADE_S, MOMENTUM_S, PLANNED_LETTERS, PLAN_EARLY_S, REACH, ROUNDING_S, SAME_S } = stream;
const { MIN_HOLD_S, RAMP_S } = closures;
const { CORNERS, HELD, PUSHED, ROUND, SOFT_FAPU, WIDTH } = phonetics;
const { LOUDNESS_DB, SILENCE } = phone_track;
const { MAX_GAIN } = speaking;
const { FAP_COUNT } = fap;

const startOf = ({ start }) => start;
const endOf = ({ end }) => end;
export const isSame = (one, other) => ["label", "start", "end", "stress", "word", "loudness"].every((name) => one[name] === other[name]);
// As np.rint: a half goes to the even neighbour.
const rounded = (value) => {
  const nearest = Math.round(value);
  return Math.abs(value % 1) === 0.5 && nearest % 2 ? nearest - 1 : nearest;
};

// A phone as the planner keeps it; says what is wrong.
export function checkedPhone(phone) {
  const { label, start, end, stress = 0, word = "", loudness = 0 } = phone ?? {};
  const isRight =
    typeof label === "string" && label && typeof word === "string" && Number.isFinite(start) && start >= 0 && Number.isFinite(end) &&
    start < end && [0, 1, 2].includes(stress) && Number.isFinite(loudness) && loudness >= LOUDNESS_DB[0] && loudness <= LOUDNESS_DB[1];
  if (!isRight) {
    throw new TypeError(`phone: got ${JSON.stringify(phone)}, expected { label, start, end }, 0 <= start < end in s, a stress of 0, 1 or 2, and a loudness of ${LOUDNESS_DB.join(" to ")} dB`);
  }
  return { label, start, end, stress, word, loudness };
}

// FAPs of a profile's speech in a style: fapengine/trajectory/faps.py.
class Composer {
  constructor(profile, { articulation = 1, jaw = 1, lips = 1, loudness = 0 } = {}) {
    for (const [name, gain] of Object.entries({ articulation, jaw, lips })) {
      if (!(gain >= 0 && gain <= MAX_GAIN)) throw new TypeError(`${name}: must be 0 to ${MAX_GAIN}, got ${gain}`);
    }
    const [least, most] = speaking.LOUDNESS_DB;
    if (!(loudness >= least && loudness <= most)) throw new TypeError(`loudness: must be ${least} to ${most} dB, got ${loudness}`);
    const { modeCount, width, modes, jaws, layer } = profile;
    const jawGain = articulation * jaw * 2 ** (Math.min(loudness, styles.MAX_JAW_DB) / styles.DB_PER_DOUBLE_DROP);
    const lipsGain = articulation * lips * 2 ** (loudness / styles.DB_PER_DOUBLE_LIPS);
    this.profile = profile;
    this.openness = Math.min(1, jawGain);
    this.layerGain = layerGain(lipsGain);
    this.lift = new Float64Array(width * FAP_COUNT); // weights to FAPs
    for (let mode = 0; mode < modeCount; ++mode) {
      for (let column = 0; column < FAP_COUNT; ++column) {
        let ofJaw = 0;
        for (let other = 0; other < modeCount; ++other) ofJaw += jaws[mode * modeCount + other] * modes[other * FAP_COUNT + column];
        this.lift[mode * FAP_COUNT + column] = lipsGain * modes[mode * FAP_COUNT + column] + (jawGain - lipsGain) * ofJaw;
      }
    }
    for (let index = 0; index < WIDTH * FAP_COUNT; ++index) this.lift[modeCount * FAP_COUNT + index] = this.layerGain * layer[index];
    this.faps = new Float64Array(FAP_COUNT);
  }

  // weights: a place on a path. expression, gestures: 68 FAPs that are added before and after contacts are made, or null.
  compose(weights, held, expression, gestures, out) {
    const { faps, lift, profile } = this;
    faps.fill(0);
    weights.forEach((weight, row) => {
      if (weight) for (let column = 0; column < FAP_COUNT; ++column) faps[column] += weight * lift[row * FAP_COUNT + column];
    });
    if (expression) this.addExpression(expression, this.layerGain * weights[profile.modeCount + ROUND]);
    settle(faps, { ...held, open: held.open * this.openness }, profile.low, profile.high);
    addGestures(faps, gestures);
    for (let column = 0; column < FAP_COUNT; ++column) out[column] = rounded(clamp(faps[column], profile.low[column], profile.high[column]));
    return out;
  }

  // Less where it pulls at corners that are held: phonetics.py, give_way.
  addExpression(expression, round) {
    const [narrow, spread] = [smoothstep(round / HELD), smoothstep(-round / HELD)];
    for (let column = 0; column < FAP_COUNT; ++column) {
      let value = expression[column];
      if (CORNERS.includes(column)) value += spread * softPositive(-value, SOFT_FAPU) - narrow * softPositive(value, SOFT_FAPU);
      else if (PUSHED.includes(column)) value += narrow * softPositive(-value, SOFT_FAPU);
      this.faps[column] += value;
    }
  }
}

export class Planner {
  // profile: a Profile. style: sizes of articulation, jaw and lips (0 to 3) and a loudness in dB. horizon: s after the last
  // frame up to which nothing changes.
  constructor(profile, { horizon = 0, ...style } = {}) {
    if (!(horizon >= 0)) throw new TypeError(`horizon: must be 0 or more, got ${horizon}`);
    Object.assign(this, { profile, horizon, composer: new Composer(profile, style), width: profile.width });
    this.counts = { late: 0, dropped: 0, revised: 0, cancelled: 0, unknown: 0 };
    this.phones = []; // of the plan, in time order, without silences
    this.known = []; // dropped and cancelled phones that ended lately
    this.holds = new Map(); // by start, end and label of their phones
    this.keptHolds = [];
    this.shown = this.cancelledAt = -Infinity;
    this.due = null; // edge and fade of a plan that is to be made
    this.waits = false; // whether phones follow those of the plan
    this.sure = -Infinity; // time before which these change nothing
    this.plans = [{ start: -Infinity, path: neutralPath(this.width), fade: 0, momentum: 0, left: emptyJet(this.width) }];
  }

  // Time up to which the plan is settled.
  get edge() {
    return Math.max(this.shown + this.horizon, this.cancelledAt);
  }

  // Time of the first frame before which a plan must be made; infinity if all is planned.
  get planBy() {
    return this.due ? -Infinity : this.waits ? this.sure - this.horizon : Infinity;
  }

  // Adds phones in any order: { label, start, end, stress?, word?, loudness? }, s and dB. Each replaces what it overlaps; label "_",
  // a silence, removes what it overlaps.
  feed(phones) {
    const { edge, counts } = this;
    this.known = this.known.filter(({ end }) => end > edge - LATEST_CLOSURE_S);
    for (const phone of phones.map(checkedPhone)) {
      const isSilence = phone.label === SILENCE;
      if (this.has(phone, edge)) continue;
      if (phone.end <= edge) {
        counts.dropped += !isSilence;
        this.closeLate(phone, edge);
      } else {
        counts.late += phone.start < edge && !isSilence;
        counts.unknown += !isSilence && !this.profile.lettersOf(phone.label).length;
        if (this.place(phone) && !this.due && edge < this.sure) this.waits = true;
        else this.due = [edge, FADE_S];
      }
    }
    if (this.waits && !this.due) this.dropFar(edge);
  }

  // Whether a phone changes nothing: it is planned already, or one of its label was said in its time.
  has(phone, edge) {
    const { phones } = this;
    if (phone.end > edge) {
      if (phone.label === SILENCE) {
        const [first, stop] = this.overlapped(phone);
        return first === stop;
      }
      const same = phones[placeOf(phones, phone.start, startOf)];
      return same !== undefined && isSame(same, phone);
    }
    const near = phones.slice(placeAfter(phones, phone.start, endOf), placeOf(phones, phone.end, startOf));
    return [...near, ...this.known].some(({ label, start, end }) => label === phone.label && start < phone.end && end > phone.start);
  }

  // Puts a phone in its place; returns whether it follows all others.
  place(phone) {
    const { phones } = this;
    const isSilence = phone.label === SILENCE;
    if (!isSilence && (!phones.length || phone.start >= phones.at(-1).end)) {
      phones.push(phone);
      return true;
    }
    const [first, stop] = this.overlapped(phone);
    const overlapped = phones.slice(first, stop);
    this.counts.revised += overlapped.filter((old) => !isSame(old, phone)).length;
    const placed = isSilence ? [] : [phone];
    if (overlapped.length && overlapped[0].start < phone.start - Math.min(SAME_S, (phone.end - phone.start) / 2)) {
      placed.unshift({ ...overlapped[0], end: phone.start });
    }
    phones.splice(first, stop - first, ...placed);
    return false;
  }

  // Places of the planned phones that a phone overlaps, first and the one after the last.
  overlapped({ start, end }) {
    const same = Math.min(SAME_S, (end - start) / 2);
    const first = placeAfter(this.phones, start + same, endOf);
    return [first, Math.max(placeOf(this.phones, end - same, startOf), first)];
  }

  closeLate(phone, edge) {
    this.known.push(phone);
    if (phone.end > edge - LATEST_CLOSURE_S && phone.label !== SILENCE && this.profile.spelled(phone).contact === "lips") {
      this.keptHolds.push({ start: edge + RAMP_S, stop: edge + RAMP_S + MIN_HOLD_S, contact: "lips" });
      this.due = [edge, FADE_S];
    }
  }

  // Ends speech: what is after a time is not said, and the face is neutral a fade later, s.
  cancel(at, fade = 0.2) {
    if (Number.isNaN(at)) throw new TypeError("cancel: got NaN, expected a time in s");
    if (!(fade > 0)) throw new TypeError(`fade: must be a positive time, got ${fade}`);
    this.plan();
    const edge = (this.cancelledAt = Math.max(at, this.edge));
    this.counts.cancelled += this.phones.filter(({ end }) => end > edge).length;
    this.known.push(...this.phones.filter(({ end }) => end <= edge));
    this.phones = [];
    this.due = [edge, fade];
    this.keptHolds = this.allHolds.filter(({ start }) => start - RAMP_S < edge).map((hold) => holdUntil(hold, edge));
    this.holds = new Map();
  }

  // Drops phones that are too far ahead; returns the place of the first that is not over at the edge.
  dropFar(edge) {
    const { phones } = this;
    const over = placeAfter(phones, edge, endOf);
    let [fit, letters] = [over, 0];
    while (fit < phones.length && (letters += [...phones[fit].label].length) <= PLANNED_LETTERS) ++fit;
    this.counts.dropped += phones.length - fit;
    phones.splice(fit);
    return over;
  }

  // Drops old phones; returns those of the new plan, and the index of the first one with keys that it needs.
  toPlan(edge) {
    const { phones } = this;
    let over = this.dropFar(edge);
    const first = Math.min(Math.max(over - BEHIND_PHONES, 0), placeAfter(phones, edge - LATEST_CLOSURE_S, endOf));
    phones.splice(0, first);
    over -= first;
    let own = Math.max(over - 1, 0);
    const fewest = Math.max(over - KEYS_BEHIND, 0);
    while (own > fewest && phones[own].end - phones[own].start < LONG_S * [...phones[own].label].length) --own;
    return [phones.slice(Math.max(own - REACH, 0)), Math.min(own, REACH)];
  }

  // Plans the path from the edge on, where phones have changed.
  plan() {
    if (this.planBy === Infinity) return;
    const [edge, fade] = this.due ?? [this.edge, FADE_S];
    const { path, said } = speechPath(this.profile, ...this.toPlan(edge));
    [this.due, this.waits] = [null, false];
    this.sure = this.phones.length > AHEAD_PHONES ? this.phones.at(-1 - AHEAD_PHONES).start - PLAN_EARLY_S : -Infinity;
    if (!isFinite(edge)) { // nothing was shown yet: nothing to keep
      this.renewHolds(said, edge);
      this.plans = [{ start: -Infinity, path, fade: 0, momentum: 0, left: this.plans[0].left }];
      return;
    }
    while (this.plans.at(-1).start >= edge) this.plans.pop(); // never shown
    const last = this.plans.at(-1);
    const fresh = jetAt(path, edge, emptyJet(this.width));
    const change = difference(jetAt(last.path, edge, emptyJet(this.width)), fresh);
    const left = difference(this.planJet(last, edge, emptyJet(this.width)), fresh);
    const [isNew, wasFading] = [size(change), size(difference(left, change))];
    this.follow(path, said, left, isNew / Math.max(isNew + wasFading, 1e-9), edge, fade);
  }

  // Follows a new path; its difference to what is shown, left, fades. What was already fading goes on in its time; share
  // of it is new.
  follow(path, said, left, share, edge, fade) {
    this.renewHolds(said, edge);
    const { plans } = this;
    const last = plans.at(-1);
    const leftTime = Math.max(last.start + last.fade - edge, MIN_FADE_S);
    if (leftTime < fade && edge > this.cancelledAt) fade = leftTime + share * (fade - leftTime);
    const since = edge - last.start + ROUNDING_S;
    const shortest = since < last.momentum ? last.momentum : since < last.fade ? last.fade : Infinity;
    const pull = Math.sqrt(MAX_PULL / Math.max(...left[2].map(Math.abs), 1));
    plans.push({ start: edge, path, fade, momentum: Math.min(fade, MOMENTUM_S, shortest, pull), left });
    while (plans[1].start < Math.min(edge, this.shown)) plans.shift();
  }

  // Late bilabials close as soon as they can; holds that have begun grow with their phone.
  renewHolds(said, edge) {
    const before = this.holds;
    this.holds = new Map();
    const hasBegun = ({ hold }) => hold.start - RAMP_S < edge;
    const begun = [...before].filter(([, one]) => hasBegun(one)).map(([key]) => key);
    for (const [phone, contact, isJoined] of said) {
      if (contact === "none") continue;
      const key = `${phone.start} ${phone.end} ${phone.label}`;
      let from = key;
      if (begun.length && !before.has(key)) { // a phone whose times have changed a little closes once, not twice
        const isNear = (one) => one && one.phone.start < phone.end && one.phone.end > phone.start && one.hold.contact === contact;
        from = begun.find((one) => isNear(before.get(one))) ?? key;
      }
      const same = before.get(from)?.hold;
      before.delete(from);
      if (!same && phone.end <= edge) continue; // its time is over, and so is what it had to hold
      const own = holdOf(phone, contact, isJoined);
      let hold = same ? holdUntil(same, Math.max(phone.end, edge)) : own;
      if (same && same.stop <= phone.end && same.stop > edge && key !== from) hold = { ...same, stop: Math.max(same.stop, own.stop) };
      if (!same && hold.start - RAMP_S < edge) hold = holdLate(hold, edge);
      if (hold) this.holds.set(key, { phone, hold });
    }
    const kept = [...before.values()].filter(hasBegun).map(({ hold }) => holdUntil(hold, edge));
    const seen = Math.min(edge, this.shown) - RAMP_S;
    this.keptHolds = [...this.keptHolds, ...kept].filter(({ stop }) => stop > seen);
  }

  get allHolds() {
    return [...[...this.holds.values()].map(({ hold }) => hold), ...this.keptHolds];
  }

  planJet({ start, path, fade, momentum, left }, time, out) {
    jetAt(path, time, out);
    addFading(left, [0, 0], time - start, fade, out);
    addFading(left, [1, 2], time - start, momentum, out);
    return out;
  }

  // Writes the 68 FAPs of a frame, FAPU, and settles what is before it. Times that go back show the last frame again.
  frame(time, out = new Float32Array(FAP_COUNT), expression = null, gestures = null) {
    if (Number.isNaN(time)) throw new TypeError("frame: got NaN, expected a time in s"); // it would stay
    const now = Math.max(time, this.shown);
    if (now >= this.planBy) this.plan();
    this.shown = now;
    const plan = this.plans[Math.max(placeAfter(this.plans, now, startOf) - 1, 0)];
    this.jet ??= emptyJet(this.width);
    return this.composer.compose(this.planJet(plan, now, this.jet)[0], heldAt(now, this.allHolds), expression, gestures, out);
  }
}

const difference = (one, other) => one.map((values, order) => values.map((value, index) => value - other[order][index]));
const size = ([values, velocities]) => {
  const sum = (numbers) => numbers.reduce((total, number) => total + Math.abs(number), 0);
  return sum(values) + FADE_S * sum(velocities);
};

// FAPs of each frame of a finished list of phones, and the labels that are not IPA.
export function planAll(profile, phones, { rate = 30, ...style } = {}) {
  if (!(rate > 0 && rate < Infinity)) throw new TypeError(`rate: got ${rate}, expected frames per second`);
  const spoken = phones.map(checkedPhone).filter(({ label }) => label !== SILENCE);
  const { path, said, unknown } = speechPath(profile, spoken);
  const holds = said.filter(([, contact]) => contact !== "none").map((one) => holdOf(...one));
  const composer = new Composer(profile, style);
  const end = Math.max(phones.at(-1)?.end ?? 0, spoken.length ? spoken.at(-1).end + targets.REST_MARGIN_S : 0);
  const jet = emptyJet(profile.width);
  const faps = Array.from({ length: Math.max(1, rounded(end * rate)) }, (_, number) =>
    composer.compose(jetAt(path, number / rate, jet)[0], heldAt(number / rate, holds), null, null, new Float32Array(FAP_COUNT)),
  );
  return { faps, unknown };
}
