// A speaker's tables: what phones of any label are to the planner. fapengine/trajectory/context.py and targets.py, _Labels.

import { context, fap, ipa, phone_track } from "./constants.js";
import { readTables } from "./tables.js";

const { AROUND, IN_NAME, LABELS, LENGTHS, NAMES, REACH, UNLIKE_LENGTHS, UNLIKE_WAYS } = context;
const { CEDILLA, LENGTH, REPLACED, STRESS, TIES } = ipa;
const { SILENCE, STAND_IN } = phone_track;
const MARK = new RegExp(`[${Object.keys(STRESS).join("")}${TIES}${LENGTH}]|\\p{Mn}|\\p{Lm}|\\p{Sk}|\\p{Cf}`, "u");

// Letters of a label; none if one of them is not IPA, a key of letters.
export function lettersOf(label, letters) {
  const found = [];
  for (const letter of label.normalize("NFD")) {
    if (letter === CEDILLA && found.at(-1) === "c") found[found.length - 1] = "ç";
    if (MARK.test(letter)) continue;
    for (const known of REPLACED[letter] ?? letter) {
      if (!Object.hasOwn(letters, known)) return [];
      found.push(known);
    }
  }
  return found;
}

// Stress marks of a phone's label as its stress: split_stress of fapengine/speech/ipa.py.
export function marked(phone) {
  const marks = [...phone.label].filter((letter) => Object.hasOwn(STRESS, letter));
  if (!marks.length || marks.length === [...phone.label].length) return phone;
  return { ...phone, label: [...phone.label].filter((letter) => !Object.hasOwn(STRESS, letter)).join(""), stress: STRESS[marks[0]] };
}

export class Profile {
  // buffer: the package's assets/planner.bin.
  constructor(buffer) {
    const { arrays, ...about } = readTables(buffer);
    Object.assign(this, { ...about, ...arrays });
    this.places = new Map(about.features.map((name, row) => [name, row]));
    this.size = this.coefficients.length / about.features.length; // numbers of a token: modes at each fraction
    this.modeCount = this.size / about.fractions.length;
    this.width = this.modeCount + this.layer.length / fap.FAP_COUNT; // of a path: modes, then the axes of the phonetic layer
    this.kinds = new Map();
    this.pairs = new Map();
    this.labels = new Map();
    this.silence = this.kind([]);
    this.lengthsBeside = LENGTHS.map((step) => this.sum([[`length ${step}`, 1]]));
  }

  // What features add, by name and value; features that were never learned add nothing.
  sum(named) {
    const { coefficients, places, size } = this;
    const total = new Float64Array(size);
    for (const [name, value] of named) {
      const row = places.get(name);
      if (row === undefined) continue;
      for (let index = 0; index < size; ++index) total[index] += value * coefficients[row * size + index];
    }
    return total;
  }

  ways(letter) {
    return Object.entries(letter === SILENCE ? this.silent : this.letters[letter].ways);
  }

  // A token's letters as the model knows them; no letters are silence. vowels: those of the name of a letter, if it is in one.
  kind(heard, vowels = []) {
    const plain = heard.join("") || SILENCE;
    const named = vowels.includes(plain) ? IN_NAME + plain : plain;
    const name = this.places.has(`phone ${named}`) ? named : plain;
    if (!this.kinds.has(name)) this.kinds.set(name, this.newKind(name, heard.length ? heard : [SILENCE]));
    return this.kinds.get(name);
  }

  newKind(name, letters) {
    const [first, last] = [letters[0], letters.at(-1)];
    const own = [["bias", 1], [`phone ${name}`, 1], ...this.ways(first).map(([way, value]) => [`way 0 ${way}`, value])];
    const beside = (step, letter) => [...this.ways(letter).map(([way, value]) => [`way ${step} ${way}`, value]), [`letter ${step} ${letter}`, 1]];
    const byStep = [];
    for (let step = -REACH; step <= REACH; ++step) byStep.push(this.sum(step ? beside(step, step < 0 ? last : first) : own));
    return {
      name, first, last, byStep,
      unlike: this.unlikeByStep(first, last),
      byLength: this.sum([["length 0", 1], [`phone ${name} length`, 1]]),
      isSilent: name === SILENCE,
      isIdle: name !== SILENCE && letters.every((letter) => context.GESTURELESS.includes(letter)),
    };
  }

