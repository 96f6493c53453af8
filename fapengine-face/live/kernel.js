// Matrices by WebAssembly's SIMD, four sums in one instruction; where a browser or a content security policy does not allow
// it, in plain JavaScript.

const MEMORY = 0x10000; // bytes that memory grows by
const LANES = 16; // rows that are summed at a time, in four vectors
const [ROW, VECTOR] = [4 * LANES, 16]; // bytes
const [INPUT, OUTPUT, WEIGHTS] = [0, 4096, 8192]; // places in memory

// WebAssembly, https://webassembly.github.io/spec/core/binary/instructions.html
const [LOOP, END, BRANCH_IF, GET, SET, TEE, CONSTANT, ADD, IS_LESS] = [0x03, 0x0b, 0x0d, 0x20, 0x21, 0x22, 0x41, 0x6a, 0x49];
const [I32, V128, NOTHING] = [0x7f, 0x7b, 0x40];
const simd = (number, ...operands) => [0xfd, number, ...operands];
const load = (from, offset) => [GET, from, ...simd(0, 4, offset)];
const repeated = (from) => [GET, from, ...simd(9, 2, 0)];
const store = (to, offset, value) => [GET, to, GET, value, ...simd(11, 4, offset)];
const [TIMES, PLUS] = [simd(0xe6, 1), simd(0xe4, 1)];
const next = (place, bytes) => [GET, place, CONSTANT, (bytes & 127) | 128, bytes >> 7, ADD]; // bytes: less than 8192
const until = (place, bytes, end) => [...next(place, bytes), TEE, place, GET, end, IS_LESS, BRANCH_IF, 0];
const sized = (content) => [(content.length & 127) | 128, content.length >> 7, ...content];
const part = (number, ...content) => [number, ...sized(content)];
const named = (name, ...kind) => [name.length, ...new TextEncoder().encode(name), ...kind];

// multiply(input, weights, out, end of out, end of input): of each 16 rows, weights have the bias, then the columns.
function code() {
  const [input, weights, out, outEnd, inputEnd, place, value, ...sums] = Array(11).keys();
  const body = [
    LOOP, NOTHING,
    ...sums.flatMap((sum, index) => [...load(weights, index * VECTOR), SET, sum]),
    GET, input, SET, place,
    LOOP, NOTHING,
    ...next(weights, ROW), SET, weights,
    ...repeated(place), SET, value,
    ...sums.flatMap((sum, index) => [GET, sum, GET, value, ...load(weights, index * VECTOR), ...TIMES, ...PLUS, SET, sum]),
    ...until(place, 4, inputEnd), END,
    ...next(weights, ROW), SET, weights,
    ...sums.flatMap((sum, index) => store(out, index * VECTOR, sum)),
    ...until(out, ROW, outEnd), END,
    END,
  ];
  const locals = [2, 1, I32, 1 + sums.length, V128];
  return new Uint8Array([
    ...new TextEncoder().encode("\0asm"), 1, 0, 0, 0,
    ...part(1, 1, 0x60, 5, I32, I32, I32, I32, I32, 0), // a function of five numbers
    ...part(3, 1, 0),
    ...part(5, 1, 0, 1), // memory
    ...part(7, 2, ...named("memory", 2, 0), ...named("multiply", 0, 0)),
    ...part(10, 1, ...sized([...locals, ...body])),
  ]);
}

class Kernel {
  constructor() {
    Object.assign(this, new WebAssembly.Instance(new WebAssembly.Module(code())).exports);
    this.used = WEIGHTS;
  }

  // Takes a matrix of small-net.js; returns it as multiply has it.
  place({ weights, bias, inputs, outputs }) {
    const [at, rows] = [this.used, Math.ceil(outputs / LANES) * LANES];
    this.used += rows * (inputs + 1) * 4;
    this.memory.grow(Math.max(Math.ceil((this.used - this.memory.buffer.byteLength) / MEMORY), 0));
    this.numbers = new Float32Array(this.memory.buffer);
    for (let row = 0; row < outputs; ++row) {
      const first = at / 4 + (row - (row % LANES)) * (inputs + 1) + (row % LANES);
      this.numbers[first] = bias[row];
      for (let index = 0; index < inputs; ++index) this.numbers[first + (index + 1) * LANES] = weights[row * inputs + index];
    }
    return { at, rows, inputs, outputs };
  }

  // As multiply of small-net.js.
  run({ at, rows, inputs, outputs }, input, out, steps) {
    const { numbers } = this;
    for (let step = 0; step < steps; ++step) {
      numbers.set(input.subarray(step * inputs, (step + 1) * inputs), INPUT / 4);
      this.multiply(INPUT, at, OUTPUT, OUTPUT + rows * 4, INPUT + inputs * 4);
      out.set(numbers.subarray(OUTPUT / 4, OUTPUT / 4 + outputs), step * outputs);
    }
  }
}

// A kernel; null where WebAssembly may not be used, or has no SIMD.
export function newKernel() {
  try {
    return new Kernel();
  } catch {
    return null;
  }
}
