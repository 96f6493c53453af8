// Loudness and pitch of frames and phones, and which segments of a hypothesis are a voice:
// fapengine/recognition/loudness.py, and Voicing of small_recognizer.py.

import { loudness, phone_track, protocol, small_recognizer } from "./constants.js";
import { Fft } from "./fft.js";

const {
  CONTEXT, EVEN, GLIDE_FRAMES, GLIDING_FRAMES, HOP, LABEL_FRAMES, LATE, LONG_FRAMES, LONG_GLIDE_FRAMES, MAX_GLIDE, MAX_PHONE_S, PITCH_HZ, QUIET_DB, REACH_S, SILENT_DB, STEADY_FRAMES, STEADY_SHARE, STILL, SURE_FRAMES,
  VOICED, VOICED_FRAMES, WHISPER_FRAMES, WHISPER_LABELS, WINDOW,
} = loudness;
const { FRAME_HZ, RATE_HZ } = protocol;
const { LIKELY, NEAR_VOWEL, REMEMBERED, SURE, VOWEL_LETTERS } = small_recognizer;
const { SILENCE } = phone_track;
const [SHORTEST, LONGEST] = [Math.trunc(RATE_HZ / PITCH_HZ[1]), Math.trunc(RATE_HZ / PITCH_HZ[0])];
const AROUND = (WINDOW - HOP) / 2;
const LENGTH = 2 ** Math.ceil(Math.log2(WINDOW + LONGEST)); // of the transform: no lag that is looked at wraps round

export const isVowel = (label) => VOWEL_LETTERS.includes(label[0]);
export const median = (values) => {
  const ordered = [...values].sort((one, other) => one - other);
  const half = ordered.length >> 1;
  return ordered.length % 2 ? ordered[half] : (ordered[half - 1] + ordered[half]) / 2;
};
export const joined = (one, other) => {
  const both = new one.constructor(one.length + other.length);
  both.set(one);
  both.set(other, one.length);
  return both;
};

// Level of 160 samples, dB; those beyond the end are 0.
function levelOf(samples, from) {
  let sum = 0;
  for (const sample of samples.subarray(from, from + HOP)) sum += sample * sample;
  return Math.max(10 * Math.log10(Math.max(sum / HOP / 2 ** 30, 1e-12)), SILENT_DB);
}

// Pitch of frames of 640 samples. Its buffers are used again.
class Pitch {
  constructor() {
    this.fft = new Fft(LENGTH);
    [this.real, this.imaginary] = [new Float64Array(LENGTH), new Float64Array(LENGTH)];
    this.energy = new Float64Array(WINDOW);
    this.alike = new Float64Array(LONGEST - SHORTEST + 1);
  }

  // Hz; 0 where it is not voiced.
  of(frame) {
    const { alike } = this;
    this.compare(frame);
    const least = 0.9 * alike.reduce((most, value) => Math.max(most, value), -Infinity);
    for (let lag = 1; lag < alike.length - 1; ++lag) {
      const [before, at, after] = [alike[lag - 1], alike[lag], alike[lag + 1]];
      if (!(at >= least && at >= before && at >= after)) continue;
      if (at < VOICED) return 0;
      const bend = before - 2 * at + after;
      const shift = Math.abs(bend) > 1e-12 ? (0.5 * (before - after)) / bend : 0;
      return RATE_HZ / (lag + SHORTEST + Math.min(Math.max(shift, -0.5), 0.5));
    }
    return 0;
  }

  // Similarity of a frame to itself at each lag.
  compare(frame) {
    const { fft, real, imaginary, energy, alike } = this;
    const mean = frame.reduce((sum, sample) => sum + sample, 0) / WINDOW;
    real.fill(0);
    imaginary.fill(0);
    let total = 0;
    for (let n = 0; n < WINDOW; ++n) {
      real[n] = frame[n] - mean;
      energy[n] = total += real[n] * real[n];
    }
    fft.run(real, imaginary);
    for (let k = 0; k < LENGTH; ++k) {
      real[k] = real[k] * real[k] + imaginary[k] * imaginary[k];
      imaginary[k] = 0;
    }
    fft.run(real, imaginary); // of an even spectrum: the inverse but for its scale
    const least = 1e-9 * Math.max(total, 1) ** 2;
    for (let lag = SHORTEST; lag <= LONGEST; ++lag) {
      const power = Math.max(energy[WINDOW - 1 - lag] * (total - energy[lag - 1]), least);
      alike[lag - SHORTEST] = real[lag] / LENGTH / Math.sqrt(power + 1e-9);
    }
  }
}

// How many frames are marked within a second of each.
function around(marked) {
  const reach = Math.round(REACH_S * FRAME_HZ);
  const total = [0];
  for (const one of marked) total.push(total.at(-1) + (one ? 1 : 0));
  return marked.map((_, at) => total[Math.min(at + reach + 1, marked.length)] - total[Math.max(at - reach, 0)]);
}

// Pitches of frames, 0 where they do not glide as a voice's do.
function gliding(pitches, frames = GLIDING_FRAMES) {
  const goesOn = (at) => pitches[at] > 0 && pitches[at - 1] > 0 && Math.abs(Math.log(pitches[at]) - Math.log(pitches[at - 1])) < MAX_GLIDE;
  const found = pitches.map(() => 0);
  for (let first = 0, stop = 1; first < pitches.length; first = stop++) {
    while (stop < pitches.length && goesOn(stop)) ++stop;
    if (stop - first >= frames) for (let at = first; at < stop; ++at) found[at] = pitches[at];
  }
  return found;
}

