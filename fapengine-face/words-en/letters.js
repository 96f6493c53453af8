// Phones of English words by their letters: a small network, and the words that it gets wrong. bench/words_train.py says
// how both are made.

import { matrixOf, multiply } from "../live/small-net.js";
import { readTables } from "../live/tables.js";
import { Stress } from "./stress.js";

const MAX_KNOWN = 5000;

export class Letters {
  // buffer: the package's assets/words-en.bin.
  constructor(buffer) {
    const { arrays, ...about } = readTables(buffer);
    Object.assign(this, about);
    for (const name of ["letters", "places"]) arrays[`${name}.bias`] = new Float64Array(arrays[`${name}.scale`].length);
    this.vectors = matrixOf(arrays, "letters"); // a column for each letter, 0 is none
    this.split = matrixOf(arrays, "places");
    this.head = matrixOf(arrays, "head");
    this.mixes = Array.from({ length: this.layers }, (_, layer) => matrixOf(arrays, `mix${layer}`));
    this.spelled = arrays.phones;
    this.stress = new Stress(arrays, about.stress);
    this.stored = this.dictionary(arrays.words); // word to where its phones begin
    this.known = new Map(); // what the network has read
  }

  dictionary(bytes) {
    const stored = new Map();
    let [word, from] = ["", 0];
    for (let at = 0; at < bytes.length; ) {
      const end = bytes.indexOf(0, at + 1);
      word = word.slice(0, bytes[at]) + String.fromCharCode(...bytes.subarray(at + 1, end));
      stored.set(word, from);
      from = this.spelled.indexOf(0, from) + 1;
      at = end + 1;
    }
    return stored;
  }

  // Phones of a word of letters of this.alphabet, in IPA.
  say(word) {
    const from = this.stored.get(word);
    if (from !== undefined) return Array.from(this.spelled.subarray(from, this.spelled.indexOf(0, from)), (number) => this.labels[number - 1]);
    if (!this.known.has(word)) {
      if (this.known.size >= MAX_KNOWN) this.known.clear();
      this.known.set(word, this.read(word).map((number) => this.labels[number - 1]));
    }
    return this.known.get(word);
  }

  // Numbers of the phones that the network reads.
  read(word) {
    const { alphabet, channels, places, reach, vectors } = this;
    const product = (matrix, rows) => {
      const out = new Float64Array(count * matrix.outputs);
      multiply(matrix, rows, out, count);
      return out;
    };
    let count = word.length;
    let x = new Float64Array(count * channels);
    [...word].forEach((letter, row) => {
      const column = alphabet.indexOf(letter) + 1;
      for (let channel = 0; channel < channels; ++channel) x[row * channels + channel] = vectors.weights[channel * vectors.inputs + column];
    });
    this.mixes.forEach((mix, layer) => {
      if (layer === this.letterLayers) [x, count] = [product(this.split, x), count * places];
      const added = product(mix, this.around(x, count, channels, reach));
      x = x.map((value, index) => value + Math.max(added[index], 0));
    });
    const scores = product(this.head, x);
    const found = [];
    let before = 0;
    for (let row = 0; row < count; ++row) {
      const these = scores.subarray(row * this.head.outputs, (row + 1) * this.head.outputs);
      const best = these.indexOf(these.reduce((most, score) => Math.max(most, score), -Infinity));
      if (best && best !== before) found.push(best);
      before = best;
    }
    return found;
  }

  // Each row, divided by its root mean square, beside those before and after it.
  around(x, count, channels, reach) {
    const near = new Float64Array(count * (2 * reach + 1) * channels);
    for (let row = 0; row < count; ++row) {
      const own = x.subarray(row * channels, (row + 1) * channels);
      const size = Math.sqrt(own.reduce((total, value) => total + value * value, 0) / channels + 1e-5);
      const normed = own.map((value) => value / size);
      for (let step = -reach; step <= reach; ++step) {
        const to = row - step;
        if (to >= 0 && to < count) near.set(normed, (to * (2 * reach + 1) + reach + step) * channels);
      }
    }
    return near;
  }
}
