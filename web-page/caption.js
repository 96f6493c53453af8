// What is being said, word for word, and what waits behind it.

import { captionPieces } from "./face/utterances.js";

const WAITING_SHOWN = 3;

export class Caption {
  // said: a live region, told once an utterance; queue: a list.
  constructor(said, queue) {
    this.said = said;
    this.queue = queue;
    this.pieces = [];
    this.waiting = "";
  }

  begin(utterance) {
    this.pieces = captionPieces(utterance).map(({ text, first, last }) => {
      const span = document.createElement("span");
      span.textContent = text;
      return { span, first, last };
    });
    this.said.replaceChildren(...this.pieces.map(({ span }) => span));
  }

  // The word in which a phone stands is marked.
  follow(index) {
    for (const { span, first, last } of this.pieces) span.classList.toggle("now", first <= index && index <= last && first >= 0);
  }

  clear() {
    this.pieces = [];
    this.said.replaceChildren();
  }

  // utterances that wait, in order.
  wait(utterances) {
    const texts = utterances.map((one) => captionPieces(one).map(({ text }) => text).join("")).filter(Boolean);
    const rest = texts.length - WAITING_SHOWN;
    const shown = [...texts.slice(0, WAITING_SHOWN), ...(rest > 0 ? [`and ${rest} more`] : [])];
    if (shown.join("\n") === this.waiting) return;
    this.waiting = shown.join("\n");
    this.queue.replaceChildren(...shown.map((text) => Object.assign(document.createElement("li"), { textContent: text })));
  }
}
