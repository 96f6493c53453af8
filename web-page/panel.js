// Sliders and switches beside the face. They say what was done by sending it; what the server answers moves them.

const SEND_EVERY_MS = 33;
const SHOW_EVERY_MS = 90;
const HEAD = { yaw: "Turn", pitch: "Nod", roll: "Tilt" };
const HEAD_OVER_S = 0.15; // a slider that is dragged sends more often than that
const RAD = Math.PI / 180;
const SHARE = { low: 0, high: 3, step: 0.05, value: 1 };
const LOUDNESS = { low: -20, high: 20, step: 1, value: 0, text: (number) => `${number} dB` };
const LIVELINESS = { ...SHARE, high: 1 };
const MANNERS = { articulation: ["Articulation", SHARE], jaw: ["Jaw", SHARE], lips: ["Lips", SHARE], loudness_db: ["Loudness", LOUDNESS], liveliness: ["Liveliness", LIVELINESS] };
// How far lips follow a jaw that opens by 1, as in speech; by the standard FAP 3 leaves them shut.
const OPEN_JAW = 3;
const LIPS_FOLLOW = { 5: -1.1, 10: -0.8, 11: -0.8, 12: -0.25, 13: -0.25, 52: -1.1, 57: -1, 58: -1, 59: -0.25, 60: -0.25 };
const SWITCHES = { blinks: "Blinks", head_motion: "Head moves", gaze: "Gaze", idle: "Breath", emphasis: "Emphasis" };

const byId = (id) => document.getElementById(id);

