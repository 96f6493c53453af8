// Plays what the server says and tells it where the sound is, so that the face follows the loudspeaker.

const REPORT_EVERY_MS = 100;
const START_IN_S = 0.03;

export class Sound {
  // report({ utterance, position, rate }): position in s of what is heard now.
  constructor(report) {
    this.report = report;
    this.on = false; // switched on, even while it stands still
    this.held = false;
    this.playing = new Map();
    this.queue = Promise.resolve();
    this.telling = setInterval(() => this.tell(), REPORT_EVERY_MS);
  }

  close() {
    clearInterval(this.telling);
    this.stop(null);
    this.context?.close();
    this.context = null;
  }

  // Browsers let a page sound only after a click or a key. Resolves to whether it may.
  async enable() {
    try {
      this.open();
      const patience = new Promise((resolve) => setTimeout(resolve, 800));
      await Promise.race([this.context.resume(), patience]);
    } catch {
      return false;
    }
    this.on = this.context.state === "running";
    await this.hold(this.held);
    return this.on;
  }

  // The way to the loudspeaker, which others may listen at.
  open() {
    if (this.context) return;
    this.context = new AudioContext({ latencyHint: "interactive" });
    this.output = new GainNode(this.context);
    this.output.connect(this.context.destination);
  }

  disable() {
    this.on = false;
    for (const { source } of this.playing.values()) source?.disconnect();
    this.stop(null);
    return this.context?.suspend();
  }

  // Stand still where it is, or go on.
  hold(wanted) {
    this.held = wanted;
    if (this.on) return wanted ? this.context.suspend() : this.context.resume();
  }

  // Sounds play one behind the other, in the order in which they came.
  play(utterance, url) {
    const sound = { cancelled: false };
    this.playing.set(utterance, sound);
    const data = fetch(url).then((answer) => {
      if (!answer.ok) throw new Error(`${answer.status}`);
      return answer.arrayBuffer();
    });
    data.catch(() => {}); // told below, in its turn
    const over = () => this.playing.get(utterance) === sound && this.playing.delete(utterance);
    this.queue = this.queue.then(() => this.start(sound, data)).then(over, over);
  }

  async start(sound, data) {
    const buffer = await this.context.decodeAudioData(await data);
    if (sound.cancelled) return;
    const source = new AudioBufferSourceNode(this.context, { buffer });
    const gain = new GainNode(this.context);
    source.connect(gain).connect(this.output);
    const starts = this.context.currentTime + START_IN_S;
    const over = new Promise((resolve) => (source.onended = sound.end = resolve));
    source.start(starts);
    Object.assign(sound, { source, gain, starts, duration: buffer.duration });
    this.tell();
    await over;
  }

  // Cancel one utterance, or all (null): a short fade, for a cut clicks. Nobody waits for it: where the context stands
  // still, no sound ends.
  stop(utterance) {
    for (const [number, sound] of this.playing) {
      if (utterance !== null && number !== utterance) continue;
      this.playing.delete(number);
      sound.cancelled = true;
      if (!sound.source) continue;
      sound.gain.gain.setTargetAtTime(0, this.context.currentTime, 0.02);
      sound.source.stop(this.context.currentTime + 0.12);
      sound.end();
    }
  }

  tell() {
    if (this.held || this.context?.state !== "running") return;
    for (const [utterance, { source, starts, duration }] of this.playing) {
      if (source) this.report({ utterance, position: Math.min(this.heard() - starts, duration), rate: 1 });
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

// Plays pieces of sound one behind the other, each so long after it was pushed that a face has seen to its lips.
export class SoundStream {
  push(samples, rate, delay) {
    this.context ??= new AudioContext({ latencyHint: "interactive" });
    const buffer = new AudioBuffer({ length: samples.length, sampleRate: rate, numberOfChannels: 1 });
    buffer.copyToChannel(Float32Array.from(samples, (sample) => sample / 32768), 0);
    const source = new AudioBufferSourceNode(this.context, { buffer });
    source.connect(this.context.destination);
    const starts = Math.max(this.next ?? 0, this.context.currentTime + delay);
    source.start(starts);
    this.next = starts + buffer.duration;
  }

  stop() {
    this.context?.close();
    this.context = this.next = null;
  }
}
