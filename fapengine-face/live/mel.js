// What the network sees of sound, in float32 as there: log_mel and RunningMean of fapengine/recognition/small_net.py.

import { loudness, small_net } from "./constants.js";
import { Fft } from "./fft.js";

const { BANDS, FALL, FFT, FIRST_COUNT, FLOOR, LIMIT, LOUD, MAX_COUNT, QUIETEST, SCALE, WIDTH, WINDOW } = small_net;
const { HOP } = loudness;
const { fround } = Math;
const BINS = FFT / 2 + 1;

// Rows of mel bands from int16 samples.
export class LogMel {
  // tables: window (400), filters (257 bins x 40 bands).
  constructor({ window, filters }) {
    this.window = window;
    this.filters = Array.from({ length: BANDS }, (_, band) => {
      const column = Array.from({ length: BINS }, (_, bin) => filters[bin * BANDS + band]);
      const first = column.findIndex((value) => value > 0);
      const stop = BINS - column.slice().reverse().findIndex((value) => value > 0);
      return { first, values: Float32Array.from(column.slice(first, stop)) };
    });
    this.fft = new Fft(FFT);
    [this.real, this.imaginary, this.power] = [new Float64Array(FFT), new Float64Array(FFT), new Float32Array(BINS)];
  }

  // Writes the bands of two frames, 10 ms apart, that begin at a sample: one transform for both.
  pair(samples, at, out) {
    const { fft, window, real, imaginary } = this;
    real.fill(0);
    imaginary.fill(0);
    for (let n = 0; n < WINDOW; ++n) {
      real[n] = samples[at + n] * window[n];
      imaginary[n] = samples[at + HOP + n] * window[n];
    }
    fft.run(real, imaginary);
    this.bands(1, out, 0);
    this.bands(-1, out, BANDS);
  }

  // Of the first frame, side 1, or the second, -1: what is even and odd in the spectrum of both.
  bands(side, out, place) {
    const { power, real, imaginary } = this;
    for (let k = 0; k < BINS; ++k) {
      const mirror = (FFT - k) % FFT;
      const x = real[k] + side * real[mirror];
      const y = imaginary[k] - side * imaginary[mirror];
      power[k] = (x * x + y * y) / 4;
    }
    this.filters.forEach(({ first, values }, band) => {
      let sum = 0;
      for (let k = 0; k < values.length; ++k) sum += power[first + k] * values[k];
      out[place + band] = Math.log(fround(fround(sum) + fround(FLOOR)));
    });
  }
}

// Subtracts the running mean of loud frames. Stateful.
export class RunningMean {
  constructor(firstMean) {
    Object.assign(this, { firstMean, peak: fround(QUIETEST), count: 0, sum: new Float32Array(BANDS) });
  }

  // bands, out: the numbers of a frame begin at these places.
  push(bands, from, out, to) {
    let total = 0;
    for (let band = 0; band < BANDS; ++band) total += fround(Math.exp(bands[from + band]));
    const level = fround(Math.log(fround(total / BANDS)));
    this.peak = Math.max(fround(this.peak - fround(FALL)), level, fround(QUIETEST));
    const isLoud = level > fround(this.peak - fround(LOUD)) ? 1 : 0;
    const keep = this.count >= MAX_COUNT ? fround(1 - fround(isLoud / MAX_COUNT)) : 1;
    this.count = fround(fround(this.count * keep) + isLoud);
    const limited = (value) => Math.min(Math.max(fround(value * SCALE), -LIMIT), LIMIT);
    for (let band = 0; band < BANDS; ++band) {
      const value = bands[from + band];
      this.sum[band] = fround(this.sum[band] * keep) + isLoud * value;
      const first = fround(fround(this.firstMean[band] + this.peak) * FIRST_COUNT);
      const mean = fround(fround(first + this.sum[band]) / fround(FIRST_COUNT + this.count));
      out[to + band] = limited(fround(value - mean));
    }
    out[to + WIDTH - 1] = limited(fround(fround(level - this.peak) + fround(LOUD)));
  }
}
