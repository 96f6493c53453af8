// Messages of the WebSocket (fapengine/server/web/messages.py says what they mean).

const FRAME_KIND = 1;
const SOUND_KIND = 2;
const FRAME_BYTES = 16 + 4 * 68;

// A binary message: { number, time, faps }, or null if it is of a kind that this page does not know.
export function parseFrame(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < FRAME_BYTES || view.getUint32(0, true) !== FRAME_KIND) return null;
  return { number: view.getUint32(4, true), time: view.getFloat64(8, true), faps: new Int32Array(buffer, 16, 68) };
}

// A binary message of sound: samples are int16, little-endian, as every browser's machine has them.
export function packSound(rate, samples) {
  const bytes = new Uint8Array(8 + samples.byteLength);
  const view = new DataView(bytes.buffer);
  view.setUint32(0, SOUND_KIND, true);
  view.setUint32(4, rate, true);
  bytes.set(new Uint8Array(samples.buffer, samples.byteOffset, samples.byteLength), 8);
  return bytes;
}
