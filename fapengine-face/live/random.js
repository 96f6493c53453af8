// Random numbers that depend on a seed, a stream and how many were drawn, and on nothing else, so that another program can
// draw the same: the 32-bit finaliser of MurmurHash3 over a counter. Stateful.

const STEP = 0x9e3779b9;

function mixed(value) {
  let hash = value | 0;
  hash = Math.imul(hash ^ (hash >>> 16), 0x85ebca6b);
  hash = Math.imul(hash ^ (hash >>> 13), 0xc2b2ae35);
  return (hash ^ (hash >>> 16)) >>> 0;
}

export class Random {
  constructor(seed, stream = 0) {
    this.key = mixed(mixed(seed) + Math.imul(stream + 1, STEP));
    this.drawn = 0;
  }

  // From low to high.
  uniform(low = 0, high = 1) {
    this.drawn += 1;
    return low + (high - low) * ((mixed(this.key + Math.imul(this.drawn, STEP)) + 0.5) / 2 ** 32);
  }

  exponential(mean) {
    return -mean * Math.log(this.uniform());
  }

  normal(deviation) {
    return deviation * Math.sqrt(-2 * Math.log(this.uniform())) * Math.cos(2 * Math.PI * this.uniform());
  }

  sign() {
    return this.uniform() < 0.5 ? -1 : 1;
  }
}
