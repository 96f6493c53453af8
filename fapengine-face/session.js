// One session of a server: its frames in their time, what it says, its sound; and what it can be told.

import { Link } from "./link.js";
import { Sound, SoundStream } from "./sound.js";
import { FadeOut, JitterBuffer, ServerClock, sampleFaded } from "./time.js";
import { Utterances } from "./utterances.js";

const LAGS = 90;
const PIECE_S = 0.1; // of sound, in one message
const EAR_DELAY_S = 0.25; // the face moves so long after the sound that moves it was sent

// Events, each with a detail: connection (name), refused (why), hello and message (what the server said), stand (whether
// the face stands still), begin, phone (utterance, label, word, position_s), started, finished, cancelled (utterance).
export class Session extends EventTarget {
  // server: its address, as fapengine serve prints it; a token in it counts.
  constructor({ server, session = "face", token = null }) {
    super();
    this.server = new URL("./", server);
    this.token = token;
    this.name = session;
    this.clock = new ServerClock();
    this.jitterBuffer = new JitterBuffer(60);
    this.fadeOut = new FadeOut();
    this.utterances = new Utterances();
    this.moment = null;
    this.followed = null; // time of the last picture
    this.begun = null;
    this.sound = new Sound((where) => this.report(where));
    this.stream = new SoundStream();
    this.waiting = new Set();
    this.heardElsewhere = false; // the server plays the sound
    this.paused = false;
    this.lags = [];
    const url = this.address("ws");
    url.protocol = this.server.protocol === "https:" ? "wss:" : "ws:";
    url.searchParams.set("session", session);
    this.link = new Link(
      url.href,
      {
        state: (name) => this.connection(name),
        refused: (why) => this.tell("refused", why),
        message: (message) => this.message(message),
        frame: (frame, arrival) => this.jitterBuffer.push(frame, arrival),
        pong: (sent, server, received) => this.clock.add(sent, server, received),
      },
      () => !document.hidden || this.sound.playing.size > 0, // its place is told in the server's time
    );
  }

  close() {
    this.link.close();
    this.sound.close();
    this.forgetSound();
  }

