// The page: fetches the head, opens a session, shows whatever comes, and passes on what is done here.

import { Caption } from "./caption.js";
import { parseHead } from "./face/head.js";
import { Microphone, samplesOf } from "./face/microphone.js";
import { Picture } from "./face/picture.js";
import { Recorder } from "./face/recorder.js";
import { Session } from "./face/session.js";
import { Steering } from "./face/steering.js";
import { Panel } from "./panel.js";
import { Ticker } from "./ticker.js";

const LOOK_EVERY_MS = 80;
const MAX_TEXT = 2000;
const MAX_HISTORY = 50;
const SINGLE_KEYS = ["/", "m", "b", "f", ...Array.from({ length: 9 }, (_, digit) => String(digit + 1))];
const CONNECTIONS = { connected: "connected", connecting: "connecting …", waiting: "no server, trying again …" };

const byId = (id) => document.getElementById(id);
const query = new URLSearchParams(location.search);
const token = query.get("token") ?? sessionStorage.getItem("token");
if (token) sessionStorage.setItem("token", token);
const isBroadcast = query.has("transparent"); // the face alone on a clear ground, for broadcasting software
if (isBroadcast) {
  document.documentElement.dataset.mode = "broadcast";
  document.querySelector("meta[name=color-scheme]").content = "normal"; // a dark one has a dark ground of its own
}

const address = (path) => {
  const url = new URL(path, document.baseURI);
  if (token) url.searchParams.set("token", token);
  return url;
};

async function fetched(path, read) {
  const answer = await fetch(address(path));
  if (!answer.ok) throw new Error(`${path}: the server answered ${answer.status} ${await answer.text()}`);
  return answer[read]();
}

const headNamed = async (name) => parseHead(await fetched(name ? `head.bin?name=${encodeURIComponent(name)}` : "head.bin", "arrayBuffer"));

// A text node is changed, not replaced: nothing is left for the collector.
function write(id, text) {
  const element = byId(id);
  if (!element.firstChild) element.append("");
  if (element.firstChild.data !== text) element.firstChild.data = text;
}

class Page {
  constructor(setup, head) {
    const canvas = byId("face");
    this.setup = setup;
    this.session = new Session({ server: document.baseURI, session: query.get("session") ?? "face", token });
    this.steering = new Steering(setup.cameras, (name) => this.mark(name));
    this.steering.listen(canvas);
    this.picture = new Picture(canvas, setup, head, (now, faps) => this.session.sample(now, faps), this.steering, {
      wall: isBroadcast ? null : setup.wall,
      edges: query.get("edges"),
      rest: query.get("rest"),
      isBusy: () => this.session.isSpeaking || this.recorder.on,
      shown: (shown, now) => this.shown(shown, now),
    });
    this.notice(this.unseen());
    this.ticker = new Ticker(byId("ticker"));
    this.caption = new Caption(byId("said"), byId("queue"));
    this.panel = new Panel(setup, (type, fields) => this.session.send(type, fields));
    this.microphone = new Microphone((rate, samples) => this.session.link.sendSound(rate, samples));
    this.recorder = new Recorder(canvas, this.session.sound);
    this.history = new History();
    this.rate = { since: performance.now(), count: 0 };
    canvas.addEventListener("pointermove", (event) => this.lookAt(event));
    this.cameras();
    this.listen();
    this.speaking();
    this.ownControls();
    this.keys();
    if (isBroadcast) this.session.play(true);
  }

  // Pictures

  shown(shown, now) {
    this.ticker.show(this.session.moment);
    write("phone", this.session.moment?.label || "–");
    if (!shown) return;
    this.panel.follow(this.picture.faps, now);
    this.count(now);
  }

