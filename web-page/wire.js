// Messages of the WebSocket (fapengine/live/web/messages.py says what they mean).

const FRAME_KIND = 1;
const FRAME_BYTES = 16 + 4 * 68;

// A binary message: { number, time, faps }, or null if it is of a kind that this page does not know.
export function parseFrame(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < FRAME_BYTES || view.getUint32(0, true) !== FRAME_KIND) return null;
  return { number: view.getUint32(4, true), time: view.getFloat64(8, true), faps: new Int32Array(buffer, 16, 68) };
}
