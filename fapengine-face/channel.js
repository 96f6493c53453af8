// Frames of FAPs from anywhere: a WebRTC data channel, a LiveKit room, a socket of one's own.

import { FadeOut, JitterBuffer, sampleFaded } from "./time.js";
import { parseFrame } from "./wire.js";

export class Channel {
  constructor(rate = 60) {
    this.jitterBuffer = new JitterBuffer(rate);
    this.fadeOut = new FadeOut();
  }

  // Takes one frame, 288 bytes (wire.js), as an ArrayBuffer or a view of one. Returns whether it was one.
  push(data) {
    const bytes = ArrayBuffer.isView(data) ? data.buffer.slice(data.byteOffset, data.byteOffset + data.byteLength) : data;
    const frame = bytes instanceof ArrayBuffer ? parseFrame(bytes) : null;
    if (frame) this.jitterBuffer.push(frame, performance.now() / 1000);
    return frame !== null;
  }

  // Takes the frames of whatever tells "message" events with binary data: an RTCDataChannel, a WebSocket.
  listen(target) {
    this.close();
    target.binaryType = "arraybuffer";
    this.end = new AbortController();
    target.addEventListener("message", ({ data }) => this.push(data), { signal: this.end.signal });
  }

  close() {
    this.end?.abort();
  }

  get isSpeaking() {
    return true; // nobody says when it is not
  }

  sample(now, faps) {
    return sampleFaded(this.jitterBuffer, this.fadeOut, now, faps);
  }
}
