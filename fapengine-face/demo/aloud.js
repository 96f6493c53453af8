// Lets a browser's voice say a text, and a face say it with it.

globalThis.speechSynthesis?.getVoices(); // browsers give none at first, and fetch them then

// How far the voice is, by its reports of words: between two of them the face goes on by itself, and waits at the next word
// until it is reported. A voice that reports none leads nothing: then the face has the clock from its start.
export class VoiceClock {
  constructor() {
    this.places = null; // of words in the text, and their times; once they are known
    this.known = [-Infinity, 0]; // when something was reported, s, and how far the face is then
    this.next = Infinity; // how far it may go
  }

  heard(place) {
    const index = this.places?.findLastIndex(([first]) => first <= place) ?? -1;
    if (index < 0) return;
    this.known = [performance.now() / 1000, this.places[index][1]];
    this.next = this.places[index + 1]?.[1] ?? Infinity;
  }

  began() {
    if (this.known[0] === -Infinity) this.known = [performance.now() / 1000, 0];
  }

  read = () => (this.known[0] === -Infinity ? 0 : Math.min(this.known[1] + performance.now() / 1000 - this.known[0], this.next));
}

// Resolves to what say resolves to, and isSilent: without such a voice nothing is heard.
export async function sayAloud(face, text, isAloud) {
  globalThis.speechSynthesis?.cancel();
  // Not a voice that is computed elsewhere: it would be sent the text.
  const voice = isAloud && globalThis.speechSynthesis?.getVoices().find(({ lang, localService }) => localService && lang.startsWith("en"));
  if (!voice) return { ...(await face.say(text)), isSilent: true };
  const clock = new VoiceClock();
  const said = await face.say(text, { clock: clock.read });
  if (!said) return said;
  let at = 0;
  clock.places = said.words.map(({ text: word, start }) => {
    const first = text.indexOf(word, at);
    at = first + word.length;
    return [first, start];
  });
  const utterance = new SpeechSynthesisUtterance(text);
  Object.assign(utterance, { voice, lang: voice.lang });
  utterance.onstart = () => clock.began();
  utterance.onboundary = ({ charIndex, name }) => name !== "sentence" && clock.heard(charIndex);
  utterance.onend = utterance.onerror = () => {
    clock.began(); // a voice that failed keeps no mouth waiting
    clock.next = Infinity;
  };
  speechSynthesis.speak(utterance);
  return { ...said, isSilent: false };
}
