// Where a word is stressed, by weights of what is known of its vowels. bench/words_stress.py says how they are made.

import { isVowel } from "../live/words.js";

// Words that have no stress in a phrase: pronouns, auxiliaries, prepositions and conjunctions.
const WITHOUT = new Set(
  `i me my you your he him his she her it its we us our they them their this that these those who which what there a an the some any
  am is are was were be been being isn't wasn't do does did don't have has had will would shall should can could may might must i'm i've
  i'll i'd you're you've you'll you'd he's he'll he'd she's she'll she'd it's it'll we're we've we'll we'd they're they've they'll they'd
  that's there's let's of to in on at by for from with into onto upon up as than about over through per and but or nor so if when while
  because though since until whether not just`.split(/\s+/),
);

export class Stress {
  // arrays, stress: of the package's assets/words-en.bin.
  constructor({ accents, accentWeights }, { reduced, ends, beginnings }) {
    const names = new TextDecoder().decode(accents).split("\n");
    this.weights = new Map(names.map((name, index) => [name, accentWeights[index]]));
    Object.assign(this, { reduced, ends, beginnings });
  }

  // Phones of a word, one of them with a mark of stress if the word has one.
  mark(word, phones) {
    const place = WITHOUT.has(word) || phones.some((label) => label.startsWith("ˈ")) ? -1 : this.place(word, phones);
    return phones.map((label, index) => (index === place ? `ˈ${label}` : label));
  }

  // Place of the stressed phone; -1 without any.
  place(word, phones) {
    const vowels = phones.map((label, index) => (isVowel(label) ? index : -1)).filter((index) => index >= 0);
    let [best, highest] = [-1, -Infinity];
    vowels.forEach((place, number) => {
      if (this.reduced.includes(phones[place])) return;
      const score = this.features(word, phones, vowels, number).reduce((sum, name) => sum + (this.weights.get(name) ?? 0), 0);
      if (score > highest) [best, highest] = [place, score];
    });
    return best;
  }

  features(word, phones, vowels, number) {
    const [count, place] = [vowels.length, vowels[number]];
    const [before, behind] = [vowels[number - 1] ?? -1, vowels[number + 1] ?? phones.length];
    const last = Math.min(count - 1 - number, 3);
    return [
      `${phones[place]}${last}`, `v${phones[place]}${Math.min(number, 1)}`, `#${Math.min(count, 5)}${last}`,
      `s${Math.min(number, 2)}${Math.min(count, 4)}`, `c${Math.min(behind - place - 1, 3)}${last}`, `o${Math.min(place - before - 1, 2)}${last}`,
      ...Array.from({ length: this.ends }, (_, index) => `${word.slice(-1 - index)}$${last}`),
      ...this.beginnings.map((letters) => `^${word.slice(0, letters)}${Math.min(number, 3)}`),
    ];
  }
}
