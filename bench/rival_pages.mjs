// Lip syncs of web pages on the same sounds, as a page would show them: node rival_pages.mjs FOLDER FACE < JSON > JSON
// FOLDER is where npm installed HeadAudio, wawa-lipsync and TalkingHead; FACE is our package. In: { rate, clips: [{ samples,
// words: [[word, start, end]] }] }, samples as int16 in base64, times in s. Out: by name, for each clip, 60 frames a second: 15 weights of Oculus
// visemes, or [FAP 4, FAP 5] of ours. All run on a made clock; what is computed takes no time.

import { readFileSync } from "node:fs";
import { join } from "node:path";
import { pathToFileURL } from "node:url";

const FRAME_HZ = 60;
const BLOCK = 128;
const NAMES = ["sil", "PP", "FF", "TH", "DD", "kk", "CH", "SS", "nn", "RR", "aa", "E", "I", "O", "U"];
const ORDER = NAMES.map((name) => `viseme_${name}`);
const [home, face] = process.argv.slice(2);
const load = (...names) => import(pathToFileURL(join(...names)));

const { rate, clips } = JSON.parse(readFileSync(0, "utf8"));
const sounds = clips.map(({ samples }) => {
  const bytes = Uint8Array.from(Buffer.from(samples, "base64"));
  return Float32Array.from(new Int16Array(bytes.buffer), (sample) => sample / 32768);
});
let now = 0; // s
performance.now = () => 1000 * now;

// Lets time pass; take(samples) has the sound up to each frame, frame() tells what is shown then.
function played(sound, take, frame) {
  const frames = [];
  let at = 0;
  for (let number = 0; number < (sound.length / rate) * FRAME_HZ; ++number) {
    now = number / FRAME_HZ;
    for (; at + BLOCK <= now * rate; at += BLOCK) take(sound.subarray(at, at + BLOCK));
    frames.push(frame());
  }
  return frames;
}

// Its worklet and its node, with its model and defaults.
async function headAudio() {
  const modules = join(home, "node_modules", "@met4citizen", "headaudio", "modules");
  globalThis.AudioWorkletNode = class {
    port = { postMessage() {} };
  };
  const [{ Processor }, { Training }, { HeadAudio }] = await Promise.all(["processor.mjs", "training.mjs", "headaudio.mjs"].map((name) => load(modules, name)));
  const bytes = readFileSync(join(modules, "..", "dist", "model-en-mixed.bin"));
  globalThis.fetch = async () => new Response(bytes);
  const shown = [];
  for (const sound of sounds) {
    const node = new HeadAudio({});
    const processor = new Processor({ sampleRate: rate }, { port: { postMessage: (data) => node._onmessage({ data }) } });
    const { model } = await new Training().loadModel("model-en-mixed.bin");
    processor._onmessage({ data: { event: "model", model } });
    const weights = Object.fromEntries(ORDER.map((name) => [name, 0]));
    node.onvalue = (name, value) => (weights[name] = value);
    shown.push(
      played(sound, (block) => processor.process(block), () => {
        node.update(1000 / FRAME_HZ);
        return ORDER.map((name) => weights[name]);
      }),
    );
  }
  return shown;
}

// The AnalyserNode of the Web Audio standard: Blackman window, smoothing .8, -100 to -30 dB.
class Analyser {
  fftSize = 2048;
  recent = new Float32Array(2048);
  get frequencyBinCount() {
    return this.fftSize / 2;
  }
  connect() {}
  push(block) {
    this.recent.copyWithin(0, block.length);
    this.recent.set(block, this.fftSize - block.length);
  }
  getByteFrequencyData(bytes) {
    const count = this.fftSize;
    const [real, imaginary] = [new Float64Array(count), new Float64Array(count)];
    for (let n = 0; n < count; ++n) {
      const turn = (2 * Math.PI * n) / count;
      real[n] = this.recent[n] * (0.42 - 0.5 * Math.cos(turn) + 0.08 * Math.cos(2 * turn));
    }
    transform(real, imaginary);
    this.smooth ??= new Float64Array(count / 2);
    for (let bin = 0; bin < count / 2; ++bin) {
      this.smooth[bin] = 0.8 * this.smooth[bin] + (0.2 * Math.hypot(real[bin], imaginary[bin])) / count;
      const db = 20 * Math.log10(this.smooth[bin]);
      bytes[bin] = Math.max(0, Math.min(255, Math.floor((255 / 70) * (db + 100))));
    }
  }
}