function made(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

// Sends the newest of many values at a bearable rate; the last one always goes.
function throttled(send) {
  let timer = null;
  let waiting = null;
  const flush = () => {
    timer = null;
    if (waiting !== null) {
      send(waiting);
      waiting = null;
      timer = setTimeout(flush, SEND_EVERY_MS);
    }
  };
  return (value) => {
    waiting = value;
    if (timer === null) flush();
  };
}

function row(id, name, { low, high, step, value, text = (number) => number.toFixed(2) }, onInput) {
  const input = made("input", { type: "range", id, min: low, max: high, step, value });
  const output = made("output", { htmlFor: id, textContent: text(value) });
  const element = made("div", { className: "row" }, made("label", { htmlFor: id, textContent: name }), input, output);
  const show = (number) => {
    input.value = number;
    output.textContent = text(number);
    element.classList.toggle("on", number !== value);
  };
  input.addEventListener("input", () => {
    show(Number(input.value));
    onInput(Number(input.value));
  });
  return { element, show, input };
}

export class Panel {
  // send(type, fields)
  constructor(setup, send) {
    this.send = send;
    this.faps = new Map();
    this.held = new Map();
    this.shown = 0;
    this.expressions(setup.expressions);
    this.head(setup.head);
    this.manners();
    this.rates(setup.rates);
    for (const group of setup.groups) this.group(group);
    byId("search").addEventListener("input", ({ target }) => this.search(target.value));
    byId("release").addEventListener("click", () => send("release"));
  }

  expressions(names) {
    this.levels = new Map();
    for (const name of names) {
      const tell = throttled((level) => this.send("express", { name, level }));
      const made = row(`expression-${name}`, name.replace("_", " "), { low: 0, high: 1.5, step: 0.05, value: 0 }, tell);
      this.levels.set(name, made);
      byId("expressions").append(made.element);
    }
    byId("neutral").addEventListener("click", () => {
      for (const name of names) this.send("express", { name, level: 0 }); // the face may show what no slider knows
      for (const { show } of this.levels.values()) show(0);
    });
  }

  // Three angles, which go together: angles of the page in degrees, those of messages in rad.
  head(angles) {
    this.angles = new Map();
    const tell = throttled((over) => {
      const turned = [...this.angles].map(([name, { input }]) => [name, Number(input.value) * RAD]);
      this.send("head", { ...Object.fromEntries(turned), over });
    });
    for (const { name, positive, reach } of angles) {
      const limits = { low: -reach, high: reach, step: 1, value: 0, text: (number) => `${number}°` };
      const made = row(`head-${name}`, HEAD[name], limits, () => {
        made.input.focus({ preventScroll: true }); // a finger does not give it: the server's echo would move the others
        tell(HEAD_OVER_S);
      });
      made.input.title = `Positive: ${positive}`;
      this.angles.set(name, made);
      byId("head").append(made.element);
    }
    byId("straight").addEventListener("click", () => {
      for (const { show } of this.angles.values()) show(0);
      tell(2 * HEAD_OVER_S);
    });
  }

  rest() {
    for (const { show } of [...this.levels.values(), ...this.angles.values()]) show(0);
  }

  // Where somebody turned the head; a hand on one of the sliders knows better.
  turnHead(message) {
    if (byId("head").contains(document.activeElement)) return;
    for (const [name, { show }] of this.angles) show(Math.round(message[name] / RAD));
  }

  express(name, level) {
    const slider = this.levels.get(name);
    if (slider && document.activeElement !== slider.input) slider.show(level);
  }

  manners() {
    this.settings = new Map(); // setting to what shows its value
    for (const [setting, [name, limits]] of Object.entries(MANNERS)) {
      const tell = throttled((value) => this.send("manner", { setting, value }));
      const made = row(`manner-${setting}`, name, limits, tell);
      this.settings.set(setting, (value) => document.activeElement === made.input || made.show(value));
      byId("manners").append(made.element);
    }
    for (const [setting, name] of Object.entries(SWITCHES)) {
      const box = made("input", { type: "checkbox", checked: true, id: `manner-${setting}` });
      box.addEventListener("change", () => this.send("manner", { setting, value: box.checked ? 1 : 0 }));
      this.settings.set(setting, (value) => (box.checked = value !== 0));
      byId("switches").append(made("label", {}, box, name));
    }
    const eyes = made("input", { type: "checkbox", id: "follow" });
    byId("switches").append(made("label", {}, eyes, "Eyes follow the pointer"));
    this.lips = made("input", { type: "checkbox", checked: true, id: "lips-follow" });
    byId("switches").append(made("label", {}, this.lips, "Lips follow the jaw"));
  }

  // How the face speaks and moves, as somebody set it; a hand on the slider knows better.
  manner(setting, value) {
    this.settings.get(setting)?.(value);
  }

  // Words a minute of what this page has said.
  rates({ low, high, usual }) {
    const text = (number) => `${number}`;
    const made = row("rate", "Rate", { low, high, step: 1, value: usual, text }, (value) => (this.rate = value));
    made.input.title = "Words per minute";
    this.rate = null; // the server's
    byId("rates").append(made.element);
  }

  group({ name, faps }) {
    const count = made("small", { textContent: faps.length });
    const details = made("details", {}, made("summary", {}, name, count));
    details.open = false;
    for (const fap of faps) details.append(this.slider(fap, details));
    byId("groups").append(details);
  }

  slider({ number, name, unit, positive, low, high }, details) {
    const id = `fap-${number}`;
    const input = made("input", { type: "range", id, min: low, max: high, step: 1, value: 0 });
    const output = made("output", { htmlFor: id, textContent: "0" });
    const letGo = made("button", { type: "button", className: "let-go", textContent: "×", title: "Release" });
    letGo.setAttribute("aria-label", `Release FAP ${number}`);
    const label = made("label", { htmlFor: id, textContent: name.replaceAll("_", " ") });
    label.title = `FAP ${number} ${name}: ${positive}, in ${unit}`;
    const index = made("span", { className: "number", textContent: number });
    const element = made("div", { className: "fap" }, index, label, output, letGo, input);
    const pin = (value) => this.send("pin", { values: { [number]: value, ...this.lipsWith(number, value) } });
    const tell = throttled(pin);
    input.addEventListener("input", () => {
      output.textContent = input.value;
      element.classList.add("held");
      tell(Number(input.value));
    });
    letGo.addEventListener("click", () => {
      input.focus();
      pin(null);
    });
    this.faps.set(number, { element, input, output, details, words: `${number} ${name} ${name.replaceAll("_", " ")}` });
    return element;
  }

  // Values of the lips, if they follow this FAP; null releases them.
  lipsWith(number, value) {
    if (number !== OPEN_JAW || !this.lips.checked) return {};
    const follow = ([lip, share]) => [lip, value === null ? null : Math.round(share * value)];
    return Object.fromEntries(Object.entries(LIPS_FOLLOW).map(follow));
  }

  // What the server holds: FAP number to value.
  pins(values) {
    this.held = new Map(Object.entries(values).map(([number, value]) => [Number(number), value]));
    for (const [number, { element, input, output }] of this.faps) {
      const value = this.held.get(number);
      element.classList.toggle("held", value !== undefined);
      if (value !== undefined && !input.matches(":active")) {
        input.value = value;
        output.textContent = value;
      }
    }
    byId("release").disabled = this.held.size === 0;
  }

  // Sliders that nobody holds follow the face, where they can be seen.
  follow(faps, now) {
    if (now - this.shown < SHOW_EVERY_MS) return;
    this.shown = now;
    for (const [number, { input, output, details, element }] of this.faps) {
      if (!details.open || element.hidden || element.classList.contains("held") || input.matches(":active")) continue;
      const value = Math.round(faps[number - 1]);
      if (output.textContent !== String(value)) {
        input.value = value;
        output.textContent = value;
      }
    }
  }

  search(text) {
    const words = text.trim().toLowerCase().split(/\s+/).filter(Boolean);
    const open = new Map();
    for (const { element, details, words: own } of this.faps.values()) {
      element.hidden = !words.every((word) => own.includes(word));
      open.set(details, (open.get(details) ?? 0) + (element.hidden ? 0 : 1));
    }
    for (const [details, count] of open) {
      details.hidden = count === 0;
      details.open = words.length > 0 && count > 0;
      details.querySelector("small").textContent = count;
    }
  }
}
