// A face without a server: it hears sound, or takes phones with times. A source of FAPs for <fap-face>, or for a rig of
// one's own; needs neither DOM nor WebGL. Nothing is fetched before make, and the recognizer's weights not before hear.

import { bytesOf } from "./bytes.js";
import { expression, hearing, host_words, phone_track, protocol, stream } from "./constants.js";
import { Gestures } from "./gestures.js";
import { placeAfter } from "./path.js";
import { Planner, checkedPhone, isSame } from "./planner.js";
import { Profile, marked } from "./profile.js";
import { Ramp } from "./ramp.js";
import { Recognizer } from "./recognizer.js";
import { Pieces } from "./tap-worklet.js";
import { phonesOf } from "./words.js";

const { ATTACK_S, MAX_WEIGHT, RELEASE_S } = expression;
const { OPEN_S } = host_words;
const { PAUSE_S } = hearing;
const { RATE_HZ } = protocol;
const { SILENCE } = phone_track;
const { AHEAD_PHONES } = stream;
const NEUTRAL = "neutral";
const DELAY_S = 0.25;
const LOOK_AHEAD_S = 0.3; // age of phones that do not change any more
const STEPS = 1; // blocks of 20 ms
const FAR_S = 1e6;
const MOST_DELAY_S = 60;
const [NEXT_S, AHEAD_S] = [3, 5]; // the planner knows what is said at least and at most so long before
const LONG_OVER_S = 2; // what is over by more, and was never seen, is not said any more
const REPLACED = "hear: something else was begun meanwhile";
const UNSEEN_S = 0.5; // time without pictures after which phones that come make one
const ASSETS = {
  // Spelled out, because that is how bundlers find them.
  planner: new URL("../assets/planner.bin", import.meta.url),
  recognizer: new URL("../assets/recognizer.bin", import.meta.url),
  worker: new URL("./worker.js", import.meta.url),
  worklet: new URL("./tap-worklet.js", import.meta.url),
};

// Where a page demands trusted types, its policy may name ours.
function trusted(url) {
  policy ??= globalThis.trustedTypes?.createPolicy("fapengine-face", { createScriptURL: (address) => address });
  return policy ? policy.createScriptURL(String(url)) : url;
}
let policy = null;

const startOf = ({ start }) => start;
const seconds = () => performance.now() / 1000;

// Events: started, phone, finished, cancelled, lost, regained, error. Stateful.
export class Live extends EventTarget {
  // style: see Planner. still: no blinks, glances, nods, head motion, drifts and variation. liveliness: natural variation of
  // speech, 0 to 1. seed: of these, an integer; by default it is drawn. assets: addresses of planner.bin, recognizer.bin, words-en.bin,
  // worker.js and tap-worklet.js elsewhere.
  static async make({ assets = {}, ...options } = {}) {
    const addresses = { ...ASSETS, ...assets };
    return new Live(new Profile(await bytesOf(addresses.planner)), options, addresses);
  }

  constructor(profile, { still = false, liveliness = 1, seed = Math.floor(Math.random() * 2 ** 32), ...style } = {}, addresses = ASSETS) {
    super();
    if (!(liveliness >= 0 && liveliness <= 1)) throw new TypeError(`liveliness: must be 0 to 1, got ${liveliness}`);
    Object.assign(this, { profile, style, addresses, still, liveliness, seed });
    this.gestures = null; // from the first frame on
    this.moods = profile.expressionNames.map(() => new Ramp());
    this.faps = new Float32Array(profile.low.length);
    this.reset();
  }

  reset() {
    this.planner = new Planner(this.profile, this.style);
    this.gestures?.hush(-Infinity);
    this.clock = null; // position of what is shown, s
    this.position = -Infinity;
    this.coming = []; // phones to say that the planner does not have yet
    this.fed = []; // phones of the recognizer that may still change, as the planner has them
    this.deaf = 0; // phones of sound before it are not said
    this.isSpeaking = false;
    this.spokenUntil = -Infinity;
    this.saidUntil = 0; // where a text that is added begins
    this.pause = 0;
    this.sampled = -Infinity; // when, by the page's clock
    this.recognizer = this.pieces = null;
  }

  tell(type, detail) {
    this.dispatchEvent(Object.assign(new Event(type), { detail }));
  }

