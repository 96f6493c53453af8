// <fap-face>: a face in anybody's page. README.md tells its attributes, methods and events.

import { Channel } from "./channel.js";
import { parseHead } from "./head.js";
import { Picture } from "./picture.js";
import { Player, parseFap } from "./player.js";
import { Session } from "./session.js";
import { Steering } from "./steering.js";

const EVENTS = ["started", "phone", "finished", "cancelled", "lost", "regained", "connection"];
const ASSETS = {
  // Spelled out, because that is how bundlers find them.
  "head.bin": new URL("./assets/head.bin", import.meta.url),
  "setup.json": new URL("./assets/setup.json", import.meta.url),
};
const SHAPE = `
  :host { display: block; aspect-ratio: 1; min-width: 0; position: relative; }
  :host([hidden]) { display: none; }
  canvas { position: absolute; inset: 0; width: 100%; height: 100%; display: block; touch-action: none; }
`;
const AWAY = "fap-face: it was taken away, or begun again, meanwhile";
let sheet = null; // that all elements share; made by the first

async function fetched(url, read) {
  const answer = await fetch(url);
  if (!answer.ok) throw new Error(`${url}: got ${answer.status} ${(await answer.text()).slice(0, 200)}`);
  return answer[read]();
}

// On a server that renders pages there is no DOM: there the module can be imported, and no more.
export class FapFace extends (globalThis.HTMLElement ?? Object) {
  static observedAttributes = ["server", "session", "head", "setup", "token", "src", "audio", "camera", "transparent", "edges", "rest"];

  constructor() {
    super();
    if (!sheet) (sheet = new CSSStyleSheet()).replaceSync(SHAPE); // not a <style>, which a content security policy may refuse
    this.attachShadow({ mode: "open" }).adoptedStyleSheets = [sheet];
    this.run = 0; // counts beginnings: what an older one fetched is not shown any more
    this.source = null;
    this.muted = false;
    this.cancels = this.removals = 0;
  }

  connectedCallback() {
    this.restart();
  }

  disconnectedCallback() {
    this.removals += 1;
    this.stop();
    this.beginning = null;
  }

  attributeChangedCallback(name, before, now) {
    if (before === now || !this.isConnected) return;
    if (name === "camera") this.steering?.fly(now);
    else this.restart();
  }

  // Resolves when the face is there; rejects with what is wrong.
  get ready() {
    return this.beginning ?? Promise.reject(new Error("fap-face: not in a document"));
  }

  // The 68 FAPs that are shown now, FAPU.
  get faps() {
    return this.picture?.faps ?? new Float32Array(68);
  }

  // Several attributes that change together begin one run.
  restart() {
    this.stop();
    const run = this.run;
    this.beginning = Promise.resolve().then(() => (run === this.run ? this.begin(run) : this.ready));
    this.beginning.catch((error) => run === this.run && this.tell("error", error.message));
  }

  stop() {
    this.run += 1;
    this.picture?.close();
    this.source?.close?.();
    this.picture = this.source = this.steering = this.living = null;
    this.shadowRoot.querySelector("canvas")?.remove();
  }

  // Of the server, if there is one; else as the package has them.
  own(path) {
    const server = this.getAttribute("server");
    const url = server ? new URL(path, new URL(server, document.baseURI)) : new URL(ASSETS[path]);
    const token = this.getAttribute("token");
    if (server && token) url.searchParams.set("token", token);
    return url;
  }

  setupAddress() {
    const given = this.getAttribute("setup");
    return given ? new URL(given, document.baseURI) : this.own("setup.json");
  }

  headAddress() {
    const name = this.getAttribute("head");
    if (!name) return this.own("head.bin");
    if (!this.hasAttribute("server") || /[/.]/.test(name)) return new URL(name, document.baseURI);
    const url = this.own("head.bin");
    url.searchParams.set("name", name);
    return url;
  }

  async begin(run) {
    const src = this.getAttribute("src");
    const [setup, bytes, text] = await Promise.all([
      fetched(this.setupAddress(), "json"),
      fetched(this.headAddress(), "arrayBuffer"),
      src ? fetched(new URL(src, document.baseURI), "text") : null,
    ]);
    if (run !== this.run) return this.ready;
    this.source = this.makeSource(text);
    this.follow(this.source);
    this.source.addEventListener?.("message", ({ detail }) => detail.type === "error" && this.tell("error", detail.message));
    this.source.addEventListener?.("refused", ({ detail }) => detail && this.tell("error", detail));
    this.steering = new Steering(setup.cameras);
    const camera = this.getAttribute("camera");
    if (camera) this.steering.fly(camera, { atOnce: true });
    const canvas = document.createElement("canvas");
    canvas.setAttribute("part", "canvas");
    if (!this.hasAttribute("role")) this.setAttribute("role", "img");
    if (!this.hasAttribute("aria-label")) this.setAttribute("aria-label", "A talking face");
    this.shadowRoot.append(canvas);
    this.steering.listen(canvas);
    this.picture = new Picture(canvas, setup, parseHead(bytes), (now, faps) => this.source.sample(now, faps), this.steering, {
      wall: this.hasAttribute("transparent") ? null : setup.wall,
      edges: this.getAttribute("edges"),
      rest: this.getAttribute("rest"),
      isBusy: () => this.source.isSpeaking,
      shown: () => this.tell("picture"),
    });
    for (const type of ["contextlost", "contextrestored"]) {
      canvas.addEventListener(`webgl${type}`, () => run === this.run && this.tell(type)); // not the end of a closed picture
    }
    if (this.picture.trouble) this.tell("error", this.picture.trouble);
    this.tell("ready");
  }

