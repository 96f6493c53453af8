// Sound in, phones with stress and loudness out, without a text: SmallRecognizer of
// fapengine/recognition/small_recognizer.py, with what process.py adds to its phones. Stateful.

import { loudness, phone_track, protocol, small_net, small_recognizer } from "./constants.js";
import { LogMel, RunningMean } from "./mel.js";
import { Search } from "./search.js";
import { SmallNet } from "./small-net.js";
import { RunningProsody } from "./prosody.js";
import { readTables } from "./tables.js";
import { Voicing, joined } from "./voicing.js";

const { AHEAD, BANDS, BEFORE, STEPS, WIDTH, WINDOW } = small_net;
const { HOP } = loudness;
const { FRAME_HZ, MIN_FRAMES, RATE_HZ } = protocol;
const { LOOK_AHEAD_S, ONSET_FRAMES } = small_recognizer;
const { SILENCE } = phone_track;

// Segments of a new hypothesis that are final now: fapengine/recognition/protocol.py.
function due(segments, told, horizon, isEnd = false) {
  const chosen = [];
  let now = told;
  for (const [label, , stop] of segments) {
    if (stop <= now) continue;
    if (stop > horizon && !isEnd) {
      if (label === SILENCE && horizon - now >= MIN_FRAMES) chosen.push([label, now, horizon]);
      break;
    }
    if (stop - now < MIN_FRAMES && stop < segments.at(-1)[2] && !isEnd) continue; // the next begins earlier
    chosen.push([label, now, stop]);
    now = stop;
  }
  return chosen;
}

// Leaves out speech that has just begun after silence.
function begun(segments, now) {
  const place = segments.findLastIndex(([label]) => label === SILENCE) + 1;
  const follows = place > 0 || segments[0]?.[1] === 0;
  return follows && segments[place] && now - segments[place][1] < ONSET_FRAMES ? segments.slice(0, place) : segments;
}

// Scores of the network's labels for each frame of a stream. Stateful.
class Scores {
  constructor(tables, net) {
    this.frames = 2 * net.steps;
    this.labels = tables.labels.length;
    this.waiting = new Int16Array(BEFORE); // from the first of the next block's windows on
    this.mel = new LogMel(tables.arrays);
    this.mean = new RunningMean(tables.arrays.firstMean);
    this.net = net;
    net.reset();
    this.skip = 2 * AHEAD; // frames of scores that lie before the first frame
    this.bands = new Float32Array(2 * BANDS);
    this.input = new Float32Array(this.frames * WIDTH);
    this.seen = 0; // frames
  }

  // Calls take(scores, place) for each of the next frames.
  push(samples, take) {
    this.waiting = joined(this.waiting, samples);
    const block = this.frames * HOP;
    let at = 0;
    for (; this.waiting.length - at >= block + WINDOW - HOP; at += block) {
      for (let frame = 0; frame < this.frames; frame += 2) {
        this.mel.pair(this.waiting, at + frame * HOP, this.bands);
        for (const side of [0, 1]) this.mean.push(this.bands, side * BANDS, this.input, (frame + side) * WIDTH);
      }
      this.seen += this.frames;
      const scores = this.net.push(this.input);
      for (let frame = Math.min(this.skip, this.frames); frame < this.frames; ++frame) take(scores, frame * this.labels);
      this.skip = Math.max(this.skip - this.frames, 0);
    }
    this.waiting = this.waiting.slice(at);
  }
}

export class Recognizer {
  // buffer: the package's assets/recognizer.bin. lookAhead: age at which a phone is final, s. steps: blocks of so many
  // times 20 ms; with 1, phones are those of Python.
  constructor(buffer, { lookAhead = LOOK_AHEAD_S, steps = STEPS } = {}) {
    if (!(lookAhead >= 0)) throw new TypeError(`lookAhead: got ${lookAhead}, expected s, 0 or more`);
    if (!(Number.isInteger(steps) && steps > 0)) throw new TypeError(`steps: got ${steps}, expected an integer, 1 or more`);
    Object.assign(this, { tables: readTables(buffer), lookAhead, steps, block: 2 * steps * HOP });
    this.net = new SmallNet(this.tables, steps);
    this.reset();
  }

  // The next sample is the first.
  reset() {
    this.waiting = new Int16Array(0);
    this.came = this.told = 0;
    this.partial = []; // phones after the final ones, which may still change; the last one is not over yet
    this.scores = new Scores(this.tables, this.net);
    this.voicing = new Voicing();
    this.search = new Search(this.tables.arrays);
    this.prosody = new RunningProsody();
  }

  // samples: Int16Array, 16 kHz, mono. Returns the phones that are final now: { label, start, end, stress?, loudness? }, s
  // and dB, without gaps; what is not known yet is left out.
  push(samples) {
    if (!(samples instanceof Int16Array)) throw new TypeError(`push: got ${samples?.constructor?.name}, expected an Int16Array at 16 kHz`);
    this.came += samples.length;
    this.waiting = joined(this.waiting, samples);
    const phones = [];
    let at = 0;
    for (; this.waiting.length - at >= this.block; at += this.block) {
      const block = this.waiting.slice(at, at + this.block);
      this.voicing.push(block);
      this.scores.push(block, (scores, place) => this.voicing.recognize(this.search.push(scores, place)));
      phones.push(...this.report(this.scores.seen - Math.round(this.lookAhead * FRAME_HZ)));
    }
    this.waiting = this.waiting.slice(at);
    return phones;
  }

  // Ends the sound; returns the rest of its phones.
  end() {
    const count = Math.ceil(this.came / HOP);
    if (!count) return [];
    this.voicing.push(this.waiting, 0);
    const silence = new Int16Array((count - this.search.now + 2 * (2 * AHEAD + 2 * this.steps)) * HOP);
    const take = (scores, place) => this.search.now < count && this.voicing.recognize(this.search.push(scores, place));
    this.scores.push(joined(this.waiting, silence), take);
    const phones = this.report(count, true);
    this.reset();
    return phones;
  }

  report(horizon, isEnd = false) {
    const segments = this.voicing.spoken(this.search.segments(this.told).map(([label, ...frames]) => [this.tables.labels[label], ...frames]));
    const chosen = due(segments, this.told, horizon, isEnd);
    if (chosen.length) this.told = chosen.at(-1)[2];
    this.search.forget(this.told);
    const partial = begun(due(segments, this.told, this.search.now), this.search.now);
    const soundingOf = (phone) => this.voicing.sounding(phone);
    const [phones, changing] = this.prosody.push(this.phonesOf(chosen), this.phonesOf(partial), soundingOf);
    this.partial = changing;
    return phones;
  }

  phonesOf(segments) {
    const end = this.came / RATE_HZ;
    return segments
      .filter(([, first]) => first / FRAME_HZ < end)
      .map(([label, first, stop]) => ({ label, start: first / FRAME_HZ, end: Math.min(stop / FRAME_HZ, end) }));
  }
}