  // Follows sound: a MediaStream, an AudioNode, or what getUserMedia takes, { audio: true }: a device that is opened again
  // where it was unplugged. delay: time by which the face is later. Resolves to the delayed sound, an AudioNode that the
  // page connects to where it is to be heard.
  async hear(input, { context = input?.context, delay = DELAY_S, lookAhead = LOOK_AHEAD_S } = {}) {
    if (!globalThis.AudioWorkletNode) throw new Error("hear: got no AudioWorklet; browsers have it on https and localhost, elsewhere use push");
    const [isStream, isNode] = [input instanceof MediaStream, input instanceof AudioNode];
    if (!isStream && !isNode && !input?.audio) throw new TypeError(`hear: got ${input}, expected a MediaStream, an AudioNode, or { audio } of a device`);
    if (isStream && !input.getAudioTracks().length) throw new TypeError("hear: got a MediaStream without sound, expected one with an audio track");
    if (isNode && context !== input.context) throw new TypeError("hear: got an AudioNode of another context, expected one of the context that is given");
    if (context?.state === "closed") throw new Error("hear: got a context that is closed");
    checkTimes("hear", { delay, lookAhead });
    this.stop();
    const run = (this.run = { over: new AbortController(), wanted: isStream || isNode ? null : input });
    try {
      return await this.begin(run, input, context, delay, lookAhead);
    } catch (error) {
      if (this.run !== run) throw new Error(REPLACED);
      this.stop();
      throw error;
    }
  }

  async begin(run, input, context, delay, lookAhead) {
    if (!context) {
      context = run.context = new AudioContext();
      const wake = () => context.state !== "running" && context.resume().catch(() => {});
      for (const type of ["pointerdown", "keydown"]) globalThis.document?.addEventListener(type, wake, run.over); // before one of them, browsers let no sound begin
    }
    const { worklet, worker } = this.addresses;
    const replaced = new Promise((_, reject) => (run.giveUp = () => reject(new Error(REPLACED))));
    const opening = run.wanted ? this.open(run).then((stream) => (run.stream = stream)) : input;
    const [tables, source] = await Promise.race([
      Promise.all([bytesOf(this.addresses.recognizer), opening, context.audioWorklet.addModule(String(worklet))]), replaced,
    ]);
    run.worker = new Worker(trusted(worker));
    const { port1, port2 } = new MessageChannel();
    const started = new Promise((resolve, reject) => {
      run.worker.onmessage = resolve;
      run.worker.onerror = ({ message }) => reject(new Error(`hear: the recognizer's worker ${worker} did not start: ${message ?? ""}`));
      run.worker.postMessage({ tables, port: port2, options: { lookAhead, steps: STEPS } }, [tables, port2]);
    });
    await Promise.race([started, replaced]);
    run.worker.onmessage = ({ data }) => this.run === run && this.take(data);
    run.worker.onerror = ({ message }) => this.tell("error", `the recognizer's worker: ${message}`);
    run.tap = new AudioWorkletNode(context, "fapengine-tap", { numberOfOutputs: 0 });
    run.tap.port.onmessage = ({ data: { begun } }) => {
      if (this.run !== run) return;
      this.begun = begun; // where positions are 0, by the context's clock
      this.clock = () => heardBy(context) - begun - delay;
    };
    run.tap.port.postMessage({ to: port1 }, [port1]);
    run.delayed = new DelayNode(context, { delayTime: delay, maxDelayTime: Math.max(1, delay) });
    this.connect(run, source, context);
    const { signal } = run.over;
    if (run.wanted) navigator.mediaDevices.addEventListener("devicechange", () => run.isLost && this.regain(run, context), { signal });
    this.pause = PAUSE_S;
    if (context.state === "suspended") context.resume().catch(() => {});
    return run.delayed;
  }

  // Connects a stream or a node to what listens.
  connect(run, input, context) {
    const { signal } = run.over;
    const isStream = input instanceof MediaStream;
    if (isStream) run.element = playUnheard(input);
    run.source = isStream ? new MediaStreamAudioSourceNode(context, { mediaStream: input }) : input;
    for (const node of [run.tap, run.delayed]) run.source.connect(node);
    for (const track of isStream ? input.getAudioTracks() : []) {
      if (track.readyState === "ended") this.lose(run, context); // it was unplugged meanwhile
      else track.addEventListener("ended", () => this.lose(run, context), { signal });
    }
  }

  // A device was unplugged, or a call has ended: silence follows, and the face comes to rest.
  lose(run, context) {
    run.isLost = true;
    if (run.stream) end(run.stream);
    this.tell("lost");
    if (run.wanted) this.regain(run, context);
  }

