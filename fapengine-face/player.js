// A .fap file that is played, with its sound beside it: the face is where the sound is.

import { HighLevelFaps } from "./high-level.js";

const VISEME_NUMBERS = 4;
const EXPRESSION_NUMBERS = 6;

// Text of a .fap file, version 2.1, a line of mask and a line of values for each frame: { rate, times (s), frames (68
// numbers each) }. Visemes and expressions (FAP 1 and 2) become the low-level FAPs that show them. Of files that hold one
// number for each, as Greta writes them, it is the first select.
export function parseFap(text) {
  const lines = text.split(/\r?\n/).map((line) => line.trim()).filter((line) => line && !line.startsWith("#"));
  const header = (lines.shift() ?? "").split(/\s+/);
  const rate = Number(header.at(-2));
  if (header.length < 3 || !/^[12]\.\d$/.test(header[0]) || !(rate > 0)) {
    throw new Error(`FAP file: got ${JSON.stringify(header.join(" ").slice(0, 60))}, expected '2.1 name rate frames'`);
  }
  const [times, frames] = [[], []];
  let highLevel = null; // from the first viseme or expression on
  for (let line = 0; line + 1 < lines.length; line += 2) {
    const mask = lines[line].split(/\s+/);
    const numbers = lines[line + 1].split(/\s+/).map(Number);
    const sent = mask.slice(0, 68).filter((digit) => digit === "1").length;
    const [visemes, expressions] =
      numbers.length === sent + 1 ? [Number(mask[0]), Number(mask[1])] : [VISEME_NUMBERS * mask[0], EXPRESSION_NUMBERS * mask[1]];
    const first = 1 + visemes + expressions;
    const expected = first + sent - mask[0] - mask[1];
    if (mask.length < 68 || numbers.length !== expected || !numbers.every(Number.isFinite)) {
      throw new Error(`FAP file: got ${numbers.length} numbers in frame ${frames.length}, expected ${expected} behind 68 digits`);
    }
    let place = first;
    const faps = Float32Array.from({ length: 68 }, (_, column) => (column > 1 && mask[column] === "1" ? numbers[place++] : 0));
    times.push(numbers[0] / rate);
    if (visemes + expressions) highLevel ??= new HighLevelFaps();
    frames.push(highLevel?.show(faps, mask.map((digit) => digit === "1"), ...selected(numbers, visemes, expressions)) ?? faps);
  }
  if (!frames.length) throw new Error("FAP file: got no frame");
  const start = times[0];
  return { rate, times: times.map((time) => time - start), frames };
}

// FAP 1 and 2 of a frame. A single number is the first select at full weight.
function selected(numbers, visemes, expressions) {
  const viseme = numbers.slice(1, 1 + visemes);
  const expression = numbers.slice(1 + visemes, 1 + visemes + expressions);
  return [visemes === 1 ? [viseme[0], 0, 63, 0] : viseme, expressions === 1 ? [expression[0], 63, 0, 0, 0, 0] : expression];
}

// Events: started, finished.
export class Player extends EventTarget {
  // track: see parseFap. audio: address of its sound, or null.
  constructor(track, audio = null) {
    super();
    this.track = track;
    this.duration = track.times.at(-1) + 1 / track.rate;
    this.audio = audio ? new Audio(audio) : null;
    if (this.audio) this.audio.preload = "auto";
    this.since = null; // when it began, by the page's clock, where it has no sound
    this.at = 0; // where it stands still
    this.isSpeaking = false;
  }

  // Resolves when it plays; browsers let a page sound only after a click or a key.
  async play() {
    if (this.at >= this.duration) this.at = 0;
    if (this.audio) {
      this.audio.currentTime = this.at;
      await this.audio.play();
    }
    this.since = performance.now() / 1000 - this.at;
    this.isSpeaking = true;
    this.dispatchEvent(new Event("started"));
  }

  pause() {
    this.at = Math.min(this.position(performance.now() / 1000), this.duration);
    this.since = null;
    this.isSpeaking = false;
    this.audio?.pause();
  }

  close() {
    this.pause();
    this.audio?.removeAttribute("src");
  }

  position(now) {
    if (this.since === null) return this.at;
    return this.audio && !this.audio.ended ? this.audio.currentTime : now - this.since;
  }

  sample(now, faps) {
    const { times, frames, rate } = this.track;
    const position = this.position(now);
    let later = Math.min(Math.ceil(position * rate), times.length - 1);
    while (later > 0 && times[later - 1] > position) --later;
    while (later < times.length - 1 && times[later] < position) ++later;
    const before = Math.max(later - 1, 0);
    const share = before === later ? 1 : Math.min(Math.max((position - times[before]) / (times[later] - times[before]), 0), 1);
    for (let column = 0; column < 68; ++column) {
      faps[column] = frames[before][column] + (frames[later][column] - frames[before][column]) * share;
    }
    if (this.isSpeaking && position >= this.duration) {
      this.pause();
      this.at = this.duration;
      this.dispatchEvent(new Event("finished"));
    }
    return { time: position };
  }
}
