// Phones of English words, in IPA: a small network for their letters and a dictionary of the words that it gets wrong, with
// numbers, abbreviations, weak forms and words that are read in two ways. Live fetches it when it is to say words.

import { bytesOf } from "../live/bytes.js";
import { isVowel } from "../live/words.js";
import { Letters } from "./letters.js";
import { clock, decade, inWords, ordinal } from "./numbers.js";
import { spokenForms } from "./spoken.js";
import { SPOKEN } from "./table.js";

// Spelled out, because that is how bundlers find it.
const TABLE = new URL("../assets/words-en.bin", import.meta.url);
const STARTERS = new RegExp(`^(?:${SPOKEN.starters})\\b`);
const ABBREVIATION = /^(?:St|Ave|Rd|No|pp|[Ff]igs?|vol|Mrs|Jr|Sr|e\.g|(?:[A-Za-z]\.)*[A-Za-z])\.$/;
const SIGNS = { "-": "minus", "−": "minus", "%": "percent", "&": "and", "@": "at", "+": "plus", "=": "equals", "°": "degrees", $: "dollars", "£": "pounds", "€": "euros", "¥": "yen", "₹": "rupees" };
const PLAIN = { ß: "ss", æ: "ae", œ: "oe", ø: "o", ł: "l", đ: "d", ð: "th", þ: "th" };
const INITIALS = /^[^\p{L}\p{N}]*((?:\p{L}\.)+\p{L}?)[^\p{L}\p{N}]*$/u;
const LONGEST = 60; // letters of a word that are read
const WRITTEN = 400; // characters between two spaces that are read
const HALF_OF_DAY = /^ ?[ap]\.?m\b/i;
const TOKEN = /(\d\d?):(\d\d)(?!\d)|(\d*)([¼½¾⅓⅔⅛])|(?<!\d)([2-9]0)s(?!\p{L})|(\d+(?:,\d{3}(?!\d))*(?:\.\d+)?)(?:(st|nd|rd|th)(?!\p{L}))?|([\p{L}\p{Mn}'’]+)|([%&@+=°$£€¥₹]|(?<![\p{L}\p{N}])[-−](?=\d))|(\.)(?=[\p{L}])/giu;
const SPELLED = new Set("AI API CEO EU FAQ ID IO IP IT OS UI UK UN URL US USA USB".split(" ")); // of capitals that could be read
// Before another word of the same phrase; the second, if there is one, before a vowel.
const WEAK = {
  a: ["ə"], an: ["ə n"], the: ["ð ə", "ð i"], to: ["t ə", "t ʊ"], of: ["ə v"], and: ["ə n d"], for: ["f ɚ"], from: ["f ɹ ə m"],
  at: ["ə t"], as: ["ə z"], but: ["b ə t"], or: ["ɚ"], than: ["ð ə n"], them: ["ð ə m"], us: ["ə s"], some: ["s ə m"], can: ["k ə n"],
  was: ["w ə z"], were: ["w ɚ"], are: ["ɚ"], am: ["ə m"], have: ["h ə v"], has: ["h ə z"], had: ["h ə d"], does: ["d ə z"],
  could: ["k ə d"], should: ["ʃ ə d"], would: ["w ə d"], must: ["m ə s t"], shall: ["ʃ ə l"], her: ["h ɚ"], your: ["j ɚ"], there: ["ð ɚ"],
};
// Words that are read in two ways: as here, or, after a word of BEFORE_VERB, as verbs.
const BEFORE_VERB = new Set("to i you we they will would can could should must may might shall don't didn't doesn't won't can't let's please who cannot i'll you'll we'll they'll".split(" "));
const TWO_WAYS = {
  read: ["ɹ ɛ d", "ɹ i d"], lead: ["l i d"], live: ["l aɪ v", "l ɪ v"], close: ["k l oʊ s", "k l oʊ z"], use: ["j u s", "j u z"],
  wind: ["w ɪ n d", "w aɪ n d"], tears: ["t ɪ ɹ z", "t ɛ ɹ z"], house: ["h aʊ s", "h aʊ z"],
  excuse: ["ɪ k s k j ˈu s", "ɪ k s k j ˈu z"], abuse: ["ə b j u s", "ə b j u z"], bow: ["b oʊ", "b aʊ"], lives: ["l aɪ v z", "l ɪ v z"],
  record: ["ɹ ˈɛ k ɚ d", "ɹ ɪ k ˈɔ ɹ d"], present: ["p ɹ ˈɛ z ə n t", "p ɹ ɪ z ˈɛ n t"], project: ["p ɹ ˈɑ dʒ ɛ k t", "p ɹ ə dʒ ˈɛ k t"],
  object: ["ˈɑ b dʒ ɛ k t", "ə b dʒ ˈɛ k t"], content: ["k ˈɑ n t ɛ n t", "k ə n t ˈɛ n t"], permit: ["p ˈɝ m ɪ t", "p ɚ m ˈɪ t"],
  produce: ["p ɹ ˈoʊ d u s", "p ɹ ə d ˈu s"], separate: ["s ˈɛ p ɚ ə t", "s ˈɛ p ɚ eɪ t"], estimate: ["ˈɛ s t ə m ə t", "ˈɛ s t ə m eɪ t"],
  desert: ["d ˈɛ z ɚ t", "d ɪ z ˈɝ t"],
};
const AT_FIRST = new Set(["read", "close", "use", "excuse"]); // a phrase that begins with it asks to do so

export class English {
  // assets: address of words-en.bin elsewhere.
  static async make({ assets = {} } = {}) {
    return new English(await bytesOf(assets.words ?? TABLE));
  }

  // buffer: the package's assets/words-en.bin.
  constructor(buffer) {
    this.letters = new Letters(buffer);
  }

  // Phones of words that follow each other, without a pause between them: a list for each, null where it is not English.
  pronounce(texts) {
    const forms = spokenForms(texts.map((text) => text.slice(0, WRITTEN)));
    const tokens = forms.flatMap((said, owner) => this.tokens(said, forms[owner - 1], forms[owner + 1]).map((word) => ({ word, owner })));
    const found = texts.map(() => []);
    for (let index = tokens.length - 1, next = null; index >= 0; --index) {
      const { word, owner } = tokens[index];
      const phones = word === null ? null : this.inPhrase(word, tokens[index - 1]?.word, next);
      if (!phones) found[owner] = null;
      else found[owner]?.unshift(...phones);
      next = phones;
    }
    return found.map((phones) => (phones?.length ? phones : null));
  }

  // A point after this word does not end a sentence.
  continues(text, next) {
    return next !== undefined && text.endsWith(".") && !STARTERS.test(next) && (Object.hasOwn(SPOKEN.words, text) || ABBREVIATION.test(text));
  }

  // Words of letters, as they are read; null for what is not in Latin letters. Capitals without a vowel are read one by one.
  tokens(said, before = "", next = "") {
    const words = [];
    let isHour = /\d$/.test(before);
    const initials = INITIALS.exec(said)?.[1].replace(/\./g, "").toUpperCase();
    for (const match of (initials ?? said).matchAll(TOKEN)) {
      const [all, hour, minutes, whole, part, tens, number, ending, letters, sign, point] = match;
      if (hour) {
        const isInHalf = HALF_OF_DAY.test(`${said.slice(match.index + all.length)} ${next}`);
        words.push(...clock(Number(hour), Number(minutes), isInHalf ? "" : "o'clock").split(" "));
      } else if (part) words.push(...`${whole && `${inWords(whole)} and `}${SPOKEN.fractions[part.normalize("NFKD").replace("⁄", "/")]}`.split(" "));
      else if (tens) words.push(...decade(Number(tens)).split(" "));
      else if (initials && letters) words.push(...letters);
      else if (isHour && /^am$/i.test(letters)) words.push("A", "M");
      else if (number) words.push(...(ending && number.length < 16 ? ordinal(Number(number.replace(/,/g, ""))) : inWords(number)).split(" "));
      else if (sign) words.push(SIGNS[sign]);
      else if (point) words.push("dot");
      else words.push(...this.wordOf(letters));
      isHour = Boolean(hour || number);
    }
    return words;
  }

  wordOf(text) {
    const plain = text.toLowerCase().replace(/’/g, "'").normalize("NFD").replace(/\p{Mn}/gu, "").replace(/[^a-z']/g, (letter) => PLAIN[letter] ?? letter);
    const word = plain.replace(/^'+|'+$/g, "");
    if (!word) return [];
    if (!/^[a-z']+$/.test(word)) return [null];
    const isSpelled = SPELLED.has(text) || (word.length > 1 && !/[aeiouy]/.test(word) && !this.letters.stored.has(word));
    if (isSpelled) return [...word.replace(/'/g, "")].map((letter) => letter.toUpperCase());
    return [word.slice(0, LONGEST)];
  }

  stressed(word, phones) {
    return this.letters.stress.mark(word, phones);
  }

  // Phones of a word between the word before and the phones of the next; a capital is the name of a letter.
  inPhrase(word, before, next) {
    if (word === "A" || (word === "a" && before && !next)) return ["eɪ"]; // plan A, Q&A
    const isWeak = next && Object.hasOwn(WEAK, word);
    if (isWeak) {
      const [usual, beforeVowel = usual] = WEAK[word];
      return (isVowel(next[0]) ? beforeVowel : usual).split(" ");
    }
    if (Object.hasOwn(TWO_WAYS, word)) {
      const isVerb = before ? BEFORE_VERB.has(before) : AT_FIRST.has(word) && next;
      const [usual, verb = usual] = TWO_WAYS[word];
      return this.stressed(word, (isVerb ? verb : usual).split(" "));
    }
    return this.stressed(word.toLowerCase(), this.letters.say(word.toLowerCase()));
  }
}