  // Goes on with the device that is there now; without one, the next that comes is tried.
  async regain(run, context) {
    const stream = await this.open(run).catch(() => null);
    if (!stream) return;
    if (!run.isLost) return end(stream); // another one was faster
    run.isLost = false;
    run.stream = stream;
    disconnect(run);
    this.tell("regained");
    this.connect(run, stream, context);
  }

  // Opens the device that is wanted; null where nobody listens any more.
  async open(run) {
    const stream = await navigator.mediaDevices.getUserMedia(run.wanted);
    if (this.run === run) return stream;
    end(stream);
    return null;
  }

  // Sound without Web Audio, as it comes: samples from -1 to 1, mono. The face is later by delay; its clock is the sound.
  async push(samples, rate, { delay = DELAY_S, lookAhead = LOOK_AHEAD_S } = {}) {
    if (!(samples instanceof Float32Array)) throw new TypeError(`push: got ${nameOf(samples)}, expected a Float32Array of samples from -1 to 1`);
    if (!(Number.isInteger(rate) && rate >= 1000)) throw new TypeError(`push: got a rate of ${rate}, expected an integer, 1000 Hz or more`);
    checkTimes("push", { delay, lookAhead });
    if (this.opening && rate !== this.rate) throw new Error(`push: got ${rate} Hz after ${this.rate} Hz; call stop() between sounds`);
    if (!this.opening) {
      this.stop();
      this.rate = rate;
      const run = (this.run = {});
      this.opening = bytesOf(this.addresses.recognizer).then((tables) => {
        if (this.run !== run) return;
        this.recognizer = new Recognizer(tables, { lookAhead, steps: STEPS });
        this.pieces = new Pieces(rate, (piece) => {
          const final = this.recognizer.push(piece);
          this.take({ final, partial: this.recognizer.partial, heard: this.recognizer.came / RATE_HZ });
        });
        this.clock = () => this.recognizer.came / RATE_HZ - delay;
        this.pause = PAUSE_S;
      });
      this.opening.catch(() => this.run === run && (this.opening = null)); // the next sound tries again
    }
    await this.opening;
    this.pieces?.push(samples);
  }

  // Phones of the recognizer: final ones, and those after them that may still change.
  take({ final, partial, heard }) {
    this.heard = heard;
    const phones = [...final, ...partial].filter(({ start }) => start >= this.deaf);
    const last = phones.at(-1);
    if (partial.length && last && last.label !== SILENCE) phones[phones.length - 1] = { ...last, end: last.end + OPEN_S };
    const same = phones.findIndex((phone, index) => !this.fed[index] || !isSame(phone, this.fed[index]));
    const first = same < 0 ? phones.length : same;
    const { edge } = this.planner;
    const from = Math.min(phones[first]?.start ?? Infinity, this.fed[first]?.start ?? Infinity);
    if (from < Infinity) {
      const silence = { label: SILENCE, start: Math.max(from, edge, 0), end: FAR_S };
      this.planner.feed([silence, ...phones.slice(first).filter(({ label, end }) => label !== SILENCE && end > edge)]);
    }
    this.fed = phones.filter(({ start }) => !final.length || start >= final.at(-1).end);
    if (seconds() - this.sampled > UNSEEN_S) this.sample(seconds(), this.faps); // a tab in the background draws nothing
  }

  // Says phones, { label, start, end, stress?, word?, loudness? }, s; or, later, a text, or words, { text, start, end? }. clock: gives
  // the position of what is heard now, s; by default it begins now. add: what is said before goes on, with its clock; a text
  // follows it.
  // pronounce: gives the phones of a word, a list or a text with spaces, or a promise of them; by default words-en does.
  // Of words it resolves to { words, unread }: their times, and those without phones; null if something else was begun.
  say(said, { clock, add = false, pronounce } = {}) {
    const isPhones = Array.isArray(said) && said.every((one) => one?.label !== undefined || one?.text === undefined);
    if (!Array.isArray(said) && typeof said !== "string") throw new TypeError(`say: got ${nameOf(said)}, expected a text, or an array of { label, start, end } or of { text, start, end }`);
    for (const [name, given] of Object.entries({ clock, pronounce })) {
      if (given !== undefined && typeof given !== "function") throw new TypeError(`say: got the ${name} ${given}, expected a function`);
    }
    if (!isPhones) return this.sayWords(typeof said === "string" ? said : said.map(checkedWord).sort((one, other) => one.start - other.start), clock, add, pronounce);
    const checked = said.map(checkedPhone).map(marked);
    if (!add || !this.clock || this.run) {
      this.stop();
      const begun = seconds();
      this.clock = clock ?? (() => seconds() - begun);
    }
    this.coming = [...this.coming, ...checked].sort((one, other) => one.start - other.start);
    this.saidUntil = Math.max(this.saidUntil, ...checked.slice(-1).map(({ end }) => end));
  }