  count(now) {
    this.rate.count += 1;
    const passed = now - this.rate.since;
    if (passed < 500) return;
    const { scale } = this.picture.budget;
    const reduced = scale < 1 ? ` at ${Math.round(100 * scale)} %` : "";
    write("fps", this.picture.view ? `${Math.round((1000 * this.rate.count) / passed)}${reduced}` : "no picture");
    write("latency", this.session.clock.known ? `${Math.max(0, Math.round(1000 * this.session.lag))} ms` : "–");
    this.rate = { since: now, count: 0 };
  }

  // Camera

  cameras() {
    this.steering.presets.forEach(([name], index) => {
      const button = document.createElement("button");
      button.type = "button";
      button.dataset.name = name;
      button.textContent = name[0].toUpperCase() + name.slice(1).replaceAll("-", " ");
      button.title = `${button.textContent} (${index + 1})`;
      button.addEventListener("click", () => this.steering.fly(index));
      byId("views").append(button);
    });
    const wanted = query.get("camera");
    this.mark(this.steering.presets[0][0]);
    if (wanted) this.steering.fly(wanted, { atOnce: true });
  }

  mark(name) {
    for (const button of byId("views").children) button.setAttribute("aria-pressed", button.dataset.name === name);
  }

  lookAt({ clientX, clientY }) {
    const now = performance.now();
    if (!byId("follow").checked || now - (this.looked ?? 0) < LOOK_EVERY_MS) return;
    this.looked = now;
    const { left, top, width, height } = this.picture.canvas.getBoundingClientRect();
    const angle = (name, slope) => {
      const { low, high } = this.setup.ranges.look[name];
      return Math.min(Math.max(Math.atan(slope), low), high);
    };
    const yaw = angle("yaw", (1.1 * (clientX - left - width / 2)) / height);
    const pitch = angle("pitch", (0.8 * (clientY - top - 0.45 * height)) / height);
    this.session.look(yaw, pitch);
  }

  // Speech

  speaking() {
    for (const [code, name] of Object.entries(this.setup.voices)) byId("voice").add(new Option(`${code}  ${name}`, code));
    remembered(byId("voice"), "voice");
    byId("speak").addEventListener("submit", (event) => {
      event.preventDefault();
      this.say(byId("text").value.trim());
    });
    byId("stop").addEventListener("click", () => this.hush());
    byId("sound").addEventListener("click", () => this.setSound(!this.session.sound.on));
    byId("microphone").addEventListener("click", () => this.setMicrophone(!this.microphone.on));
    byId("file").addEventListener("click", () => byId("recording").click());
    byId("recording").addEventListener("change", ({ target }) => target.files[0] && this.sayFile(target.files[0]));
    byId("text").addEventListener("keydown", (event) => {
      const text = { ArrowUp: () => this.history.older(event.target.value), ArrowDown: () => this.history.newer() }[event.key]?.();
      if (text === undefined || text === null) return;
      event.target.value = text;
      event.preventDefault();
    });
  }

  async say(text) {
    if (!text) {
      byId("text").focus();
      return;
    }
    if (text.length > MAX_TEXT) {
      this.told(`This text has ${text.length} characters; at most ${MAX_TEXT} are allowed. Nothing was sent.`, true);
      return;
    }
    this.session.pause(false);
    if (!this.hasChosenSilence && !this.session.heardElsewhere && !this.session.sound.on) await this.setSound(true);
    const rate = this.panel.rate;
    if (this.session.say(text, { voice: byId("voice").value, rate })) {
      this.history.add(text);
      byId("text").select();
      this.told("");
    } else {
      this.told("The server is not connected; trying again.", true);
    }
  }

  async setSound(wanted) {
    if (this.session.heardElsewhere) return;
    this.hasChosenSilence = !wanted;
    const on = await this.session.play(wanted);
    this.showSound(on);
    if (wanted && !on) this.told("This browser has no audio output; the face speaks silently.");
  }

  showSound(on) {
    const button = byId("sound");
    const { heardElsewhere } = this.session;
    button.disabled = heardElsewhere;
    button.setAttribute("aria-pressed", on);
    button.textContent = heardElsewhere ? "At server" : on ? "Sound on" : "Sound off";
    button.title = heardElsewhere ? "The server plays the sound on its own audio output" : "Sound on this page (M)";
  }