  follow(source) {
    for (const type of EVENTS) source.addEventListener?.(type, ({ detail }) => this.tell(type, detail));
  }

  makeSource(text) {
    if (text !== null) return new Player(parseFap(text), this.hasAttribute("audio") ? new URL(this.getAttribute("audio"), document.baseURI) : null);
    if (!this.hasAttribute("server")) return new Channel();
    return new Session({
      server: new URL(this.getAttribute("server"), document.baseURI),
      session: this.getAttribute("session") ?? "face",
      token: this.getAttribute("token"),
    });
  }

  tell(type, detail) {
    this.dispatchEvent(new CustomEvent(type, { detail }));
  }

  // The source, if it is a server's session; says so otherwise.
  serverSession(method) {
    if (this.source instanceof Session) return this.source;
    if (!this.hasAttribute("server")) throw new Error(`fap-face: ${method} needs the attribute server`);
    throw new Error(`fap-face: ${method} needs a server that is there; wait for the event "ready"`);
  }

  // The source that needs no server (live/live.js), for an element without server and src; it is fetched at the first call.
  async local(method) {
    const { removals } = this;
    await this.ready;
    if (!this.source || removals !== this.removals) throw new Error(AWAY);
    if (this.hasAttribute("server") || this.hasAttribute("src")) throw new Error(`fap-face: ${method} needs an element without server and src`);
    if (!this.living) {
      const living = (this.living = this.live(this.run));
      living.catch(() => this.living === living && (this.living = null)); // the next call tries again
    }
    return this.living;
  }

  async live(run) {
    const { Live } = await import("./live/index.js");
    const liveliness = Number(this.getAttribute("liveliness") ?? 1);
    const live = await Live.make({ still: this.hasAttribute("still"), liveliness });
    if (run !== this.run) throw new Error(AWAY);
    this.source.close();
    this.follow((this.source = live));
    live.addEventListener("error", ({ detail }) => this.tell("error", detail));
    return live;
  }

  // Follows sound without a server: a MediaStream, an AudioNode, or { audio } of a device, see Live. Resolves to the delayed
  // sound, an AudioNode, for whoever shall hear it.
  async hear(input, options = {}) {
    return (await this.local("hear")).hear(input, options);
  }

  // A text: the server's voice says it, and this page plays it, unless it is muted or may not; resolves to whether it was
  // sent. Without a server, phones, { label, start, end }, a text, or words, { text, start, end? }: see Live.
  async say(text, options = {}) {
    if (Array.isArray(text) || !this.hasAttribute("server")) {
      const { cancels } = this;
      const live = await this.local("say");
      return cancels === this.cancels ? live.say(text, options) : null; // else it was ended before it began
    }
    const session = this.serverSession("say");
    await this.sound(session);
    return session.say(text, options);
  }

  async sound(session) {
    if (this.muted || session.heardElsewhere || session.sound.on) return;
    await session.play(true);
  }

  // Sound that somebody speaks, as an Int16Array, mono: it is played 0.25 s later, when the face says it.
  push(samples, rate) {
    return this.serverSession("push").push(samples, rate);
  }

  // Words with times, or phones; fields as of the server's messages of these names.
  words(words, fields = {}) {
    return this.serverSession("words").send("words", { words, ...fields });
  }

  phones(phones, fields = {}) {
    return this.serverSession("phones").send("phones", { phones, ...fields });
  }

  express(name, level = 1, fields = {}) {
    if (!this.hasAttribute("server")) return this.local("express").then((live) => live.express(name, level, fields));
    return this.serverSession("express").express(name, level, fields);
  }

  look(yaw, pitch) {
    return this.serverSession("look").look(yaw, pitch);
  }

  cancel() {
    this.cancels += 1;
    if (this.source instanceof Player) this.source.pause();
    else if (this.hasAttribute("server")) this.serverSession("cancel").cancel();
    else this.living?.then((live) => live.cancel(), () => {}); // who began it is told why it failed
  }

  // Of a file.
  play() {
    return this.source instanceof Player ? this.source.play() : Promise.reject(new Error("fap-face: play needs src"));
  }

  pause() {
    if (this.source instanceof Player) this.source.pause();
    else this.serverSession("pause").pause(true);
  }

  // One frame of FAPs, 288 bytes, where the element has neither server nor src.
  feed(data) {
    return this.channel("feed").push(data);
  }

  // All frames of an RTCDataChannel or a WebSocket.
  listen(target) {
    this.channel("listen").listen(target);
  }

  channel(method) {
    if (this.source instanceof Channel) return this.source;
    if (this.living) throw new Error(`fap-face: ${method} needs an element that neither hears nor says; use another one`);
    throw new Error(`fap-face: ${method} needs an element without server and src; wait for the event "ready"`);
  }
}

if (globalThis.customElements && !customElements.get("fap-face")) customElements.define("fap-face", FapFace);
