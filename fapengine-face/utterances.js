// What is being said and what waits: phones, words and texts of a session's utterances, and which of them is the one
// that sounds. Knows neither a server nor a screen.

const KEEP = 32;
const REST_S = 0.6; // an utterance that is over is shown for so long behind its last phone
export const SILENT = "_";

export class Utterances {
  constructor() {
    this.said = new Map();
    this.current = null;
  }

  begin(utterance) {
    if (this.said.has(utterance)) return this.said.get(utterance);
    const made = { utterance, text: "", phones: [], offset: null, isOver: false, hasStarted: false };
    this.said.set(utterance, made);
    while (this.said.size > KEEP) this.forget(this.said.keys().next().value);
    return made;
  }

  // What a voice was given to say; the phones know single words only.
  text(utterance, text) {
    this.begin(utterance).text = text;
  }

  // phones: of each its label, start and end in s, and its word or null.
  phones(utterance, first, phones) {
    const said = this.begin(utterance);
    phones.forEach(([label, start, end, word], place) => (said.phones[first + place] = { label, start, end, word }));
  }

  // Where an utterance is at a time of the server, s.
  position(utterance, position, time) {
    const said = this.said.get(utterance);
    if (!said || position === null) return;
    said.offset = position - time;
    said.hasStarted = true;
    this.current = utterance;
  }

  over(utterance) {
    const said = this.said.get(utterance);
    if (!said) return;
    said.isOver = true;
    if (!said.hasStarted) this.forget(utterance); // the last phones of the others may have to be told yet
  }

  forget(utterance) {
    this.said.delete(utterance);
    if (this.current === utterance) this.current = null;
  }

  clear() {
    this.said.clear();
    this.current = null;
  }

  // What waits for its turn, in order.
  get queue() {
    return [...this.said.values()].filter(({ hasStarted, isOver }) => !hasStarted && !isOver);
  }

  // Now: { utterance, position, index, label, word }, or null while nothing is said. index is of the phone; -1 between.
  at(time) {
    const said = this.said.get(this.current);
    if (!said || said.offset === null) return null;
    const position = time + said.offset;
    const index = said.phones.findLastIndex((phone) => phone && phone.start <= position && position < phone.end);
    if (said.isOver && position > (said.phones.at(-1)?.end ?? 0) + REST_S) {
      this.forget(said.utterance);
      return null;
    }
    const phone = said.phones[index];
    return { utterance: said.utterance, position, index, label: heard(phone), word: phone?.word ?? null };
  }

  // Phones that began and ended between two times: [{ utterance, label, word, position_s }].
  passed(since, until) {
    return [...this.said.values()].filter(({ hasStarted }) => hasStarted).flatMap(({ utterance, phones, offset }) =>
      phones
        .filter((phone) => phone && phone.start > since + offset && phone.end <= until + offset)
        .map((phone) => ({ utterance, label: heard(phone), word: phone.word, position_s: phone.start })),
    );
  }
}

function heard(phone) {
  return phone && phone.label !== SILENT ? phone.label : "";
}

// An utterance's text cut into pieces that belong to a word of its phones or to none: [{ text, first, last }], first and
// last being indices of phones, -1 for what stands between. Without a text the words stand for it.
export function captionPieces({ text, phones }) {
  const words = [];
  phones.forEach((phone, index) => {
    if (!phone?.word) return;
    const last = words.at(-1);
    if (last && last.word === phone.word && last.last === index - 1) last.last = index;
    else words.push({ word: phone.word, first: index, last: index });
  });
  if (!text) return words.flatMap(({ word, first, last }, place) => [
    ...(place ? [{ text: " ", first: -1, last: -1 }] : []), { text: word, first, last },
  ]);
  const pieces = [];
  const folded = text.toLowerCase();
  let done = 0;
  for (const { word, first, last } of words) {
    const at = folded.length === text.length ? folded.indexOf(word.toLowerCase(), done) : -1;
    if (at < 0) continue;
    if (at > done) pieces.push({ text: text.slice(done, at), first: -1, last: -1 });
    pieces.push({ text: text.slice(at, at + word.length), first, last });
    done = at + word.length;
  }
  if (done < text.length) pieces.push({ text: text.slice(done), first: -1, last: -1 });
  return pieces;
}
