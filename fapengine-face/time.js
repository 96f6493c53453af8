// The server's clock, the jitter buffer of its frames, the pixel budget and the fade to rest.

const PINGS = 16;
const ARRIVALS = 120;
const MAX_DELAY_S = 0.12;
const HISTORY = 64;
const SILENCE_S = 0.3;
const FADE_S = 0.25;

// The server's clock as the page knows it: of the last pings, the one that came back fastest tells best.
export class ServerClock {
  constructor() {
    this.pings = [];
  }

  // When a ping was sent and its answer came, by the page's clock; what the server's clock said; seconds.
  add(sent, server, received) {
    this.pings.push({ trip: received - sent, offset: server - (sent + received) / 2 });
    if (this.pings.length > PINGS) this.pings.shift();
    this.best = this.pings.reduce((best, ping) => (ping.trip < best.trip ? ping : best));
  }

  get known() {
    return this.pings.length > 0;
  }

  at(local) {
    return local + (this.best ? this.best.offset : 0);
  }
}

// The jitter buffer: frames come unevenly and are shown evenly, each as long after its own time as the slower ones need to arrive.
export class JitterBuffer {
  constructor(rate) {
    this.interval = 1 / rate;
    this.reset();
  }

  reset() {
    this.frames = [];
    this.lags = [];
    this.delay = null;
    this.lost = 0;
  }

  // frame: { number, time, faps }; arrival by the page's clock, s.
  push(frame, arrival) {
    const newest = this.frames.at(-1);
    if (newest && (frame.time <= newest.time || frame.time > newest.time + 5)) this.reset(); // another server, or long asleep
    else if (newest) this.lost += Math.max(0, frame.number - newest.number - 1);
    this.arrived = arrival;
    this.frames.push(frame);
    this.lags.push(arrival - frame.time);
    if (this.frames.length > HISTORY) this.frames.shift();
    if (this.lags.length > ARRIVALS) this.lags.shift();
  }

  // Values on the screen now, by the page's clock: { faps: 68 numbers, time: of the server }, or null before any frame.
  sample(now, faps = new Float32Array(68)) {
    const { frames } = this;
    if (!frames.length) return null;
    const wanted = this.playoutDelay();
    this.delay = this.delay === null ? wanted : this.delay + (wanted - this.delay) * 0.02; // slewed, never jumping
    const time = Math.min(now - this.delay, frames.at(-1).time);
    let later = frames.length - 1;
    while (later > 0 && frames[later - 1].time > time) --later;
    const b = frames[later];
    const a = later > 0 ? frames[later - 1] : b;
    const share = b === a ? 1 : Math.min(Math.max((time - a.time) / (b.time - a.time), 0), 1);
    for (let column = 0; column < 68; ++column) faps[column] = a.faps[column] + (b.faps[column] - a.faps[column]) * share;
    return { faps, time: a.time + (b.time - a.time) * share };
  }

  // From a frame's time by the server's clock to the screen by the page's: by then 19 of 20 have arrived.
  playoutDelay() {
    const sorted = Float64Array.from(this.lags).sort();
    const fastest = sorted[0];
    const slow = sorted[Math.floor(0.95 * (sorted.length - 1))];
    return fastest + Math.min(slow - fastest + 0.5 * this.interval, MAX_DELAY_S);
  }
}

const SLOW_S = 1 / 45;
const QUICK_S = 1 / 55;
const VERY_SLOW_S = 0.1;
const FIRST_PICTURES = 5; // among these one very slow picture counts, later it takes two in a row
const LEAST_SCALE = 0.4;

// Holds the frame rate of the screen by drawing less. A graphics card gives up its fine edges first, for good; then both
// it and a CPU give up pixels, and ask for them again after a long quiet time. A picture that takes longer than 0.1 s is
// answered at once, with half the pixels of each side. A card that is no quicker for three falls is not what takes the
// time: the screen is slow, or somebody else is busy. It then has everything back, for good.
export class PixelBudget {
  // fine: whether there are fine edges to give up, as where a card draws.
  constructor(fine = false) {
    this.fine = fine;
    this.hasCard = fine;
    this.scale = 1;
    this.slow = 0;
    this.verySlow = 0;
    this.quick = 0;
    this.patience = 180;
    this.falls = 0;
    this.pictures = 0;
    this.mean = 0;
  }

  // How long a picture held the screen up, s: only while it was to be seen. Returns whether there is something else to draw.
  add(interval) {
    if (this.settled) return false;
    this.pictures += 1;
    this.mean += (interval - this.mean) / (this.mean ? 10 : 1);
    this.slow = interval > SLOW_S ? this.slow + 1 : Math.max(0, this.slow - 1);
    this.verySlow = interval > VERY_SLOW_S ? this.verySlow + 1 : 0;
    this.quick = interval < QUICK_S ? this.quick + 1 : 0;
    if (this.verySlow >= (this.pictures <= FIRST_PICTURES ? 1 : 2)) return this.fall(0.5);
    if (this.slow >= 20) return this.fall(this.fine ? 1 : 0.8);
    return this.quick >= this.patience && this.rise();
  }

  fall(share) {
    this.slow = this.verySlow = this.quick = 0;
    if (this.falls === 0) this.before = this.mean;
    if (this.hasCard && this.falls === 3 && this.mean > 0.9 * this.before) {
      this.fine = this.settled = true;
      this.scale = 1;
      return true;
    }
    if (this.scale <= LEAST_SCALE) return false;
    this.falls += 1;
    this.patience = Math.min(this.patience * 2, 3600);
    this.fine = false;
    this.scale = Math.max(LEAST_SCALE, this.scale * share);
    return true;
  }

  rise() {
    this.slow = this.quick = this.falls = 0;
    if (this.scale === 1) return false;
    this.scale = Math.min(1, this.scale / 0.9);
    return true;
  }
}

// How much of the frames to show, 0..1: a face whose server is silent comes to rest, and comes back softly.
export class FadeOut {
  constructor() {
    this.value = 0;
    this.last = null;
  }

  // now, and for how long no frame came, s.
  at(now, silence) {
    const step = this.last === null ? 0 : Math.max(0, now - this.last) / FADE_S;
    this.last = now;
    this.value = silence < SILENCE_S ? Math.min(1, this.value + step) : Math.max(0, this.value - step);
    return this.value * this.value * (3 - 2 * this.value);
  }
}

// What a jitter buffer shows at a time of the page, s, faded where nothing came for a while; null before any frame.
export function sampleFaded(jitterBuffer, fadeOut, now, faps) {
  const shown = jitterBuffer.sample(now, faps);
  const share = fadeOut.at(now, shown ? now - jitterBuffer.arrived : Infinity);
  if (share < 1) for (let column = 0; column < 68; ++column) faps[column] *= share;
  return shown;
}
