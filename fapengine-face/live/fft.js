// Complex Fourier transform in place; its length is a power of two.
export class Fft {
  constructor(length) {
    this.length = length;
    this.cos = Float64Array.from({ length: length / 2 }, (_, k) => Math.cos((2 * Math.PI * k) / length));
    this.sin = Float64Array.from({ length: length / 2 }, (_, k) => -Math.sin((2 * Math.PI * k) / length));
    const bits = Math.log2(length);
    this.swap = Uint32Array.from({ length }, (_, k) => {
      let found = 0;
      for (let bit = 0; bit < bits; ++bit) found |= ((k >> bit) & 1) << (bits - 1 - bit);
      return found;
    });
  }

  run(real, imaginary) {
    const { length, cos, sin, swap } = this;
    for (let k = 0; k < length; ++k) {
      const other = swap[k];
      if (other <= k) continue;
      const x = real[k];
      const y = imaginary[k];
      real[k] = real[other];
      imaginary[k] = imaginary[other];
      real[other] = x;
      imaginary[other] = y;
    }
    for (let half = 1; half < length; half *= 2) {
      const stride = length / (2 * half);
      for (let base = 0; base < length; base += 2 * half) {
        for (let k = 0; k < half; ++k) {
          const a = base + k;
          const b = a + half;
          const c = cos[k * stride];
          const s = sin[k * stride];
          const x = real[b] * c - imaginary[b] * s;
          const y = real[b] * s + imaginary[b] * c;
          real[b] = real[a] - x;
          imaginary[b] = imaginary[a] - y;
          real[a] += x;
          imaginary[a] += y;
        }
      }
    }
  }
}