  // What the server serves at a path of its own.
  address(path) {
    const url = new URL(path.replace(/^\//, ""), this.server);
    if (this.token) url.searchParams.set("token", this.token);
    return url;
  }

  tell(type, detail) {
    this.dispatchEvent(new CustomEvent(type, { detail }));
  }

  // Frames

  // Writes into faps what to show at a time of this page, s. Returns { time } of the server, or null before any frame.
  sample(now, faps) {
    const shown = sampleFaded(this.jitterBuffer, this.fadeOut, now, faps);
    if (!shown) return null;
    if (this.clock.known) {
      this.lags.push(this.clock.at(now) - shown.time);
      if (this.lags.length > LAGS) this.lags.shift();
    }
    this.follow(shown.time);
    return shown;
  }

  // From the server's clock to the screen, s: the middle one of the last pictures, for single ones are held up.
  get lag() {
    return this.lags.length ? Float64Array.from(this.lags).sort()[this.lags.length >> 1] : 0;
  }

  follow(time) {
    // However few pictures are drawn, every phone is told; before at(), which forgets what is over.
    for (const passed of this.utterances.passed(this.followed ?? time, time)) {
      this.begins(passed.utterance);
      this.tell("phone", passed);
    }
    this.followed = time;
    const before = this.moment;
    const now = (this.moment = this.utterances.at(time));
    if (!now) return;
    this.begins(now.utterance);
    if (before?.utterance === now.utterance && before.index === now.index) return;
    const { utterance, label, word, position } = now;
    this.tell("phone", { utterance, label, word, position_s: position });
  }

  begins(utterance) {
    if (utterance === this.begun) return;
    this.begun = utterance;
    this.tell("begin", this.utterances.said.get(utterance));
  }

  get isSpeaking() {
    return this.utterances.current !== null;
  }

  // What the face is told. Each returns whether it could be sent.

  say(text, { voice, rate } = {}) {
    return this.send("say", { text, ...(voice ? { voice } : {}), ...(rate ? { rate } : {}) });
  }

  express(name, level = 1, rest = {}) {
    return this.send("express", { name, level, ...rest });
  }

  look(yaw, pitch) {
    return this.send("look", { yaw, pitch });
  }

  cancel() {
    this.sound.stop(null);
    this.forgetSound();
    return this.send("cancel");
  }

  // Sound of somebody who speaks, int16 and mono: the server's ear hears it, and the face moves 0.25 s later, when
  // it is played here, too.
  // It may come faster than it is heard, as of a TTS or a file: it is sent on as a microphone would.
  push(samples, rate) {
    this.stream.push(samples, rate, EAR_DELAY_S + Math.max(0, this.lag));
    const now = performance.now();
    this.pushedTo = Math.max(this.pushedTo ?? 0, now);
    const piece = Math.round(PIECE_S * rate);
    for (let at = 0; at < samples.length; at += piece) {
      const part = samples.subarray(at, at + piece);
      const timer = setTimeout(() => {
        this.waiting.delete(timer);
        this.link.sendSound(rate, part);
      }, this.pushedTo - now);
      this.waiting.add(timer);
      this.pushedTo += (1000 * part.length) / rate;
    }
    return this.link.isOpen;
  }

  // What waits to be sent or played.
  forgetSound() {
    this.stream.stop();
    for (const timer of this.waiting) clearTimeout(timer);
    this.waiting.clear();
    this.pushedTo = null;
  }

  send(type, fields) {
    return this.link.send(type, fields);
  }

  // Face and sound stand still together, and go on together.
  pause(wanted) {
    if (wanted === this.paused) return;
    this.send(wanted ? "pause" : "resume");
    this.stand(wanted);
  }

  stand(still) {
    if (still === this.paused) return;
    this.paused = still;
    this.sound.hold(still);
    this.tell("stand", still);
  }

  // Sound. Browsers let a page sound only after a click or a key. Resolves to whether it does.
  async play(wanted) {
    if (this.heardElsewhere) return false;
    const on = wanted ? await this.sound.enable() : (await this.sound.disable(), false);
    this.send("plays", { on });
    return on;
  }

  // Where the sound is, in the server's time. The face shows frames some time after they were made: it is told to be
  // ahead by just that, so that both meet here.
  report({ utterance, position, rate }) {
    if (!this.clock.known) return;
    const at = this.clock.at(performance.now() / 1000);
    this.send("audio", { utterance, at_s: at, position_s: position + Math.max(0, this.lag), rate });
  }

  // The server

  connection(name) {
    if (name !== "connected") {
      this.utterances.clear();
      this.begun = null;
      this.sound.stop(null); // nobody moves the lips any more
    }
    this.tell("connection", name);
  }

  message(message) {
    const { utterance } = message;
    switch (message.type) {
      case "hello":
        this.hello(message);
        break;
      case "begin":
        this.utterances.begin(utterance);
        break;
      case "phones":
        this.utterances.phones(utterance, message.first, message.phones);
        break;
      case "position":
        this.utterances.position(utterance, message.position_s, message.time_s);
        break;
      case "cancel":
        this.sound.stop(utterance);
        break;
      case "event":
        this.event(message);
        break;
      case "sound":
        this.utterances.text(utterance, message.text);
        if (this.sound.on && message.url) this.sound.play(utterance, this.address(message.url));
        break;
    }
    this.tell("message", message);
  }

  event({ kind, utterance }) {
    if (kind === "finished") this.utterances.over(utterance);
    if (kind === "cancelled") this.utterances.forget(utterance);
    if (["started", "finished", "cancelled"].includes(kind)) this.tell(kind, { utterance });
  }

  hello({ rate_hz, sound, paused }) {
    this.clock = new ServerClock();
    this.lags = [];
    this.jitterBuffer = new JitterBuffer(rate_hz);
    this.stand(paused);
    this.heardElsewhere = sound === "server";
    if (this.sound.on && !this.heardElsewhere) this.send("plays", { on: true });
  }
}
