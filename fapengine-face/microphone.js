// The microphone of this page to the server, whose ear moves the face: 16 kHz, mono, int16.

const RATE_HZ = 16_000;

export class Microphone {
  // send(rate_hz, samples): takes an Int16Array.
  constructor(send) {
    this.send = send;
    this.on = false;
  }

  // Asks for leave. Resolves to whether sound comes; otherwise says why.
  async enable() {
    if (!navigator.mediaDevices?.getUserMedia) throw new Error("A browser gives its microphone only to https or to this very machine.");
    this.stream = await navigator.mediaDevices.getUserMedia({
      audio: { channelCount: 1, echoCancellation: true, noiseSuppression: true, autoGainControl: true },
    });
    this.context = new AudioContext({ sampleRate: RATE_HZ }); // the browser resamples
    await this.context.audioWorklet.addModule(new URL("./microphone-worklet.js", import.meta.url));
    const pieces = new AudioWorkletNode(this.context, "pieces", { numberOfOutputs: 0 });
    pieces.port.onmessage = ({ data }) => this.on && this.send(RATE_HZ, data);
    new MediaStreamAudioSourceNode(this.context, { mediaStream: this.stream }).connect(pieces);
    this.on = true;
    for (const track of this.stream.getTracks()) track.onended = () => this.disable();
  }

  disable() {
    this.on = false;
    for (const track of this.stream?.getTracks() ?? []) track.stop();
    this.context?.close();
    this.stream = this.context = null;
  }
}

// The sound of a file, mono at 16 kHz: { samples (Int16Array), rate }.
export async function samplesOf(bytes) {
  const decoder = new OfflineAudioContext(1, 1, RATE_HZ); // decodes at its own rate
  const sound = await decoder.decodeAudioData(bytes);
  const mixer = new OfflineAudioContext(1, sound.length, RATE_HZ);
  const source = new AudioBufferSourceNode(mixer, { buffer: sound });
  source.connect(mixer.destination); // mixes its channels
  source.start();
  const mono = (await mixer.startRendering()).getChannelData(0);
  const samples = Int16Array.from(mono, (value) => Math.max(-32768, Math.min(32767, Math.round(32768 * value))));
  return { samples, rate: RATE_HZ };
}
