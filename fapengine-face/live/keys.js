// Phones to a path: the keyframes of one track. fapengine/trajectory/targets.py, context.py and phonetics.py.

import { context, phonetics, style, targets } from "./constants.js";
import { clamp, pathThrough, smoothstep } from "./path.js";

const { LENGTHS, MAX_DURATION_S, MIN_DURATION_S, NEXT_FROM, PAUSE_S, REACH, TYPICAL_S } = context;
const { AHEAD, HALF_GAIN, HOLE, LONG_S, NOTHING, PAUSE, PAUSE_S: LEAST_PAUSE_S, ROUND, WIDTH } = phonetics;
const {
  APART_S, CLOSEST_KEYS_S, GAP_S, HELD_PAUSE_S, HELD_STEP_S, JAW_SWAY, LEAD_S, LIPS_SWAY, MIN_PAUSE_S, MAX_HELD, REST_MARGIN_S, SWAY_FROM_S,
  SWAY_RISE_S,
} = targets;
const { DB_PER_DOUBLE_DROP, DB_PER_DOUBLE_LIPS } = style;

// Targets of tokens between their neighbours. kinds: of all tokens in a row, three silences at both ends; lengths: s.
class Tokens {
  constructor(profile, kinds, lengths) {
    this.profile = profile;
    this.kinds = kinds;
    this.lengths = lengths.map((length) => Math.log(clamp(length, MIN_DURATION_S, MAX_DURATION_S) / TYPICAL_S));
  }

  // Row of the coefficients of three tokens that were recorded beside each other; undefined if they were not.
  heardAsHere(at) {
    const [before, own, after] = this.kinds.slice(at - 1, at + 2);
    return this.profile.places.get(`triple ${before.name} ${own.name} ${after.name}`);
  }

  // Sum of all features; neighbours at steps outside from..to count as silence.
  sums(at, from, to) {
    const { profile, kinds, lengths } = this;
    const { size, silence } = profile;
    const total = new Float64Array(size);
    const add = (row, by = 1) => {
      for (let index = 0; index < size; ++index) total[index] += by * row[index];
    };
    add(profile.pair(kinds[at - 1], kinds[at])[0]);
    add(profile.pair(kinds[at], kinds[at + 1])[1]);
    const heard = this.heardAsHere(at);
    if (heard !== undefined) add(profile.coefficients.subarray(heard * size, (heard + 1) * size));
    add(kinds[at].byLength, lengths[at]);
    LENGTHS.forEach((step, index) => add(profile.lengthsBeside[index], lengths[at + step]));
    const around = [];
    for (let step = -REACH; step <= REACH; ++step) {
      around.push(step >= from && step <= to ? kinds[at + step] : silence);
      add(around.at(-1).byStep[step + REACH]);
    }
    profile.addExamples(total, around, lengths.slice(at - 1, at + 2));
    return total;
  }

  targetsOf(at) {
    const { kinds, profile } = this;
    const own = this.sums(at, -REACH, REACH);
    const goes = (kind) => !kind.isIdle && !kind.isSilent;
    const [isLed, leads] = [goes(kinds[at - 1]), goes(kinds[at + 1])];
    if (!kinds[at].isIdle || !(isLed || leads)) return own;
    const { modeCount, size } = profile;
    const count = size / modeCount;
    const before = isLed ? this.sums(at - 1, 1 - REACH, REACH).subarray(size - modeCount) : null;
    const after = leads ? this.sums(at + 1, -REACH, REACH - 1) : null;
    for (let index = 0; index < size; ++index) {
      const mode = index % modeCount;
      const share = NEXT_FROM + (count > 1 ? (((1 - NEXT_FROM) * Math.floor(index / modeCount)) / (count - 1)) : 0);
      if (isLed && leads) own[index] = (1 - share) * before[mode] + share * after[mode];
      else own[index] = leads ? after[mode] : before[mode];
    }
    return own;
  }
}

// What a letter has at its keyframes: its own as far as it insists, the rest from its neighbours. rows: of all letters.
function inContext({ values, insists }, rows, at) {
  const found = new Float64Array(WIDTH);
  for (let axis = 0; axis < WIDTH; ++axis) {
    let [wanted, weights] = [0, 0];
    for (const [side, share] of [[1, AHEAD], [-1, 1 - AHEAD]]) {
      let past = 1;
      for (let step = 1; step <= phonetics.REACH; ++step) {
        const place = rows[at + side * step] * WIDTH + axis;
        const weight = insists[place] * share * past;
        wanted += weight * values[place];
        weights += weight;
        past *= 1 - insists[place];
      }
    }
    const place = rows[at] * WIDTH + axis;
    found[axis] = insists[place] * values[place] + (1 - insists[place]) * (wanted / (weights + 1e-9));
  }
  return found;
}