  async sayWords(said, clock, add, pronounce) {
    const turn = (this.turn = (add && this.turn) || {});
    const voice = pronounce
      ? { pronounce: (words) => Promise.all(words.map((word, index) => pronounce(word, index, words))) }
      : this.english();
    const made = Promise.resolve(voice).then((known) => phonesOf(said, known));
    await (turn.last = Promise.allSettled([made, turn.last])); // what is added keeps its order
    const { phones, words, unread, end } = await made;
    if (this.turn !== turn) return null;
    const from = typeof said === "string" && add && this.clock && !this.run ? Math.max(this.saidUntil, this.now()) : 0;
    const moved = (one) => ({ ...one, start: one.start + from, end: one.end + from });
    this.say(phones.map(moved), { clock, add });
    this.saidUntil = Math.max(this.saidUntil, from + end);
    this.turn = turn; // whoever adds to these goes on
    return { words: words.map(moved), unread };
  }

  async english() {
    this.voice ??= import("../words-en/index.js").then(({ English }) => English.make({ assets: this.addresses }));
    try {
      return await this.voice;
    } catch (error) {
      this.voice = null; // the next words try again
      throw error;
    }
  }

  // Gives the planner the phones of the next seconds, and as many as it looks ahead: it keeps a limited number.
  feed(time) {
    const { phones } = this.planner;
    const more = AHEAD_PHONES + 1 - (phones.length - placeAfter(phones, time, startOf)); // after the one that is said
    if (!this.coming.length || (this.coming[0].start > time + NEXT_S && more <= 0)) return;
    // After a time without pictures, what is long over would take the place of what is due.
    const coming = (this.coming = this.coming.filter(({ end }) => end > time - LONG_OVER_S));
    const count = Math.max(placeAfter(coming, time + AHEAD_S, startOf), more);
    this.planner.feed(coming.splice(0, count));
  }

  // Ends what is said; sound that comes afterwards is followed again.
  cancel() {
    this.planner.cancel(Math.max(this.position, 0));
    this.gestures?.hush(this.position);
    this.deaf = this.heard ?? 0;
    this.fed = [];
    this.coming = [];
    this.turn = null;
    this.saidUntil = 0;
    if (this.isSpeaking) this.tell("cancelled");
    this.isSpeaking = false;
  }

  // Shows an expression by its name, level 0 to 2; "neutral" ends all. It comes in attack_s, and goes after hold_s.
  express(name, level = 1, { attack_s: attack = ATTACK_S, hold_s: hold = Infinity, release_s: release = RELEASE_S } = {}) {
    const known = this.profile.expressionNames;
    if (name !== NEUTRAL && !known.includes(name)) throw new TypeError(`express: got ${name}, expected ${[...known, NEUTRAL].join(", ")}`);
    if (!(level >= 0 && level <= MAX_WEIGHT && attack > 0 && release > 0 && hold >= 0)) {
      throw new TypeError(`express: got level ${level}, attack ${attack}, hold ${hold}, release ${release}; expected a level of 0 to ${MAX_WEIGHT}, and times in s`);
    }
    const now = seconds();
    this.moods.forEach((mood, index) => {
      if (name === NEUTRAL) mood.to(0, now, attack);
      else if (known[index] === name) {
        mood.to(level, now, attack);
        if (hold < Infinity) mood.then(0, now + attack + hold, release);
      }
    });
    this.isShowing = true;
  }

  expression(now) {
    const isVaried = this.gestures && this.liveliness > 0;
    if (!this.isShowing && !isVaried) return null;
    const { expressions, low } = this.profile;
    const faps = new Float64Array(low.length);
    if (isVaried) this.gestures.vary(faps, now, this.liveliness * Math.min(1, this.style.articulation ?? 1));
    this.moods.forEach((mood, index) => {
      const level = mood.value(now);
      for (let column = 0; level && column < faps.length; ++column) faps[column] += level * expressions[index * faps.length + column];
    });
    return faps;
  }