  async setMicrophone(wanted) {
    try {
      if (wanted) await this.microphone.enable();
      else this.microphone.disable();
      this.told(wanted ? "The face says what you say, 0.25 s later." : "");
    } catch (error) {
      this.microphone.disable();
      this.told(error.name === "NotAllowedError" ? "The microphone was not allowed." : error.message, true);
    }
    const { on } = this.microphone;
    byId("microphone").setAttribute("aria-pressed", on);
    byId("microphone").textContent = on ? "Mic on" : "Mic off";
  }

  // A recording: recognized by the server as it plays.
  async sayFile(file) {
    try {
      const { samples, rate } = await samplesOf(await file.arrayBuffer());
      if (this.session.push(samples, rate)) this.told(`${file.name}: ${(samples.length / rate).toFixed(1)} s of sound`);
      else this.told("The server is not connected; trying again.", true);
    } catch {
      this.told(`${file.name}: got no sound that this browser can read, expected WAV, MP3, Ogg, M4A or similar`, true);
    }
    byId("recording").value = "";
  }

  hush() {
    this.session.cancel();
    this.session.pause(false);
  }

  told(text, wrong = false) {
    byId("told").textContent = text;
    byId("told").classList.toggle("wrong", wrong);
  }

  notice(text) {
    byId("notice").textContent = text;
    byId("notice").hidden = !text;
  }

  // What belongs to this page alone

  ownControls() {
    for (const [name, title] of Object.entries(this.setup.heads)) byId("who").add(new Option(title, name));
    byId("who").parentElement.hidden = byId("who").options.length < 2;
    byId("who").addEventListener("change", ({ target }) => this.wear(target.value));
    const wanted = query.get("head");
    if (wanted && Object.hasOwn(this.setup.heads, wanted)) byId("who").value = wanted;
    byId("full").addEventListener("click", () => this.fill());
    byId("record").addEventListener("click", () => this.record());
    byId("record").disabled = !Recorder.isPossible || !this.picture.view;
    byId("broadcast").addEventListener("click", () => {
      const url = new URL(location.href);
      url.searchParams.set("transparent", "");
      if (byId("who").value) url.searchParams.set("head", byId("who").value);
      window.open(url, "_blank", "popup");
    });
    remembered(byId("letters"), "letters");
  }

  async wear(name) {
    this.told("Loading the face …");
    try {
      const head = await headNamed(name);
      this.picture.wear(head);
      this.told("");
    } catch (error) {
      this.told(error.message, true);
    }
  }

  fill() {
    if (document.fullscreenElement) document.exitFullscreen();
    else byId("stage").requestFullscreen().catch((error) => this.told(error.message, true));
  }

