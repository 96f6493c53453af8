// What speech services report about their sound, as phones or words for say: fapengine/speech/formats/services.py.

import { entries, phone_sets, services } from "./constants.js";

const { LAST_S, OVERLAP_S } = entries;
const { AZURE } = phone_sets;
const { TICKS_HZ } = services;

// Viseme events of Azure's SDK, { audioOffset (ticks of 100 ns), visemeId }, to phones; each lasts until the next.
export function azurePhones(events) {
  const wrong = events.find(({ audioOffset, visemeId }) => !Number.isFinite(audioOffset) || AZURE[visemeId] === undefined);
  if (wrong) throw new TypeError(`azurePhones: got ${JSON.stringify(wrong)}, expected { audioOffset, visemeId } with an id of 0 to 21`);
  const starts = events.map(({ audioOffset }) => audioOffset / TICKS_HZ);
  return events
    .map(({ visemeId }, index) => ({ label: AZURE[visemeId], start: starts[index], end: starts[index + 1] ?? starts[index] + LAST_S }))
    .filter(({ label, start, end }) => label && end > start); // 0 is silence
}

// Alignments of ElevenLabs, with times in seconds or in ms, in the order of their chunks, to words.
export function elevenLabsWords(chunks) {
  const characters = [];
  for (const chunk of chunks) {
    const added = charactersOf(chunk);
    const before = characters.at(-1)?.end ?? 0;
    const shift = added.length && added[0].start < before - OVERLAP_S ? before : 0; // it counts from its own beginning
    characters.push(...added.map(({ text, start, end }) => ({ text, start: start + shift, end: end + shift })));
  }
  const words = [];
  let inside = false;
  for (const { text, start, end } of characters) {
    const belongs = /[\p{L}\p{N}]/u.test(text) || (inside && /^['’-]$/.test(text));
    if (belongs && inside) {
      const last = words.at(-1);
      Object.assign(last, { text: last.text + text, end: Math.max(last.end, end) });
    } else if (belongs) words.push({ text, start, end });
    inside = belongs;
  }
  return words;
}

function charactersOf(chunk) {
  const inner = chunk.normalized_alignment ?? chunk.normalizedAlignment ?? chunk.alignment ?? chunk;
  const texts = inner.characters ?? inner.chars ?? []; // the last chunk of a stream has none
  const seconds = inner.character_start_times_seconds ?? inner.characterStartTimesSeconds;
  if (seconds) {
    const ends = inner.character_end_times_seconds ?? inner.characterEndTimesSeconds;
    return texts.map((text, index) => ({ text, start: seconds[index], end: ends[index] }));
  }
  const [starts, lengths] = [inner.charStartTimesMs ?? inner.char_start_times_ms, inner.charDurationsMs ?? inner.char_durations_ms];
  if (texts.length && !(starts && lengths)) throw new TypeError("elevenLabsWords: got characters without times");
  return texts.map((text, index) => ({ text, start: starts[index] / 1000, end: starts[index] / 1000 + lengths[index] / 1000 }));
}

// Messages of Cartesia: phones with their words, or, without phones, words.
export function cartesiaTimings(messages) {
  const rows = (key, texts) =>
    messages.flatMap(({ [key]: found }) => (found ? found[texts].map((text, index) => ({ text, start: found.start[index], end: found.end[index] })) : []));
  const words = rows("word_timestamps", "words");
  const phones = rows("phoneme_timestamps", "phonemes");
  return phones.length ? phones.map(({ text, start, end }) => ({ label: text, start, end, word: wordAt(words, (start + end) / 2) })) : words;
}

const wordAt = (words, time) => words.find(({ start, end }) => start <= time && time < end)?.text;

// Pieces of LiveKit's timed transcription, { text, startTime, endTime } or as its agents in Python name them, to words.
export function liveKitWords(pieces) {
  const words = pieces.map(({ text, startTime, start_time, endTime, end_time }) => ({ text: text.trim(), start: startTime ?? start_time, end: endTime ?? end_time }));
  return words.filter(({ text, start }) => text && Number.isFinite(start));
}