// Fourier transform in place; the length is a power of two.
function transform(real, imaginary) {
  const count = real.length;
  for (let n = 1, place = 0; n < count; ++n) {
    let bit = count >> 1;
    for (; place & bit; bit >>= 1) place ^= bit;
    place ^= bit;
    if (n < place) [real[n], real[place], imaginary[n], imaginary[place]] = [real[place], real[n], imaginary[place], imaginary[n]];
  }
  for (let size = 2; size <= count; size *= 2) {
    for (let first = 0; first < count; first += size) {
      for (let n = 0; n < size / 2; ++n) {
        const turn = (-2 * Math.PI * n) / size;
        const [one, other] = [first + n, first + n + size / 2];
        const re = real[other] * Math.cos(turn) - imaginary[other] * Math.sin(turn);
        const im = real[other] * Math.sin(turn) + imaginary[other] * Math.cos(turn);
        [real[other], imaginary[other]] = [real[one] - re, imaginary[one] - im];
        [real[one], imaginary[one]] = [real[one] + re, imaginary[one] + im];
      }
    }
  }
}

// wawa names a viseme; here its weight rises and the others fall by a fifth a frame for vowels, by two fifths else.
async function wawa() {
  let analyser = null;
  globalThis.window = { AudioContext: class { sampleRate = rate; createAnalyser = () => (analyser = new Analyser()); } };
  const { Lipsync } = await load(home, "node_modules", "wawa-lipsync", "dist", "wawa-lipsync.es.js");
  return sounds.map((sound) => {
    now = 0;
    const lipsync = new Lipsync();
    const weights = new Array(ORDER.length).fill(0);
    return played(sound, (block) => analyser.push(block), () => {
      lipsync.processAudio();
      const share = lipsync.state === "vowel" ? 0.2 : 0.4;
      ORDER.forEach((name, index) => (weights[index] += share * ((name === lipsync.viseme) - weights[index])));
      return [...weights];
    });
  });
}

// Its visemes for words with times, and its animation of them: speakAudio and animate of talkinghead.mjs.
async function talkingHead() {
  const modules = join(home, "node_modules", "@met4citizen", "talkinghead", "modules");
  const [{ TalkingHead }, { LipsyncEn }] = await Promise.all(["talkinghead.mjs", "lipsync-en.mjs"].map((name) => load(modules, name)));
  const { prototype } = TalkingHead;
  const easing = prototype.sigmoidFactory(5);
  return clips.map(({ words }, index) => {
    const head = Object.assign(Object.create(prototype), {
      avatar: {}, opt: { lipsyncLang: "en" }, lipsync: { en: new LipsyncEn() }, speechQueue: [], startSpeaking() {},
    });
    const times = words.map(([, start]) => 1000 * start);
    const durations = words.map(([, start, end]) => 1000 * (end - start));
    head.speakAudio({ words: words.map(([word]) => word), wtimes: times, wdurations: durations });
    const queue = head.speechQueue[0].anim;
    const values = Object.fromEntries(ORDER.map((name) => [name, 0]));
    return played(sounds[index], () => {}, () => {
      const clock = 1000 * now;
      for (const { ts, vs } of queue) {
        const step = ts.findLastIndex((time) => clock >= time);
        if (step < 0) continue;
        const [[name, goals]] = Object.entries(vs);
        goals[step] ??= values[name];
        const isLast = step === ts.length - 1;
        const share = isLast ? 0 : easing((clock - ts[step]) / (ts[step + 1] - ts[step]));
        values[name] = isLast ? goals[step] : (1 - share) * goals[step] + share * goals[step + 1];
      }
      return ORDER.map((name) => values[name]);
    });
  });
}

// Ours follows sound; the sound is later by the delay, too.
async function ours(delay) {
  globalThis.fetch = undefined;
  const { Live } = await load(face, "live", "index.js");
  const shown = [];
  for (const sound of sounds) {
    const [live, faps, frames] = [await Live.make({ still: true }), new Float32Array(68), []];
    let at = 0;
    for (let number = 0; number < (sound.length / rate + delay) * FRAME_HZ; ++number) {
      const until = Math.min(Math.floor((number / FRAME_HZ) * rate), sound.length);
      await live.push(until > at ? sound.subarray(at, until) : new Float32Array(Math.floor(rate / FRAME_HZ)), rate, { delay });
      at = Math.max(until, at);
      live.sample(0, faps);
      if (number >= delay * FRAME_HZ) frames.push([faps[3], faps[4]]);
    }
    live.close();
    shown.push(frames);
  }
  return shown;
}

const found = { HeadAudio: await headAudio(), "wawa-lipsync": await wawa(), TalkingHead: await talkingHead() };
for (const delay of [0.2, 0.25]) found[`ours, ${delay} s`] = await ours(delay);
process.stdout.write(JSON.stringify(found));
