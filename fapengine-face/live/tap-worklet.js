// In the browser's thread of sound: one channel at 16 kHz, in pieces of 20 ms, straight to the recognizer's worker. It
// imports nothing, because bundlers copy it as it is.

const RATE_HZ = 16_000;
const PIECE = 320;
const CROSSINGS = 12; // zero crossings of the filter to either side
const EDGE = 0.96; // share of the narrower band that passes

const divisor = (one, other) => (other ? divisor(other, one % other) : one);

// Sound of any rate to 16 kHz by a windowed sinc. Stateful.
export class Resampler {
  constructor(rate) {
    const common = divisor(RATE_HZ, rate);
    [this.up, this.down] = [RATE_HZ / common, rate / common];
    const band = Math.min(1, RATE_HZ / rate);
    const half = Math.ceil(CROSSINGS / band);
    this.taps = 2 * half;
    this.filters = Array.from({ length: this.up }, (_, phase) => {
      const filter = Float64Array.from({ length: this.taps }, (__, tap) => {
        const x = tap - half + 1 - phase / this.up;
        const sinc = x ? Math.sin(Math.PI * EDGE * band * x) / (Math.PI * x) : EDGE * band;
        return Math.abs(x) < half ? sinc * (0.5 + 0.5 * Math.cos((Math.PI * x) / half)) : 0;
      });
      const sum = filter.reduce((total, value) => total + value, 0);
      return filter.map((value) => value / sum);
    });
    this.kept = new Float32Array(half - 1); // silence before the first sample
    this.phase = this.at = 0;
  }

  // Takes samples, calls take(sample) for each of 16 kHz.
  push(samples, take) {
    const all = new Float32Array(this.kept.length + samples.length);
    all.set(this.kept);
    all.set(samples, this.kept.length);
    while (this.at + this.taps <= all.length) {
      const filter = this.filters[this.phase];
      let sum = 0;
      for (let tap = 0; tap < this.taps; ++tap) sum += all[this.at + tap] * filter[tap];
      take(sum);
      this.phase += this.down;
      this.at += Math.floor(this.phase / this.up);
      this.phase %= this.up;
    }
    const over = Math.min(this.at, all.length);
    this.kept = all.slice(over);
    this.at -= over;
  }
}

// Gathers samples, -1 to 1 at any rate, into pieces of 320 int16. Stateful.
export class Pieces {
  constructor(rate, take) {
    Object.assign(this, { resampler: new Resampler(rate), take, piece: new Int16Array(PIECE), filled: 0 });
  }

  push(samples) {
    this.resampler.push(samples, (sample) => {
      this.piece[this.filled++] = Math.max(-32768, Math.min(32767, Math.round(32768 * sample)));
      if (this.filled < PIECE) return;
      this.take(this.piece);
      [this.piece, this.filled] = [new Int16Array(PIECE), 0];
    });
  }
}

if (globalThis.registerProcessor) {
  class Tap extends AudioWorkletProcessor {
    constructor() {
      super();
      this.isOver = false;
      this.pieces = null;
      this.port.onmessage = ({ data: { to, isOver } }) => {
        if (isOver) this.isOver = true;
        if (to) this.pieces = new Pieces(sampleRate, (piece) => to.postMessage(piece, [piece.buffer]));
        if (to) this.hasBegun = false;
      };
    }

    process([channels]) {
      if (this.isOver || !this.pieces) return !this.isOver;
      if (!this.hasBegun) this.port.postMessage({ begun: currentTime });
      this.hasBegun = true;
      const mono = new Float32Array(128); // silence too, where nothing is connected: time goes on
      for (const channel of channels) for (let n = 0; n < mono.length; ++n) mono[n] += channel[n] / channels.length;
      this.pieces.push(mono);
      return true;
    }
  }
  registerProcessor("fapengine-tap", Tap);
}
