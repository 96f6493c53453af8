// Reads /head.bin (layout: fapengine/server/web/head_binary.py). Arrays are views of the file, nothing is copied.

const MAGIC = "FAPHEAD1";
const KINDS = { float32: Float32Array, float64: Float64Array, uint32: Uint32Array, uint8: Uint8Array };

export function parseHead(buffer) {
  const text = new TextDecoder();
  if (buffer.byteLength < 12 || text.decode(new Uint8Array(buffer, 0, 8)) !== MAGIC) {
    throw new Error(`head.bin: got ${buffer.byteLength} bytes that do not begin with ${MAGIC}`);
  }
  const length = new DataView(buffer).getUint32(8, true);
  const { arrays, ...head } = JSON.parse(text.decode(new Uint8Array(buffer, 12, length)));
  head.parts = {};
  for (const [name, { kind, shape, offset }] of Object.entries(arrays)) {
    const array = new KINDS[kind](buffer, offset, shape.reduce((product, side) => product * side, 1));
    if (name.startsWith("part.")) head.parts[name.slice(5)] = array;
    else head[name] = { array, shape };
  }
  return head;
}