// Pitch and loudness of the last seconds. Stateful.
export class Voicing {
  constructor() {
    this.finder = new Pitch();
    this.sound = new Int16Array(0);
    this.begins = 0; // frame at which the sound begins
    this.pitches = [];
    this.levels = [];
    this.first = 0; // frame at which these begin
    this.vowel = -REMEMBERED; // frame after the last vowel
    this.heard = []; // the network's best label and the logarithm of its probability, of each of the last frames
    this.heardFirst = 0;
  }

  // Adds these of the next frame.
  recognize(found) {
    this.heard.push(found);
    if (this.heard.length <= 2 * REMEMBERED) return;
    this.heard.shift();
    this.heardFirst += 1;
  }

  // Label of which the network is sure in each frame, 0 for silence and none.
  sure(least) {
    return this.pitches.map((_, at) => {
      const [label, log] = this.heard[at + this.first - this.heardFirst] ?? [0, 0];
      return log >= least ? label : 0;
    });
  }

  // Adds int16 samples, whole frames except at the end; the last frames get no pitch yet.
  push(samples, late = LATE) {
    this.sound = joined(this.sound, samples);
    for (let at = 0; at < samples.length; at += HOP) this.levels.push(levelOf(samples, at));
    const frame = new Float64Array(WINDOW);
    const count = Math.ceil(this.sound.length / HOP) - late;
    for (let number = this.first + this.pitches.length - this.begins; number < count; ++number) {
      for (let n = 0; n < WINDOW; ++n) frame[n] = this.sound[number * HOP - AROUND + n] ?? 0;
      this.pitches.push(this.finder.of(frame));
    }
    const over = Math.max(Math.floor(this.sound.length / HOP) - CONTEXT, 0);
    this.sound = this.sound.slice(over * HOP);
    this.begins += over;
    const gone = Math.max(this.pitches.length - REMEMBERED, 0);
    this.pitches.splice(0, gone);
    this.levels.splice(0, gone);
    this.first += gone;
  }

  // Loudness and pitch of a phone of the last seconds.
  sounding({ start, end }) {
    const [from, stop] = [start, end].map((at) => Math.max(Math.trunc(at * FRAME_HZ + EVEN) - this.first, 0));
    const first = Math.min(from, Math.max(this.levels.length - 1, 0));
    const [levels, pitches] = [this.levels, this.pitches].map((list) => list.slice(first, Math.max(first + 1, stop)));
    const voiced = pitches.filter((pitch) => pitch > 0);
    return { level: Math.max(SILENT_DB, ...levels), pitch: voiced.length ? median(voiced) : 0 };
  }

  // Which frames have a voice near them that is not music, or a whisper.
  voices() {
    const voices = this.voiced();
    if (voices.every(Boolean)) return voices;
    const sure = this.sure(SURE);
    const counts = [...new Set(sure)].filter(Boolean).map((label) => around(sure.map((one) => one === label)));
    const voiced = around(this.pitches.map((pitch) => pitch > 0));
    const isWhispered = (at) =>
      counts.reduce((sum, count) => sum + count[at], 0) >= WHISPER_FRAMES &&
      counts.filter((count) => count[at] >= LABEL_FRAMES).length >= WHISPER_LABELS &&
      voiced[at] < VOICED_FRAMES;
    return voices.map((one, at) => one || isWhispered(at));
  }

  voiced() {
    const [pitches, sure] = [gliding(this.pitches), around(this.sure(LIKELY))];
    const voiced = around(pitches.map((pitch) => pitch > 0));
    const still = around(pitches.map((pitch, at) => {
      const before = pitches[at - GLIDE_FRAMES];
      return pitch > 0 && before > 0 && Math.abs(Math.log(pitch / before)) < STILL;
    }));
    const [long, near] = [gliding(this.pitches, LONG_GLIDE_FRAMES).map((pitch) => pitch > 0), pitches.map(() => true)].map(around);
    const isSpoken = (at) => sure[at] >= SURE_FRAMES || (long[at] >= LONG_FRAMES && long[at] < near[at]);
    const isVoiced = (at) => voiced[at] >= VOICED_FRAMES && isSpoken(at);
    return pitches.map((_, at) => isVoiced(at) && !(still[at] >= STEADY_FRAMES && still[at] >= STEADY_SHARE * voiced[at]));
  }

  // Replaces segments that are voiceless, music, very quiet, or isolated by silence; without gaps.
  spoken(segments) {
    const voices = this.voices();
    const found = [];
    segments.forEach(([label, first, stop], index) => {
      const following = segments.slice(index + 1).map(([one]) => one);
      const near = [Math.max(first - this.first, 0), Math.max(stop - this.first, 1)];
      const voice = voices.slice(...near);
      const isPhone =
        label !== SILENCE &&
        stop - first <= MAX_PHONE_S[isVowel(label)] * FRAME_HZ &&
        Math.max(SILENT_DB, ...this.levels.slice(...near)) >= QUIET_DB &&
        (isVowel(label) || first - this.vowel <= NEAR_VOWEL || following.some(isVowel) || (following[0] ?? SILENCE) !== SILENCE) &&
        2 * voice.filter(Boolean).length >= voice.length;
      if (!isPhone && found.at(-1)?.[0] === SILENCE) found.at(-1)[2] = stop;
      else found.push([isPhone ? label : SILENCE, first, stop]);
      if (isPhone && isVowel(label)) this.vowel = stop;
    });
    return found;
  }
}
