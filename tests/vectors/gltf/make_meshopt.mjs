// Writes meshopt.json beside it: made numbers, packed by meshoptimizer's own encoder and unpacked by its decoder.
//   npm install meshoptimizer@1.3.0 && node make_meshopt.mjs > meshopt.json
import { MeshoptEncoder as encoder, MeshoptDecoder as decoder } from "meshoptimizer";

await encoder.ready;
await decoder.ready;
let state = 7;
const random = () => (state = (state * 1103515245 + 12345) & 0x7fffffff) / 0x7fffffff;
const hex = (bytes) => Buffer.from(bytes).toString("hex");
const bytesOf = (array) => new Uint8Array(array.buffer, array.byteOffset, array.byteLength);
const vectors = [];
const add = (mode, count, stride, filter, source) => {
  const packed = encoder.encodeGltfBuffer(source, count, stride, mode, 0);
  const unpacked = new Uint8Array(count * stride);
  decoder.decodeGltfBuffer(unpacked, count, stride, packed, mode, filter);
  vectors.push({ mode, count, stride, filter, packed: hex(packed), unpacked: hex(unpacked) });
};

for (const [count, stride] of [[300, 8], [17, 12], [70, 4]]) {
  const rows = new Uint8Array(count * stride); // bytes that rise, swing, are few, and are the same but for some
  for (let i = 0; i < count; i++)
    for (let j = 0; j < stride; j++)
      rows[i * stride + j] = [i, Math.sin(i / 9) * 40 + j, random() * 6, random() < 0.1 ? random() * 255 : 3][j % 4] & 255;
  add("ATTRIBUTES", count, stride, "NONE", rows);
}
const units = (count, width) => {
  const rows = new Float32Array(count * 4);
  for (let i = 0; i < count; i++) {
    const one = Array.from({ length: width }, () => random() - 0.5);
    rows.set(one.map((value) => value / Math.hypot(...one)), i * 4);
  }
  return rows;
};
for (const [stride, bits] of [[4, 8], [8, 12]])
  add("ATTRIBUTES", 40, stride, "OCTAHEDRAL", encoder.encodeFilterOct(units(40, 3), 40, stride, bits));
add("ATTRIBUTES", 40, 8, "QUATERNION", encoder.encodeFilterQuat(units(40, 4), 40, 8, 12));
const numbers = Float32Array.from({ length: 120 }, (_, i) => (random() - 0.5) * 10 ** ((i % 5) - 2));
add("ATTRIBUTES", 40, 12, "EXPONENTIAL", encoder.encodeFilterExp(numbers, 40, 12, 15));
const corners = [];
for (let y = 0; y < 8; y++)
  for (let x = 0; x < 8; x++) {
    const a = y * 9 + x;
    corners.push(a, a + 1, a + 9, a + 1, a + 10, a + 9);
  }
for (let i = 0; i < 90; i++) corners.push((random() * 81) | 0);
for (const kind of [Uint16Array, Uint32Array]) {
  const size = kind.BYTES_PER_ELEMENT;
  add("TRIANGLES", corners.length, size, "NONE", bytesOf(new kind(corners)));
  add("INDICES", 100, size, "NONE", bytesOf(new kind(corners.slice(0, 100))));
}
console.log(JSON.stringify(vectors));