  // How unlike letters of a token are to those of each example, as the neighbour at each step and as the token itself.
  unlikeByStep(first, last) {
    const apart = (letter, other) => {
      const [ours, theirs] = [letter, other].map((one) => Object.fromEntries(this.ways(one)));
      return Object.keys({ ...ours, ...theirs }).reduce((sum, way) => sum + ((ours[way] ?? 0) - (theirs[way] ?? 0)) ** 2, 0);
    };
    const found = [];
    for (let step = -REACH; step <= REACH; ++step) found.push(new Float64Array(this.exampleLetters.length));
    UNLIKE_WAYS.forEach((weight, place) => {
      const letter = place < REACH || place === REACH + 1 ? last : first;
      const known = new Map();
      this.exampleLetters.forEach((letters, example) => {
        const other = letters[place];
        if (!known.has(other)) known.set(other, weight * apart(letter, other));
        found[place > REACH ? place - 1 : place][example] += known.get(other);
      });
    });
    return found;
  }

  // Add what examples say to a token's sums. kinds: around it, from step -REACH on; lengths: of the one before, itself, the next.
  addExamples(total, kinds, lengths) {
    const { exampleAdds, exampleLengths, exampleLetters, size } = this;
    for (let example = 0; example < exampleLetters.length; ++example) {
      let unlike = 0;
      for (let step = 0; step < kinds.length; ++step) unlike += kinds[step].unlike[step][example];
      for (let index = 0; index < lengths.length; ++index) {
        unlike += UNLIKE_LENGTHS[index] * (lengths[index] - exampleLengths[lengths.length * example + index]) ** 2;
      }
      const like = Math.exp(-unlike);
      for (let index = 0; index < size; ++index) total[index] += like * exampleAdds[example * size + index];
    }
  }

  // What two kinds beside each other add: to the second, and to the first.
  pair(one, other) {
    const key = `${one.name} ${other.name}`;
    if (!this.pairs.has(key)) {
      const beside = (step, mine, mineName, its, itsName) => {
        const named = [[`pair ${step} ${itsName} ${mineName}`, 1]];
        for (const [way, value] of this.ways(mine)) {
          for (const [itsWay, itsValue] of this.ways(its)) named.push([`cross ${step} ${way} ${itsWay}`, value * itsValue]);
        }
        return this.sum(named);
      };
      this.pairs.set(key, [beside(-1, other.first, other.name, one.last, one.name), beside(1, one.last, one.name, other.first, other.name)]);
    }
    return this.pairs.get(key);
  }

  lettersOf(label) {
    return lettersOf(label, this.letters);
  }

  // A phone's label without its time: kinds of its parts, rows of its letters in the table of articulation, contact.
  spelled({ label, word = "" }) {
    const name = stripped(word).toLowerCase();
    const vowels = Object.hasOwn(NAMES, name) ? NAMES[name] : [];
    const key = `${label} ${vowels}`;
    let found = this.labels.get(key);
    if (!found) {
      const known = this.lettersOf(label);
      const letters = known.length ? known : [STAND_IN];
      const whole = letters.join("");
      const isWhole = Object.hasOwn(this.whole, whole);
      found = {
        kinds: (isWhole ? [letters] : letters.map((letter) => [letter])).map((heard) => this.kind(heard, vowels)),
        rows: letters.map((letter) => this.rows[letter]),
        contact: isWhole ? this.whole[whole] : this.contactOf(letters),
        isUnknown: !known.length,
      };
      if (this.labels.size >= LABELS) this.labels.clear();
      this.labels.set(key, found);
    }
    return found;
  }

  contactOf(letters) {
    const touch = letters.map((letter) => this.letters[letter].contact).find((contact) => contact !== "none");
    if (touch) return touch;
    if (letters.some((letter) => this.letters[letter].opens)) return "open";
    if (letters.some((letter) => this.letters[letter].glides)) return "glide";
    return letters.some((letter) => this.sibilants.includes(letter)) ? "jaw" : "none";
  }
}

function stripped(word) {
  let [first, stop] = [0, word.length];
  while (first < stop && AROUND.includes(word[first])) ++first;
  while (stop > first && AROUND.includes(word[stop - 1])) --stop;
  return word.slice(first, stop);
}