  async record() {
    const button = byId("record");
    if (this.recorder.on) {
      const film = await this.recorder.stop();
      const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(film), download: this.recorder.name });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
      this.told(`${this.recorder.name}: ${(film.size / 1e6).toFixed(1)} MB`);
    } else {
      this.recorder.start();
      this.told("Recording the face and its sound.");
    }
    button.setAttribute("aria-pressed", this.recorder.on);
    button.textContent = this.recorder.on ? "Stop recording" : "Record";
  }

  // The server

  listen() {
    const heard = {
      connection: (name) => this.connection(name),
      refused: (why) => this.notice(why || this.unseen()),
      stand: (still) => this.told(still ? "Paused. Press Space to continue." : ""),
      begin: (utterance) => this.begin(utterance),
      phone: () => this.caption.follow(this.session.moment.index),
      message: (message) => this.message(message),
    };
    for (const [type, hear] of Object.entries(heard)) this.session.addEventListener(type, ({ detail }) => hear(detail));
  }

  // Why there is no picture; empty where there is one.
  unseen() {
    return this.picture.trouble ? `${this.picture.trouble} The face speaks all the same, unseen.` : "";
  }

  connection(name) {
    document.body.dataset.connection = name;
    write("connection", CONNECTIONS[name]);
    if (name === "connected") this.notice(this.unseen());
    else this.ticker.clear();
  }

  begin(utterance) {
    this.ticker.update(utterance);
    this.caption.begin(utterance);
  }

  message(message) {
    const { utterances } = this.session;
    switch (message.type) {
      case "hello":
        this.hello(message);
        break;
      case "phones":
      case "sound":
        if (message.utterance === this.session.moment?.utterance) this.begin(utterances.said.get(message.utterance));
        break;
      case "pins":
        this.panel.pins(message.values);
        break;
      case "express":
        this.panel.express(message.name, message.level);
        break;
      case "head":
        this.panel.turnHead(message);
        break;
      case "manner":
        this.panel.manner(message.setting, message.value);
        break;
      case "error":
        this.told(message.message, true);
        break;
    }
    this.caption.wait(utterances.queue);
  }

  hello({ session, profile, voice, recognizer, manner = {} }) {
    byId("microphone").hidden = byId("file").hidden = !recognizer;
    write("session", session);
    byId("session").title = `Session ${session}, profile ${profile}`;
    this.panel.rest(); // what is set is told next
    for (const [setting, value] of Object.entries(manner)) this.panel.manner(setting, value);
    for (const id of ["text", "say", "voice"]) byId(id).disabled = !voice;
    byId("text").placeholder = voice ? "Type a sentence and press Enter" : "The server has no voice; send phones by OSC";
    this.showSound(this.session.sound.on && !this.session.heardElsewhere);
  }

  keys() {
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape") this.hush();
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.target.matches("[type=text], [type=search], select")) return;
      if (event.key === " " && event.target.matches("button, summary, input")) return; // it means these
      const key = event.key.toLowerCase();
      if (SINGLE_KEYS.includes(key) && !byId("letters").checked) return;
      if (key === "/") byId("text").focus();
      else if (key === "m") this.setSound(!this.session.sound.on);
      else if (key === "b") this.session.send("blink");
      else if (key === "f") this.fill();
      else if (key === " ") this.session.pause(!this.session.paused);
      else if (key >= "1" && key <= "9") this.steering.fly(Number(key) - 1);
      else return;
      event.preventDefault();
    });
  }
}

// What was said on this page, for the arrow keys of the text box.
class History {
  constructor() {
    this.texts = JSON.parse(sessionStorage.getItem("history") ?? "[]");
    this.place = this.texts.length;
    this.draft = "";
  }

  add(text) {
    this.texts = [...this.texts.filter((one) => one !== text), text].slice(-MAX_HISTORY);
    this.place = this.texts.length;
    sessionStorage.setItem("history", JSON.stringify(this.texts));
  }

  // Null where there is none.
  older(now) {
    if (this.place === this.texts.length) this.draft = now;
    if (this.texts[this.place - 1] === now) this.place -= 1; // it still stands there after it was said
    return this.place > 0 ? this.texts[--this.place] : null;
  }

  newer() {
    if (this.place >= this.texts.length) return null;
    return ++this.place === this.texts.length ? this.draft : this.texts[this.place];
  }
}

// A field that keeps its value from visit to visit.
function remembered(field, name) {
  const property = field.type === "checkbox" ? "checked" : "value";
  const kept = localStorage.getItem(name);
  if (kept !== null && property === "checked") field.checked = kept === "true";
  else if (kept !== null && [...field.options].some(({ value }) => value === kept)) field.value = kept;
  field.addEventListener("change", () => localStorage.setItem(name, field[property]));
}

try {
  const setup = await fetched("setup.json", "json");
  const wanted = query.get("head");
  const head = await headNamed(wanted && Object.hasOwn(setup.heads, wanted) ? wanted : "");
  window.page = new Page(setup, head); // for the console
} catch (error) {
  byId("notice").textContent = error.message;
  byId("notice").hidden = false;
  console.error(error);
}
