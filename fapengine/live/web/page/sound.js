// Plays what the server says and tells it where the sound is, so that the face follows the loudspeaker.

const REPORT_EVERY_MS = 100;
const START_IN_S = 0.03;

export class Sound {
  // report({ utterance, position, rate }): position in s of what is heard now.
  constructor(report) {
    this.report = report;
    this.playing = new Map();
    this.queue = Promise.resolve();
    setInterval(() => this.tell(), REPORT_EVERY_MS);
  }

  get on() {
    return Boolean(this.context) && this.context.state === "running";
  }

  // Browsers let a page sound only after a click or a key. Resolves to whether it may.
  async enable() {
    try {
      this.context ??= new AudioContext({ latencyHint: "interactive" });
      const patience = new Promise((resolve) => setTimeout(resolve, 800));
      await Promise.race([this.context.resume(), patience]);
    } catch {
      return false;
    }
    return this.on;
  }

  disable() {
    this.stop(null);
    return this.context?.suspend();
  }

  // Stand still where it is, or go on.
  hold(wanted) {
    if (this.playing.size) return wanted ? this.context.suspend() : this.context.resume();
  }

  // Sounds play one behind the other, in the order in which they came.
  play(utterance, url) {
    const waiting = { cancelled: false };
    this.playing.set(utterance, waiting);
    const data = fetch(url).then((answer) => {
      if (!answer.ok) throw new Error(`${answer.status}`);
      return answer.arrayBuffer();
    });
    data.catch(() => {}); // told below, in its turn
    this.queue = this.queue.then(() => this.start(utterance, data, waiting)).catch(() => this.playing.delete(utterance));
  }

  async start(utterance, data, waiting) {
    const buffer = await this.context.decodeAudioData(await data);
    if (waiting.cancelled || !this.on) {
      this.playing.delete(utterance);
      return;
    }
    const source = new AudioBufferSourceNode(this.context, { buffer });
    const gain = new GainNode(this.context);
    source.connect(gain).connect(this.context.destination);
    const starts = this.context.currentTime + START_IN_S;
    const over = new Promise((resolve) => (source.onended = resolve));
    source.start(starts);
    this.playing.set(utterance, { source, gain, starts, duration: buffer.duration });
    this.tell();
    await over;
    this.playing.delete(utterance);
  }

  // Cancel one utterance, or all (null): a short fade, for a cut clicks.
  stop(utterance) {
    for (const [number, { source, gain, ...waiting }] of this.playing) {
      if (utterance !== null && number !== utterance) continue;
      if (source) {
        gain.gain.setTargetAtTime(0, this.context.currentTime, 0.02);
        source.stop(this.context.currentTime + 0.12);
      } else {
        this.playing.get(number).cancelled = true;
      }
    }
  }

  tell() {
    for (const [utterance, playing] of this.playing) {
      if (playing.source && this.on) {
        const position = Math.min(this.heard() - playing.starts, playing.duration);
        this.report({ utterance, position, rate: 1 });
      }
    }
  }

  // The context's time of what leaves the loudspeaker now.
  heard() {
    const { context } = this;
    const { contextTime, performanceTime } = context.getOutputTimestamp?.() ?? {};
    if (contextTime > 0) {
      const now = contextTime + (performance.now() - performanceTime) / 1000;
      if (Math.abs(now - context.currentTime) < 0.5) return now;
    }
    return context.currentTime - (context.outputLatency || context.baseLatency || 0);
  }
}
