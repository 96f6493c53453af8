// What makes a face look alive: blinks, glances, nods on accents, a head that moves, breath and drifts. GestureGenerator,
// gesture_faps and add_gestures of fapengine/trajectory/gestures.py. Stateful.

import { fap, fapu, gestures, variation } from "./constants.js";
import { clamp } from "./path.js";
import { Ramp } from "./ramp.js";
import { Random } from "./random.js";

const {
  BLINKS_PER_S, BLINK_BEFORE_END_S, BLINK_BEHIND_END_S, BLINK_CLOSE_S, BLINK_OPEN_S, BLINK_SHUT_S, BREATH_HZ, BREATH_RAD, BROW_FAPU,
  DB_PER_DOUBLE_LENGTH, DB_PER_DOUBLE_NOD, DRIFTS_FAPU, DRIFT_BAND_HZ, EDGE_S, FIRST_BLINK_S, FIXATION_S, GLANCE_RAD, HEAD_AMPLITUDE_RAD,
  HEAD_BAND_HZ, KEPT_S, LIDS_FOLLOW, LIDS_MEET, LOWER_LID, MIN_BLINK_INTERVAL_S, NOD_FALL_S, NOD_HOLD, NOD_RAD, NOD_RISE_S, NOD_STRENGTH,
  ONSET_AHEAD_S, ONSET_PAUSE_S, ONSET_S, PAUSE_S, REACH_S, SACCADE_S, SECONDARY_DB, SETTLED, SETTLED_PITCH_RAD, SETTLE_S, SINES, STANCE_RAD,
  UPPER_LID, UPPER_LID_MAX, USUAL_S,
} = gestures;
const { AU_RAD } = fapu;
const { DIRECTIONS, FALL_S, QUANTILES_HZ, RISE_S } = variation;
const CHANNELS = ["glanceYaw", "glancePitch", "blink", "nod", "headMotion", "idle", "stancePitch", "stanceYaw", "stanceRoll", "speaking"];
const STANCES = ["stancePitch", "stanceYaw", "stanceRoll"];
const MOST_BLINKS = Math.max(...Object.values(BLINKS_PER_S));
const NEAR_S = 0.1; // a phrase whose beginning is revised by less is the same; two are farther apart
const UNSEEN_S = 60; // what would have begun before a longer time without frames is not drawn
const [BLINKS, HEAD, GAZE, IDLE, EMPHASIS, VARIED] = [0, 1, 2, 3, 4, 5]; // streams of random numbers, in the order of the generators there

// Strength of an accent, dB: its kind, loudness and length.
function strengthOf({ start, end, stress, loudness }) {
  const length = DB_PER_DOUBLE_LENGTH * Math.log2((end - start) / USUAL_S);
  return Number(((stress === 1 ? 0 : -SECONDARY_DB) + loudness + length).toFixed(6));
}

// Adds gestures, or null, to FAPs in place; where lids would overlap, the lower one yields.
export function addGestures(faps, gestures) {
  for (let column = 0; gestures && column < faps.length; ++column) faps[column] += gestures[column];
  for (const [upper, lower] of [[18, 20], [19, 21]]) {
    faps[lower] = Math.min(faps[lower], LIDS_MEET - Math.min(faps[upper], UPPER_LID_MAX));
  }
}

export class Gestures {
  // begins: time at which the face begins, neutral, s.
  constructor(seed, begins) {
    this.random = [BLINKS, HEAD, GAZE, IDLE, EMPHASIS, VARIED].map((stream) => new Random(seed, stream));
    this.begins = begins;
    this.channels = Object.fromEntries(CHANNELS.map((name) => [name, new Ramp()]));
    this.blinkAt = begins - BLINK_CLOSE_S + this.random[BLINKS].uniform(...FIRST_BLINK_S);
    this.hasBlinked = false;
    this.glanceAt = begins + this.fixation();
    this.waves = this.drawnWaves();
    this.varied = this.drawnVariation();
    this.turned = STANCES.map(() => 0);
    this.phrases = []; // beginnings and ends, in the time of the phones
    this.nods = new Map(); // accents that are coming, by their beginning: since when each is known, and whether it was judged
    this.noddedAt = -Infinity;
    this.movedAt = -Infinity;
    this.drawnUntil = begins;
    this.spokenFrom = null; // where the phrase begins for which the head has moved, in the time of the phones; null while it has settled
    for (const name of ["headMotion", "idle"]) this.channels[name].then(1, begins, EDGE_S);
  }

  // Sums of sines: frequencies in rad/s and phases of head motion, breath and drifts.
  drawnWaves() {
    const bands = [
      ...Object.keys(HEAD_AMPLITUDE_RAD).map(() => [HEAD, HEAD_BAND_HZ, SINES]), [IDLE, BREATH_HZ, 1],
      ...DRIFTS_FAPU.map(() => [IDLE, DRIFT_BAND_HZ, SINES]),
    ];
    return bands.map(([stream, band, count]) => {
      const rates = Array.from({ length: count }, () => 2 * Math.PI * this.random[stream].uniform(...band));
      return rates.map((rate) => [rate, this.random[stream].uniform(0, 2 * Math.PI)]);
    });
  }

