// The phones as they pass: what is being said stands in the middle, what comes is to the right.

import { SILENT } from "./face/utterances.js";

const PIXELS_A_SECOND = 360; // a phone of 50 ms has room for its letter

// A word stands under its first phone.
function named(word, start) {
  const caption = document.createElement("span");
  caption.className = "word";
  caption.textContent = word;
  caption.style.left = `${start * PIXELS_A_SECOND}px`;
  return caption;
}

export class Ticker {
  constructor(element) {
    this.element = element;
    this.track = element.querySelector(".ticker-track");
    this.lane = null;
  }

  // One phone of the lane that is shown, or again if it was changed.
  place({ chips }, index, phones) {
    const { label, start, end, word } = phones[index];
    const before = chips[index];
    if (before?.label === label && before.start === start && before.end === end) return;
    before?.chip.remove();
    before?.caption?.remove();
    const chip = document.createElement("span");
    chip.className = label === SILENT || !label ? "phone pause" : "phone";
    chip.textContent = label === SILENT || !label ? "·" : label;
    chip.style.left = `${start * PIXELS_A_SECOND}px`;
    chip.style.width = `${Math.max(2, (end - start) * PIXELS_A_SECOND - 3)}px`;
    const caption = word && phones[index - 1]?.word !== word ? named(word, start) : null;
    this.lane.element.append(chip, ...(caption ? [caption] : []));
    chips[index] = { chip, caption, label, start, end };
  }

  // Of the utterance that is said, what its phones are now; nothing of others.
  update({ utterance, phones }) {
    if (this.lane?.utterance !== utterance) {
      this.clear();
      const element = document.createElement("div");
      element.className = "lane";
      this.track.append(element);
      this.lane = { utterance, element, chips: [], now: -1 };
    }
    phones.forEach((_, index) => this.place(this.lane, index, phones));
  }

  clear() {
    this.lane?.element.remove();
    this.lane = null;
    this.element.classList.remove("speaking");
  }

  // Called for every picture with what sounds (utterances.js), or null.
  show(moment) {
    if (!moment || this.lane?.utterance !== moment.utterance) {
      if (!moment && this.lane) this.clear();
      return;
    }
    const { lane } = this;
    this.element.classList.add("speaking");
    lane.element.style.transform = `translateX(${-moment.position * PIXELS_A_SECOND}px)`;
    if (lane.now === moment.index) return;
    lane.chips[lane.now]?.chip.classList.remove("now");
    lane.chips[moment.index]?.chip.classList.add("now");
    lane.now = moment.index;
  }
}
