// Reads a file of tables as design/live_tables.py writes it: the fields of its text, and its arrays by name.

const MAGIC = "FAPLIVE1";
const KINDS = { float16: Uint16Array, float32: Float32Array, float64: Float64Array, int8: Int8Array };

export function readTables(buffer) {
  const text = new TextDecoder();
  if (buffer.byteLength < 12 || text.decode(new Uint8Array(buffer, 0, 8)) !== MAGIC) {
    throw new Error(`fapengine-face/live: got ${buffer.byteLength} bytes that do not begin with ${MAGIC}, expected a file of assets/`);
  }
  const length = new DataView(buffer).getUint32(8, true);
  const { arrays, ...about } = JSON.parse(text.decode(new Uint8Array(buffer, 12, length)));
  const found = {};
  for (const [name, { kind, shape, offset }] of Object.entries(arrays)) {
    const size = shape.reduce((product, side) => product * side, 1);
    const array = new KINDS[kind](buffer.slice(12 + length + offset, 12 + length + offset + size * KINDS[kind].BYTES_PER_ELEMENT));
    found[name] = kind === "float16" ? Float32Array.from(array, half) : array;
  }
  return { ...about, arrays: found };
}

function half(bits) {
  const sign = bits & 0x8000 ? -1 : 1;
  const [exponent, rest] = [(bits >> 10) & 31, (bits & 1023) / 1024];
  return sign * (exponent ? 2 ** (exponent - 15) * (1 + rest) : 2 ** -14 * rest);
}