  // Sums of sines of natural variation: frequencies in rad/s and phases of each direction.
  drawnVariation() {
    const random = this.random[VARIED];
    return QUANTILES_HZ.map((quantiles) =>
      Array.from({ length: variation.SINES }, () => {
        const place = random.uniform(0, variation.PARTS);
        const [low, high] = quantiles.slice(Math.floor(place));
        return [2 * Math.PI * (low + (place % 1) * (high - low)), random.uniform(0, 2 * Math.PI)];
      }),
    );
  }

  fixation() {
    return FIXATION_S[0] + this.random[GAZE].exponential(FIXATION_S[1]);
  }

  // Draws what begins up to a time. phones: what is spoken, in time order; their time and shift is ours.
  draw(until, phones, shift) {
    if (until - this.drawnUntil > UNSEEN_S) this.blinkAt = this.glanceAt = this.drawnUntil = until;
    for (const phone of phones) this.learn(phone);
    this.phrases = this.phrases.filter(([, end]) => end + shift > until - KEPT_S);
    while (this.blinkAt <= until) this.blink(this.blinkAt, shift);
    while (this.glanceAt <= until) this.glance(this.glanceAt);
    this.drawNods(until, phones.filter(({ stress }) => stress), shift);
    for (let at = this.nextStance(shift); at <= until; at = this.nextStance(shift)) this.stance(at, shift);
    this.drawnUntil = until;
  }

  // Phones that follow each other closely are one phrase.
  learn({ start, end }) {
    const isNear = ([first, last]) => last >= start - PAUSE_S && first <= end + PAUSE_S;
    const near = [...this.phrases.filter(isNear), [start, end]];
    const joined = [Math.min(...near.map(([first]) => first)), Math.max(...near.map(([, last]) => last))];
    this.phrases = [...this.phrases.filter((phrase) => !isNear(phrase)), joined].sort(([one], [other]) => one - other);
  }

  // Forgets what was to be spoken after a time of the phones, and ends the current nod.
  hush(from) {
    this.nods.clear();
    this.channels.nod.to(0, this.drawnUntil, NOD_FALL_S);
    this.phrases = this.phrases.filter(([start]) => start <= from).map(([start, end]) => [start, Math.min(end, from)]);
  }

  blink(at, shift) {
    const random = this.random[BLINKS];
    const chance = random.uniform();
    this.blinkAt = at + random.exponential(1 / MOST_BLINKS);
    if (chance * MOST_BLINKS >= BLINKS_PER_S[this.stateAt(at - shift)] && this.hasBlinked) return;
    this.hasBlinked = true;
    this.blinkAt += MIN_BLINK_INTERVAL_S;
    this.channels.blink.to(1, at, BLINK_CLOSE_S);
    this.channels.blink.then(0, at + BLINK_CLOSE_S + BLINK_SHUT_S, BLINK_OPEN_S);
  }

  glance(at) {
    const random = this.random[GAZE];
    this.channels.glanceYaw.then(random.normal(GLANCE_RAD), at, SACCADE_S);
    this.channels.glancePitch.then(random.normal(GLANCE_RAD / 2), at, SACCADE_S);
    this.glanceAt = at + this.fixation();
  }

  // Each accent is judged when its nod begins; one that has begun when it becomes known makes none.
  drawNods(until, accents, shift) {
    const known = this.nods;
    const coming = accents.filter(({ start }) => known.has(start) || start + shift > until);
    this.nods = new Map(coming.map(({ start }) => [start, known.get(start) ?? { since: until, isJudged: false }]));
    const isDue = ({ at, phone }) => at <= until && !this.nods.get(phone.start).isJudged && phone.start + shift > this.drawnUntil;
    const timed = coming.map((phone) => ({ phone, at: Math.max(phone.start + shift - NOD_RISE_S, this.nods.get(phone.start).since) }));
    for (const { at, phone } of timed.filter(isDue).sort((one, other) => one.at - other.at)) {
      this.nods.get(phone.start).isJudged = true;
      if (this.isOutstanding(phone, accents, shift)) this.nod(at, phone, shift);
    }
  }

  // Whether an accent is the strongest of those near it.
  isOutstanding(phone, accents, shift) {
    const { start } = phone;
    const [begins, ends] = this.phrases.findLast(([first]) => first <= start) ?? [start, start];
    const last = this.noddedAt - shift;
    if (begins <= last && start - last < REACH_S) return false;
    if (start - Math.max(begins, last) >= 2 * REACH_S) return true;
    const strength = strengthOf(phone);
    const rivals = accents.filter((other) => other.start > start && other.start <= Math.min(start + REACH_S, ends));
    return rivals.every((other) => strengthOf(other) <= strength);
  }

