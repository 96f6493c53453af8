// Loudness of phones relative to the speaker's usual one, and stressed vowels: RunningProsody of
// fapengine/speech/prosody.py. A sounding is a phone's loudness (dB below full scale) and pitch (Hz, 0 without a voice).

import { phone_track, prosody, protocol } from "./constants.js";
import { clamp, placeAfter, placeOf } from "./path.js";
import { isVowel, median } from "./voicing.js";

const {
  APART_S, AROUND_S, KEPT_S, KNOWN_S, MAX_CUES, NEAR_S, SAME_S, SETTLED_S, SHARES, SILENT_DB, STANDS_OUT, UNSURE_SHARE, USUAL_DB,
} = prosody;
const { LOUDNESS_DB, SILENCE } = phone_track;
const OWN_SHARE = UNSURE_SHARE * (1 - protocol.UNSURE); // of its own level that a vowel gets: none of them is sure

const atOf = ({ at }) => at;
const lengthOf = (vowels) => vowels.reduce((total, { length }) => total + length, 0);
const within = (vowels, at, reach) => vowels.slice(placeOf(vowels, at - reach, atOf), placeAfter(vowels, at + reach, atOf));

function usualLevel(vowels) {
  const half = lengthOf(vowels) / 2 - SAME_S;
  let below = 0;
  return [...vowels].sort((one, other) => one.level - other.level).find(({ length }) => (below += length) >= half).level;
}

// Mean level of the vowels around a phone, dB against the usual one; 0 without any.
function effortOf({ start, end }, vowels, usual) {
  const at = (start + end) / 2;
  let [sum, weights] = [0, 0];
  for (const vowel of within(vowels, at, 4 * AROUND_S)) {
    const weight = vowel.length * Math.exp(-0.5 * ((vowel.at - at) / AROUND_S) ** 2);
    sum += weight * vowel.level;
    weights += weight;
  }
  return weights ? sum / weights - usual : 0;
}

// How much louder, higher and longer a vowel is than those around it.
function prominenceOf(vowel, vowels) {
  const around = within(vowels, vowel.at, NEAR_S);
  const middle = (name) => median(around.map((other) => other[name]).filter((value) => name !== "pitch" || value > 0));
  const louder = vowel.level - middle("level");
  const higher = vowel.pitch > 0 ? 12 * Math.log2(vowel.pitch / middle("pitch")) : 0;
  const longer = Math.log2(vowel.length / middle("length"));
  return [louder, higher, longer].reduce((total, cue, index) => total + SHARES[index] * clamp(cue, -MAX_CUES[index], MAX_CUES[index]), 0);
}

// Numbers of the vowels from a time on that stand out among those around them.
function standingOut(vowels, from) {
  const scored = vowels.slice(placeOf(vowels, from, atOf)).map((vowel) => ({ ...vowel, score: prominenceOf(vowel, vowels) }));
  const chosen = [];
  for (const vowel of scored.filter(({ score }) => score >= STANDS_OUT).sort((one, other) => other.score - one.score)) {
    if (chosen.every(({ at }) => Math.abs(vowel.at - at) >= APART_S)) chosen.push(vowel);
  }
  return new Set(chosen.map(({ number }) => number));
}

// Phones with prosody, among vowels: theirs, and those before them.
function compared(phones, vowels) {
  if (!vowels.length || !phones.length) return phones;
  const usual = usualLevel(vowels);
  const stressed = standingOut(vowels, phones[0].start - SETTLED_S);
  const own = new Map(vowels.map(({ number, level }) => [number, level - usual]));
  return phones.map((phone, number) => {
    if (phone.label === SILENCE) return phone;
    const around = effortOf(phone, vowels, usual);
    let level = Math.sign(around) * Math.max(Math.abs(around) - USUAL_DB, 0);
    if (own.has(number)) level += OWN_SHARE * (own.get(number) - around);
    return { ...phone, stress: stressed.has(number) ? 1 : 0, loudness: Number(clamp(level, ...LOUDNESS_DB).toFixed(2)) };
  });
}

// Prosody of a stream of phones: each is compared with those before. Stateful.
export class RunningProsody {
  constructor() {
    this.vowels = []; // of the phones before
  }

  // Adds stress and loudness to the next phones and to those after them that may still change; soundingOf gives a phone's
  // sounding. Returns both.
  push(phones, partial, soundingOf) {
    const all = [...phones, ...partial];
    const own = all.map(({ label, start, end }, number) =>
      isVowel(label) && { number, at: (start + end) / 2, length: end - start, ...soundingOf({ start, end }) });
    const vowels = [...this.vowels, ...own.filter((vowel) => vowel && vowel.level > SILENT_DB)];
    if (phones.length) {
      const isKept = ({ number, at }) => number < phones.length && at > phones.at(-1).end - KEPT_S;
      this.vowels = vowels.filter(isKept).map((vowel) => ({ ...vowel, number: -1 }));
    }
    const found = lengthOf(vowels) >= KNOWN_S - SAME_S ? compared(all, vowels) : all;
    return [found.slice(0, phones.length), found.slice(phones.length)];
  }
}