// phones: { label, start, end, word, loudness }, in time order, without silences; those before firstOwn get no keys.
// Returns the path, the phones that have keys, each with its contact and whether its label has several letters, and the labels
// among them that are not IPA.
export function speechPath(profile, phones, firstOwn = 0) {
  const row = new Row(profile);
  phones.forEach((phone, number) => row.add(phone, number, firstOwn));
  const keys = row.finished();
  keys.sort((one, other) => one.time - other.time);
  const kept = farApart(keys);
  const values = new Float64Array(kept.length * profile.width);
  kept.forEach(({ target }, index) => target && values.set(target, index * profile.width));
  return { path: pathThrough(kept.map(({ time }) => time), values, profile.width), said: row.said, unknown: row.unknown };
}

class Row {
  constructor(profile) {
    Object.assign(this, { profile, said: [], unknown: [], own: [], rests: [], now: 0, spoken: -Infinity, first: 0 });
    this.kinds = new Array(REACH).fill(profile.silence);
    this.lengths = new Array(REACH).fill(PAUSE_S);
    this.letters = new Array(phonetics.REACH).fill(NOTHING);
  }

  add(phone, number, firstOwn) {
    const { profile, kinds, lengths, letters } = this;
    let { start } = phone;
    const { end } = phone;
    const [isOwn, mayRest] = [number >= firstOwn, number > firstOwn];
    const lead = start - this.now >= (number ? HELD_PAUSE_S : REST_MARGIN_S) ? Math.min(LEAD_S, start) : 0;
    if (start > this.now + GAP_S) {
      kinds.push(profile.silence);
      lengths.push(PAUSE_S);
      if (mayRest && start - this.now >= MIN_PAUSE_S) this.rest(this.now, start);
    } else if (start < this.now - GAP_S) {
      throw new Error(`phone ${phone.label}: starts at ${start} s, but the one before ends at ${this.now} s`);
    } else if (end <= this.now) {
      return;
    } else {
      start = this.now;
    }
    const { kinds: parts, rows, contact, isUnknown } = profile.spelled(phone);
    if (start - this.spoken > LEAST_PAUSE_S) letters.push(PAUSE);
    this.now = this.spoken = end;
    if (isOwn) {
      if (!this.said.length) this.first = start;
      this.said.push([start === phone.start ? phone : { ...phone, start }, contact, rows.length > 1]);
      this.own.push({ start, end, lead, loudness: phone.loudness ?? 0, place: kinds.length, count: parts.length, letter: letters.length, letters: rows.length });
      if (isUnknown) this.unknown.push(phone.label);
    }
    kinds.push(...parts);
    for (let part = 0; part < parts.length; ++part) lengths.push((end - start) / parts.length);
    letters.push(...rows);
  }

  rest(from, until) {
    if (until - from >= HELD_PAUSE_S) this.rests.push(from + REST_MARGIN_S, until - LEAD_S);
    else this.rests.push((from + until) / 2);
  }

  // Keys of all phones, then those at the neutral face, which have no target.
  finished() {
    this.letters.push(PAUSE, ...new Array(phonetics.REACH).fill(NOTHING));
    for (let step = 0; step < REACH; ++step) {
      this.kinds.push(this.profile.silence);
      this.lengths.push(PAUSE_S);
    }
    if (!this.said.length) return [];
    this.rests.push(Math.max(this.first - LEAD_S, 0), this.spoken + REST_MARGIN_S);
    const tokens = new Tokens(this.profile, this.kinds, this.lengths);
    const keys = this.own.flatMap((phone) => {
      const own = this.keysOf(phone, tokens);
      return phone.lead ? [{ ...own[0], time: phone.start - phone.lead / 2 }, ...own] : own;
    });
    return [...keys, ...this.rests.map((time) => ({ time, target: null }))];
  }