  nod(at, { start, end, stress, loudness }, shift) {
    this.noddedAt = start + shift;
    const strength = (stress === 1 ? 1 : 0.5) * this.random[EMPHASIS].uniform(...NOD_STRENGTH) * 2 ** (loudness / DB_PER_DOUBLE_NOD);
    this.channels.nod.to(strength, at, NOD_RISE_S);
    this.channels.nod.then(0, at + NOD_RISE_S + NOD_HOLD * (end - start), NOD_FALL_S);
  }

  // Speaking, pausing or silent at a time of the phones.
  stateAt(at) {
    const phrase = this.phrases.findLast(([start]) => start <= at);
    if (!phrase || at > phrase[1] + BLINK_BEHIND_END_S) return "silent";
    return at < phrase[1] - BLINK_BEFORE_END_S ? "speaking" : "pausing";
  }

  // Time of the next onset or end of speech; of what came late, the last that was drawn.
  nextStance(shift) {
    const { phrases } = this;
    const least = Math.max(this.movedAt, this.drawnUntil);
    if (this.spokenFrom === null) {
      const coming = this.comingPhrase(shift);
      return coming ? Math.max(least, coming[0] + shift - ONSET_AHEAD_S) : Infinity;
    }
    let place = phrases.findLastIndex(([start]) => start <= this.spokenFrom + NEAR_S);
    if (place < 0) return least; // it was taken back before it began
    while (place + 1 < phrases.length && phrases[place + 1][0] - phrases[place][1] < ONSET_PAUSE_S) ++place;
    return Math.max(least, phrases[place][1] + shift);
  }

  // The next phrase for which the head has not moved; where the clock of the phones stands still, none that is over.
  comingPhrase(shift) {
    return this.phrases.find(([start, end]) => start + shift > this.movedAt && end + shift > this.drawnUntil);
  }

  // Moves on when speech begins, settles when it ends.
  stance(at, shift) {
    const coming = this.comingPhrase(shift);
    this.movedAt = at;
    const isOnset = this.spokenFrom === null && coming !== undefined;
    this.spokenFrom = isOnset ? coming[0] : null;
    if (isOnset) {
      const random = this.random[HEAD];
      this.turned = Object.values(STANCE_RAD).map((sizes, index) => (index ? random.sign() : 1) * random.uniform(...sizes));
    }
    const settled = this.turned.map((turn, index) => (index ? SETTLED * turn : SETTLED_PITCH_RAD));
    STANCES.forEach((name, index) => this.channels[name].to((isOnset ? this.turned : settled)[index], at, isOnset ? ONSET_S : SETTLE_S));
    this.channels.speaking.to(isOnset ? 1 : 0, at, isOnset ? RISE_S : FALL_S);
  }

  // Adds natural variation, 0..1 of it, to the FAPs of an expression, FAPU.
  vary(faps, now, liveliness) {
    const level = liveliness * this.channels.speaking.value(now) * Math.sqrt(2 / variation.SINES);
    DIRECTIONS.forEach((direction, index) => {
      const sum = this.varied[index].reduce((total, [rate, phase]) => total + Math.sin(rate * (now - this.begins) + phase), 0);
      for (const [number, size] of Object.entries(direction)) faps[number - 1] += level * sum * size;
    });
  }

  // 68 FAPs of a time that is drawn, FAPU: to be added after contacts are made.
  faps(now) {
    const level = Object.fromEntries(CHANNELS.map((name) => [name, this.channels[name].value(now)]));
    const faps = new Float64Array(fap.FAP_COUNT);
    const add = (numbers, value) => numbers.forEach((number) => (faps[number - 1] += value));
    const wander = this.waves.map((sines) => {
      const sum = sines.reduce((total, [rate, phase]) => total + Math.sin(rate * (now - this.begins) + phase), 0);
      return sines.length > 1 ? sum / 2 : sum;
    });
    Object.entries(HEAD_AMPLITUDE_RAD).forEach(([number, size], index) => {
      add([Number(number)], ((size * wander[index] + level[STANCES[index]]) / AU_RAD) * level.headMotion);
    });
    const breath = Object.keys(HEAD_AMPLITUDE_RAD).length;
    add([48], (BREATH_RAD / AU_RAD) * level.idle * wander[breath]);
    DRIFTS_FAPU.forEach(([numbers, size], index) => add(numbers, size * level.idle * wander[breath + 1 + index]));
    add([48], (NOD_RAD / AU_RAD) * level.nod);
    add([31, 32, 33, 34, 35, 36], BROW_FAPU * level.nod);
    const shut = clamp(level.blink, 0, 1);
    add([19, 20], UPPER_LID * shut);
    add([21, 22], LOWER_LID * shut);
    add([23, 24], level.glanceYaw / AU_RAD - faps[48]);
    add([25, 26], level.glancePitch / AU_RAD - faps[47]);
    for (const [numbers, perRad] of LIDS_FOLLOW) add(numbers, perRad * AU_RAD * (1 - shut) * faps[24]);
    return faps;
  }
}