  // Position of what is shown now, s.
  now() {
    const heard = this.clock?.();
    return Math.max(Number.isFinite(heard) ? heard : 0, this.position, 0);
  }

  // Writes the FAPs of now, by the page's clock in s; returns the position of what is shown.
  sample(now, faps) {
    this.sampled = now;
    const time = this.now();
    this.feed(time);
    if (!this.still) this.gestures ??= new Gestures(this.seed, now);
    this.gestures?.draw(now, this.planner.phones, now - time);
    this.planner.frame(time, faps, this.expression(now), this.gestures?.faps(now));
    this.follow(time);
    return { time };
  }

  // Tells what is said at a time.
  follow(time) {
    const { phones } = this.planner;
    const next = placeAfter(phones, time, startOf);
    for (const phone of phones.slice(placeAfter(phones, this.position, startOf), next)) {
      if (!this.isSpeaking) this.tell("started");
      this.isSpeaking = true;
      this.spokenUntil = phone.end;
      this.tell("phone", { label: phone.label, word: phone.word || null, position_s: phone.start });
    }
    this.position = time;
    if (this.isSpeaking && time >= this.spokenUntil + this.pause && next === phones.length && !this.coming.length) {
      this.isSpeaking = false;
      this.tell("finished");
    }
  }

  // Calls a function with 52 ARKit weights and 68 FAPs, 60 times a second, where nobody else asks for frames.
  get onweights() {
    return this.taker ?? null;
  }

  set onweights(take) {
    clearInterval(this.timer);
    this.timer = null;
    this.taker = take;
    if (!take) return;
    import("../arkit.js").then(({ ArkitFollower }) => {
      if (this.taker !== take) return;
      const follower = new ArkitFollower();
      this.timer = setInterval(() => {
        this.sample(seconds(), this.faps);
        take(follower.follow(this.faps), this.faps);
      }, 1000 / 60);
    });
  }

  // Ends what is heard or said.
  stop() {
    const { run } = this;
    this.run = this.opening = this.heard = this.turn = null;
    run?.tap?.port.postMessage({ isOver: true });
    if (run?.source) disconnect(run);
    if (run?.stream) end(run.stream);
    run?.worker?.terminate();
    run?.giveUp?.();
    run?.over?.abort();
    run?.context?.close().catch(() => {}); // the page may have closed it
    if (this.isSpeaking) this.tell("cancelled");
    this.reset();
  }

  close() {
    this.stop();
    this.onweights = null;
  }
}

function checkedWord(word) {
  const { text, start } = word ?? {};
  const end = word?.end ?? undefined; // in JSON, what is not known is null
  const isEnd = end === undefined || (Number.isFinite(end) && end >= start);
  if (typeof text === "string" && Number.isFinite(start) && start >= 0 && isEnd) return { text, start, end };
  throw new TypeError(`say: got ${JSON.stringify(word)}, expected a word { text, start, end } with times in s`);
}

const nameOf = (value) => value?.constructor?.name ?? String(value);

function checkTimes(method, { delay, lookAhead }) {
  if (!(delay >= 0 && delay <= MOST_DELAY_S)) throw new TypeError(`${method}: got a delay of ${delay}, expected 0 to ${MOST_DELAY_S} s`);
  if (!(lookAhead >= 0 && lookAhead < Infinity)) throw new TypeError(`${method}: got lookAhead ${lookAhead}, expected s, 0 or more`);
}

// Time of the context that is heard now, s; while it is suspended, it stands still.
function heardBy(context) {
  const stamp = context.getOutputTimestamp?.();
  if (stamp?.performanceTime) {
    return Math.min(stamp.contextTime + (performance.now() - stamp.performanceTime) / 1000, context.currentTime);
  }
  return context.currentTime - (context.outputLatency ?? 0);
}

function disconnect({ source, element, tap, delayed }) {
  for (const node of [tap, delayed]) {
    try {
      source.disconnect(node);
    } catch {
      // the page has disconnected it
    }
  }
  if (element) element.srcObject = null;
}

const end = (stream) => stream.getTracks().forEach((track) => track.stop());

// Chromium gives the sound of a remote track only where an element plays it, too.
function playUnheard(stream) {
  const element = new Audio();
  element.muted = true;
  element.srcObject = stream;
  element.play().catch(() => {});
  return element;
}
