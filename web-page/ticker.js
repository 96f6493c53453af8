// The phones as they pass: what is being said stands in the middle, what comes is to the right.

const PIXELS_A_SECOND = 360; // a phone of 50 ms has room for its letter
const KEEP = 6;
const SILENT = "_";

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
    this.track = element.querySelector(".ticker-track");
    this.said = new Map();
    this.current = null;
  }

  begin(utterance) {
    if (this.said.has(utterance)) return;
    const lane = document.createElement("div");
    lane.className = "lane";
    lane.hidden = true;
    this.track.append(lane);
    this.said.set(utterance, { lane, phones: new Map(), position: null });
    while (this.said.size > KEEP) this.forget(this.said.keys().next().value);
  }

  phones(utterance, first, phones) {
    this.begin(utterance);
    const said = this.said.get(utterance);
    phones.forEach(([label, start, end, word], offset) => {
      const before = said.phones.get(first + offset);
      before?.chip.remove();
      before?.caption?.remove();
      const chip = document.createElement("span");
      chip.className = label === SILENT || !label ? "phone pause" : "phone";
      chip.textContent = label === SILENT || !label ? "·" : label;
      chip.style.left = `${start * PIXELS_A_SECOND}px`;
      chip.style.width = `${Math.max(2, (end - start) * PIXELS_A_SECOND - 3)}px`;
      const caption = word && said.phones.get(first + offset - 1)?.word !== word ? named(word, start) : null;
      said.lane.append(chip, ...(caption ? [caption] : []));
      said.phones.set(first + offset, { chip, caption, start, end, label, word });
    });
  }

  // Where an utterance is at a time of the server.
  position(utterance, position, time) {
    const said = this.said.get(utterance);
    if (!said || position === null) return;
    said.position = position - time;
    this.current = utterance;
  }

  over(utterance) {
    const said = this.said.get(utterance);
    if (!said) return;
    said.over = true;
    if (this.current !== utterance) this.forget(utterance);
  }

  forget(utterance) {
    this.said.get(utterance)?.lane.remove();
    this.said.delete(utterance);
    if (this.current === utterance) this.current = null;
  }

  clear() {
    for (const utterance of [...this.said.keys()]) this.forget(utterance);
  }

  // Called for every picture with the server's time on the screen; returns the phone that is being said, or "".
  show(time) {
    let sounding = "";
    for (const [utterance, { lane, phones, position, over }] of this.said) {
      lane.hidden = utterance !== this.current || position === null;
      if (lane.hidden) continue;
      const at = time + position;
      lane.style.transform = `translateX(${-at * PIXELS_A_SECOND}px)`;
      let last = 0;
      for (const { chip, start, end, label } of phones.values()) {
        const now = start <= at && at < end;
        if (now !== chip.classList.contains("now")) chip.classList.toggle("now", now);
        if (now && label !== SILENT) sounding = label;
        last = Math.max(last, end);
      }
      if (over && at > last + 0.6) this.forget(utterance);
    }
    return sounding;
  }
}