  keysOf({ start, end, loudness, place, count, letter, letters }, tokens) {
    const { profile } = this;
    const { fractions, modeCount } = profile;
    const whole = end - start;
    const length = whole / count;
    const isCrowded = length * (fractions.at(-1) - fractions[0]) < APART_S * (fractions.length - 1);
    const keys = [];
    for (let part = 0; part < count; ++part) {
      let weights = tokens.targetsOf(place + part);
      if (isCrowded) weights = mean(weights, modeCount);
      const isAsHeard = count === 1 && tokens.heardAsHere(place) !== undefined;
      const held = smoothstep(((isAsHeard ? 0 : whole) - LONG_S[0]) / (LONG_S[1] - LONG_S[0]));
      const at = isCrowded ? [fractions.reduce((sum, one) => sum + one) / fractions.length] : fractions;
      let own = at.map((fraction, index) => {
        return { fraction, age: length * fraction, target: weights.subarray(index * modeCount, (index + 1) * modeCount) };
      });
      if (length > MAX_DURATION_S) own = keysOfLong(own, length, letters > count);
      for (const { fraction, age, target } of own) {
        const time = start + part * length + age;
        const row = letter + Math.min(Math.floor((part + fraction) * (letters / count)), letters - 1);
        const layer = inContext(profile, this.letters, row);
        layer[ROUND] *= 1 + profile.timesMore[this.letters[row]] * held;
        layer[HOLE] = profile.puckered[this.letters[row]] * held;
        const share = smoothstep((Math.min(age, length - age) - SWAY_FROM_S) / SWAY_RISE_S);
        const lips = 2 ** (loudness / DB_PER_DOUBLE_LIPS);
        const jaw = (2 ** (loudness / DB_PER_DOUBLE_DROP) / lips) * (1 + share * swayOf(JAW_SWAY, time));
        const sway = 1 + share * swayOf(LIPS_SWAY, time);
        const said = louder(profile, target, jaw).map((value) => value * lips);
        const shaped = layer.map((value) => value * layerGain(lips));
        keys.push({ time, target: [...said, ...shaped].map((value) => value * sway) });
      }
    }
    return keys;
  }
}

// Keys of a long part near both its ends, and others between them; the first sound of a diphthong is held.
function keysOfLong(keys, length, isDiphthong) {
  const more = length - MAX_DURATION_S;
  const placed = keys.map((key) => ({ ...key, age: (length - more) * key.fraction + (key.fraction < 0.5 ? 0 : more) }));
  const [first, last] = [placed[0], isDiphthong ? placed[0] : placed.at(-1)];
  const fraction = (first.fraction + last.fraction) / 2;
  const target = first.target.map((value, index) => (value + last.target[index]) / 2);
  const between = placed.at(-1).age - first.age;
  const count = Math.floor(Math.min(between / HELD_STEP_S, MAX_HELD));
  for (let step = 1; step <= count; ++step) placed.push({ fraction, target, age: first.age + (step / (count + 1)) * between });
  return placed.sort((one, other) => one.age - other.age);
}

// Size of the phonetic layer for the size of the lips: phonetics.py, layer_gain.
export const layerGain = (lips) => ((1 + HALF_GAIN) * lips) / (lips + HALF_GAIN);

// Sum of slow waves at a time.
const swayOf = (waves, time) => waves.reduce((sum, [share, period]) => sum + share * Math.sin(((2 * Math.PI) / period) * time), 0);

function mean(weights, modeCount) {
  const found = new Float64Array(modeCount);
  for (let index = 0; index < weights.length; ++index) found[index % modeCount] += weights[index];
  return found.map((sum) => (sum * modeCount) / weights.length);
}

function louder({ jaws, modeCount }, weights, gain) {
  if (gain === 1) return weights;
  const found = weights.slice();
  for (let index = 0; index < weights.length; ++index) {
    const [key, to] = [index - (index % modeCount), index % modeCount];
    for (let from = 0; from < modeCount; ++from) found[index] += (gain - 1) * weights[key + from] * jaws[from * modeCount + to];
  }
  return found;
}

// Keys that are far enough apart; the first and the last stay.
function farApart(keys) {
  if (!keys.some(({ time }, index) => index && time - keys[index - 1].time < CLOSEST_KEYS_S)) return keys;
  const end = keys.at(-1).time;
  let before = keys[0].time;
  return keys.filter(({ time }, index) => {
    if (index === 0 || index === keys.length - 1) return true;
    const isKept = before + CLOSEST_KEYS_S <= time && time <= end - CLOSEST_KEYS_S;
    if (isKept) before = time;
    return isKept;
  });
}
