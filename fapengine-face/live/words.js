// Words to phones with times: fapengine/voices/pronounce.py without its voice, and words of which no time is known.

import { host_words, pronounce } from "./constants.js";
import { lettersOf } from "./profile.js";

const { CONSONANTS_YIELD, KIND_OF, MAX_WORDS, USUAL_S, USUAL_SHARE, WORDS_OVERLAP_S } = pronounce;
const { MIN_PHONE_S: MIN_WORD_S } = host_words;
const HUM = /^(h?)m+$/i;
const SPOKEN = /[\p{L}\p{N}]/u;
const READ = /[\p{L}\p{N}%€$£¥₹&@+=°]/u; // what a language may have words for
// Where no time is known: length of a phone against the usual one, and pauses after signs, s; means of espeak-ng's en-us
// at 175 words a minute.
const SLOWER = 1.2;
const PAUSES = [[/[.!?…]["'”’)\]]*$/u, 0.35], [/[;:]["'”’)\]]*$/u, 0.26], [/[,—–]["'”’)\]]*$/u, 0.18]];

// Kinds of the sounds in a label, keys of USUAL_S; what is not IPA counts as a vowel.
export function kinds(label) {
  const found = [];
  const letters = lettersOf(label, KIND_OF);
  for (const letter of letters.length ? letters : ["ə"]) {
    const kind = KIND_OF[letter];
    const before = found.at(-1);
    if (kind === "vowel" && before?.endsWith("vowel")) found[found.length - 1] = "long vowel";
    else if (kind === "vowel") found.push(label.includes("ː") ? "long vowel" : "vowel");
    else if (kind === "fricative" && before === "stop") found[found.length - 1] = "affricate";
    else found.push(kind);
  }
  return found;
}

const usual = (label) => kinds(label).reduce((total, kind) => total + USUAL_S[kind], 0);
export const isVowel = (label) => KIND_OF[lettersOf(label, KIND_OF)[0]] === "vowel";
const drawn = ({ label, length = usual(label) }) => length ** (1 - USUAL_SHARE) * usual(label) ** USUAL_SHARE;
const sum = (lengths) => lengths.reduce((total, length) => total + length, 0);

// Stretches or presses lengths until their sum is total, those of vowels more.
export function stretched(lengths, vowels, total) {
  if (!lengths.length) return [];
  const scaled = (by) => lengths.map((length, index) => length * Math.exp(by * (vowels[index] ? 1 : CONSONANTS_YIELD)));
  let [low, high] = [-200, 200];
  for (let turn = 0; turn < 60; ++turn) {
    const middle = (low + high) / 2;
    [low, high] = sum(scaled(middle)) > total ? [low, middle] : [middle, high];
  }
  const filled = scaled(low);
  const whole = sum(filled);
  return filled.map((length) => (length * total) / whole);
}

// Fills the time of a word with phones: parts, { label, length? }, of which the voice's lengths may be known.
export function fitted(parts, { text, start, end }) {
  const lengths = stretched(parts.map(drawn), parts.map(({ label }) => isVowel(label)), end - start);
  const phones = [];
  let now = start;
  lengths.forEach((length, index) => {
    const until = index + 1 === parts.length ? end : Math.min(now + length, end);
    if (until > now) phones.push({ label: parts[index].label, start: now, end: until, word: text });
    now = Math.max(now, until);
  });
  return phones;
}

// Words in order, { text, start, end? }; an end that is not known is the next start, or as long as it takes to say: as
// WordQueue.add of fapengine/host/words.py.
function timesOf(words) {
  const timed = [];
  let now = 0;
  words.forEach(({ text, start, end }, index) => {
    const from = Math.max(start, now);
    const following = words[index + 1]?.start;
    const said = 0.08 * Math.max(text.length, 2);
    const until = end ?? (following === undefined ? from + said : Math.min(from + 2 * said, following));
    if (until - from < MIN_WORD_S) return;
    timed.push({ text, start: from, end: until });
    now = until;
  });
  return timed;
}

// Words that are spoken together: there is no pause between them, and they are not too many.
function groupsOf(words, pauses) {
  const groups = [];
  words.forEach((word, index) => {
    const last = groups.at(-1);
    if (last && last.length < MAX_WORDS && !pauses[index - 1]) last.push(word);
    else groups.push([word]);
  });
  return groups;
}

function partsOf(spoken) {
  const labels = typeof spoken === "string" ? spoken.trim().split(/\s+/) : (spoken ?? []);
  if (!Array.isArray(labels) || labels.some((label) => label && typeof label !== "string")) throw new TypeError(`pronounce: got ${JSON.stringify(spoken)}, expected phones, a list or a text with spaces between them`);
  return labels.filter(Boolean).map((label) => ({ label }));
}

async function pronounced(texts, voice) {
  const hums = texts.map((text) => HUM.exec(text.replace(/[^\p{L}\p{N}]/gu, "")));
  const others = texts.filter((text, index) => !hums[index] && READ.test(text));
  const spoken = others.length ? await voice.pronounce(others) : [];
  let next = 0;
  return texts.map((text, index) => {
    if (hums[index]) return [...(hums[index][1] ? [{ label: "h" }] : []), { label: "m", length: 3 * USUAL_S.nasal }];
    return READ.test(text) ? partsOf(spoken[next++]) : [];
  });
}

// Phones of a text, or of words with times. voice: its pronounce gives the phones of words that follow each other, a list
// or a text with spaces for each; its continues tells whether a word's point is an abbreviation's. Returns phones, the
// words with their times, the words that have no phones, and where what follows a text begins.
export async function phonesOf(said, voice) {
  const isText = typeof said === "string";
  const words = isText ? said.trim().split(/\s+/).filter(Boolean).map((text) => ({ text })) : timesOf(said);
  const pauses = words.map(({ text }, index) => {
    const next = words[index + 1];
    if (!isText) return next && next.start - words[index].end > WORDS_OVERLAP_S;
    return voice.continues?.(text, next?.text) ? 0 : (PAUSES.find(([sign]) => sign.test(text))?.[1] ?? 0);
  });
  const spoken = await Promise.all(groupsOf(words, pauses).map((group) => pronounced(group.map(({ text }) => text), voice)));
  const parts = spoken.flat();
  const [phones, timed, unread] = [[], [], []];
  let now = 0;
  words.forEach((word, index) => {
    const length = SLOWER * sum(parts[index].map(drawn));
    const placed = isText ? { text: word.text, start: now, end: now + length } : word;
    if (parts[index].length) phones.push(...fitted(parts[index], placed));
    else if (SPOKEN.test(word.text)) unread.push(word.text);
    timed.push(placed);
    now = placed.end + (isText ? pauses[index] : 0);
  });
  return { phones, words: timed, unread, end: now };
}
