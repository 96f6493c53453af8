// The page: fetches the head, opens the link, draws whatever comes, and passes on what is done here.

import { FaceView } from "./face.js";
import { between, turned, zoomed } from "./camera.js";
import { parseHead } from "./head.js";
import { Link } from "./link.js";
import { Microphone } from "./microphone.js";
import { Panel } from "./panel.js";
import { Sound } from "./sound.js";
import { Ticker } from "./ticker.js";
import { JitterBuffer, PixelBudget, FadeOut, ServerClock } from "./time.js";

const MAX_PIXELS = 2_600_000;
const FLIGHT_MS = 450;
const LOOK_EVERY_MS = 80;
const LAGS = 90;
const CONNECTIONS = { connected: "connected", connecting: "connecting …", waiting: "server is away, looking for it …" };

const byId = (id) => document.getElementById(id);
const query = new URLSearchParams(location.search);
const token = query.get("token") ?? sessionStorage.getItem("token");
if (token) sessionStorage.setItem("token", token);
const calm = matchMedia("(prefers-reduced-motion: reduce)");

function fail(error) {
  byId("notice").textContent = error.message;
  byId("notice").hidden = false;
  console.error(error);
}

async function fetched(path, read) {
  const answer = await fetch(address(path));
  if (!answer.ok) throw new Error(`${path}: the server answered ${answer.status} ${await answer.text()}`);
  return answer[read]();
}

function address(path, scheme = location.protocol) {
  const url = new URL(path, location.href);
  url.protocol = scheme;
  if (token) url.searchParams.set("token", token);
  return url;
}

class Page {
  constructor(setup, head) {
    const canvas = byId("face");
    this.setup = setup;
    this.view = new FaceView(canvas, head, setup, setup.wall);
    this.clock = new ServerClock();
    this.jitterBuffer = new JitterBuffer(60);
    this.fadeOut = new FadeOut();
    this.budget = new PixelBudget(!this.view.frugal);
    this.ticker = new Ticker(byId("ticker"));
    this.panel = new Panel(setup, (type, fields) => this.link.send(type, fields));
    this.sound = new Sound((where) => this.report(where));
    this.microphone = new Microphone((rate, samples) => this.link.sendSound(rate, samples));
    this.heardElsewhere = false; // the server plays the sound
    this.paused = false;
    this.faps = new Float32Array(68);
    this.fps = { since: performance.now(), count: 0, last: 0 };
    this.lags = [];
    this.cameras(setup.cameras);
    this.turnByHand(canvas);
    this.speaking();
    this.keys();
    new ResizeObserver(() => (this.resized = true)).observe(canvas);
    this.resized = true;
    const url = address("/ws", location.protocol === "https:" ? "wss:" : "ws:");
    url.searchParams.set("session", query.get("session") ?? "face");
    this.link = new Link(url.href, {
      state: (name) => this.connection(name),
      refused: (why) => this.refused(why),
      message: (message) => this.message(message),
      frame: (frame, arrival) => this.jitterBuffer.push(frame, arrival),
      pong: (sent, server, received) => this.clock.add(sent, server, received),
    });
    requestAnimationFrame((now) => this.draw(now));
  }

  // Pictures

  draw(now) {
    requestAnimationFrame((next) => this.draw(next));
    const here = performance.now() / 1000;
    const shown = this.jitterBuffer.sample(here, this.faps);
    const share = this.fadeOut.at(here, shown ? here - this.jitterBuffer.arrived : Infinity);
    if (share < 1) for (let column = 0; column < 68; ++column) this.faps[column] *= share;
    this.size(now);
    this.view.draw(this.faps, this.seen(now));
    if (!shown) return;
    const phone = this.ticker.show(shown.time);
    byId("ticker").classList.toggle("speaking", this.ticker.current !== null);
    this.write("phone", phone || "–");
    this.panel.follow(this.faps, now);
    if (this.clock.known) {
      this.lags.push(this.clock.at(here) - shown.time);
      if (this.lags.length > LAGS) this.lags.shift();
    }
    this.count(now);
  }

  size(now) {
    if (this.fps.last && this.budget.add((now - this.fps.last) / 1000)) this.resized = true;
    this.fps.last = now;
    if (!this.resized) return;
    this.resized = false;
    const { clientWidth: width, clientHeight: height } = this.view.canvas;
    const dense = Math.min(devicePixelRatio, 2, Math.sqrt(MAX_PIXELS / Math.max(width * height, 1))) * this.budget.scale;
    const [across, down] = [width, height].map((side) => Math.max(1, Math.round(side * dense)));
    this.view.resize(across, down, this.wantsFineEdges);
  }

  // Where a graphics card draws and holds the rate; ?edges=fine or soft decides otherwise.
  get wantsFineEdges() {
    const wanted = query.get("edges");
    return wanted ? wanted === "fine" : this.budget.fine;
  }

  // From the server's clock to the screen, s: the middle one of the last pictures, for single ones are held up.
  get lag() {
    return this.lags.length ? Float64Array.from(this.lags).sort()[this.lags.length >> 1] : 0;
  }

  count(now) {
    this.fps.count += 1;
    const passed = now - this.fps.since;
    if (passed < 500) return;
    const reduced = this.budget.scale < 1 ? ` at ${Math.round(100 * this.budget.scale)} %` : "";
    this.write("fps", `${Math.round((1000 * this.fps.count) / passed)}${reduced}`);
    this.write("latency", this.clock.known ? `${Math.max(0, Math.round(1000 * this.lag))} ms` : "–");
    this.fps.since = now;
    this.fps.count = 0;
  }

  write(id, text) {
    const element = byId(id);
    if (element.textContent !== text) element.textContent = text;
  }

  // Camera

  cameras(presets) {
    this.presets = Object.entries(presets);
    this.presets.forEach(([name], index) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = name[0].toUpperCase() + name.slice(1).replaceAll("-", " ");
      button.title = `${button.textContent} (${index + 1})`;
      button.addEventListener("click", () => this.fly(index));
      byId("views").append(button);
    });
    this.camera = this.presets[0][1];
    this.mark(0);
  }

  fly(index) {
    if (!this.presets[index]) return;
    this.flight = calm.matches ? null : { from: this.camera, to: this.presets[index][1], since: performance.now() };
    if (!this.flight) this.camera = this.presets[index][1];
    this.mark(index);
  }

  mark(index) {
    [...byId("views").children].forEach((button, place) => button.setAttribute("aria-pressed", place === index));
  }

  seen(now) {
    if (this.flight) {
      const share = Math.min(Math.max((now - this.flight.since) / FLIGHT_MS, 0), 1);
      this.camera = between(this.flight.from, this.flight.to, share * share * (3 - 2 * share));
      if (share === 1) this.flight = null;
    }
    return this.camera;
  }

  move(camera) {
    this.flight = null;
    this.camera = camera;
    this.mark(-1);
  }

  turnByHand(canvas) {
    const pointers = new Map();
    const spread = () => {
      const [a, b] = [...pointers.values()];
      return Math.hypot(a.x - b.x, a.y - b.y);
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    });
    canvas.addEventListener("pointermove", (event) => {
      this.lookAt(event);
      const last = pointers.get(event.pointerId);
      if (!last) return;
      const before = pointers.size === 2 ? spread() : 0;
      pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      if (before) this.move(zoomed(this.camera, before / Math.max(spread(), 1)));
      else this.move(turned(this.camera, (last.x - event.clientX) * 0.35, (event.clientY - last.y) * 0.25));
    });
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
    }
    canvas.addEventListener("dblclick", () => this.fly(0));
    const nearer = (event) => {
      event.preventDefault();
      this.move(zoomed(this.camera, Math.exp(Math.min(Math.max(event.deltaY, -200), 200) * 0.0012)));
    };
    canvas.addEventListener("wheel", nearer, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const turns = { ArrowLeft: [-6, 0], ArrowRight: [6, 0], ArrowUp: [0, 4], ArrowDown: [0, -4] };
      if (turns[event.key]) this.move(turned(this.camera, ...turns[event.key]));
      else if (event.key === "+" || event.key === "=") this.move(zoomed(this.camera, 0.92));
      else if (event.key === "-") this.move(zoomed(this.camera, 1 / 0.92));
      else return;
      event.preventDefault();
    });
  }

  lookAt({ clientX, clientY }) {
    const now = performance.now();
    if (!byId("follow").checked || now - (this.looked ?? 0) < LOOK_EVERY_MS) return;
    this.looked = now;
    const { left, top, width, height } = this.view.canvas.getBoundingClientRect();
    const angle = (name, slope) => {
      const { low, high } = this.setup.ranges.look[name];
      return Math.min(Math.max(Math.atan(slope), low), high);
    };
    const yaw = angle("yaw", (1.1 * (clientX - left - width / 2)) / height);
    const pitch = angle("pitch", (0.8 * (clientY - top - 0.45 * height)) / height);
    this.link.send("look", { yaw, pitch });
  }

  // Speech

  speaking() {
    for (const [code, name] of Object.entries(this.setup.voices)) byId("voice").add(new Option(`${code}  ${name}`, code));
    byId("speak").addEventListener("submit", (event) => {
      event.preventDefault();
      this.say(byId("text").value.trim());
    });
    byId("stop").addEventListener("click", () => this.hush());
    byId("sound").addEventListener("click", () => this.setSound(!this.sound.on));
    byId("microphone").addEventListener("click", () => this.setMicrophone(!this.microphone.on));
  }

  async say(text) {
    if (!text) {
      byId("text").focus();
      return;
    }
    const voice = byId("voice").value;
    this.pause(false);
    if (!this.hasChosenSilence && !this.heardElsewhere && !this.sound.on) await this.setSound(true);
    if (this.link.send("say", voice ? { text, voice } : { text })) {
      byId("text").select();
      this.told("");
    } else {
      this.told("The server is away; it will be looked for again.", true);
    }
  }

  async setSound(wanted) {
    if (this.heardElsewhere) return;
    this.hasChosenSilence = !wanted;
    const on = wanted ? await this.sound.enable() : (await this.sound.disable(), false);
    this.showSound(on);
    this.link.send("plays", { on });
    if (wanted && !on) this.told("This browser has no sound to play on; the face speaks silently.");
  }

  showSound(on) {
    const button = byId("sound");
    button.disabled = this.heardElsewhere;
    button.setAttribute("aria-pressed", on);
    button.textContent = this.heardElsewhere ? "At server" : on ? "Sound on" : "Sound off";
    button.title = this.heardElsewhere ? "The server plays the sound, on its machine" : "Sound on this page (M)";
  }

  async setMicrophone(wanted) {
    try {
      if (wanted) await this.microphone.enable();
      else this.microphone.disable();
      this.told(wanted ? "The face says what you say, half a second later." : "");
    } catch (error) {
      this.microphone.disable();
      this.told(error.name === "NotAllowedError" ? "The microphone was not allowed." : error.message, true);
    }
    this.showMicrophone();
  }

  showMicrophone() {
    const { on } = this.microphone;
    byId("microphone").setAttribute("aria-pressed", on);
    byId("microphone").textContent = on ? "Mic on" : "Mic off";
  }

  hush() {
    this.link.send("cancel");
    this.sound.stop(null);
    this.pause(false);
  }

  // Face and sound stand still together, and go on together.
  pause(wanted) {
    if (wanted === this.paused) return;
    this.link.send(wanted ? "pause" : "resume");
    this.stand(wanted);
  }

  stand(still) {
    if (still === this.paused) return;
    this.paused = still;
    this.sound.hold(still);
    this.told(still ? "Paused; Space goes on." : "");
  }

  // Where the sound is, in the server's time. The face shows frames some time after they were made: it is told to be
  // ahead by just that, so that both meet here.
  report({ utterance, position, rate }) {
    if (!this.clock.known) return;
    const at = this.clock.at(performance.now() / 1000);
    this.link.send("audio", { utterance, at_s: at, position_s: position + Math.max(0, this.lag), rate });
  }

  told(text, wrong = false) {
    byId("said").textContent = text;
    byId("said").classList.toggle("wrong", wrong);
  }

  // The server

  connection(name) {
    document.body.dataset.connection = name;
    this.write("connection", CONNECTIONS[name]);
    if (name === "connected") {
      this.refused("");
    } else {
      this.ticker.clear();
      this.sound.stop(null); // nobody moves the lips any more
    }
  }

  refused(why) {
    byId("notice").textContent = why;
    byId("notice").hidden = !why;
  }

  message(message) {
    const { utterance } = message;
    switch (message.type) {
      case "hello":
        this.hello(message);
        break;
      case "begin":
        this.ticker.begin(utterance);
        break;
      case "phones":
        this.ticker.phones(utterance, message.first, message.phones);
        break;
      case "position":
        this.ticker.position(utterance, message.position_s, message.time_s);
        break;
      case "cancel":
        this.sound.stop(utterance);
        break;
      case "event":
        if (message.kind === "finished" || message.kind === "cancelled") this.ticker.over(utterance);
        break;
      case "sound":
        this.told(message.text);
        if (this.sound.on && message.url) this.sound.play(utterance, address(message.url));
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
      case "error":
        this.told(message.message, true);
        break;
    }
  }

  hello({ session, rate_hz, profile, voice, ear, sound, paused }) {
    byId("microphone").hidden = !ear;
    this.write("session", session);
    byId("session").title = `Session ${session}, profile ${profile}`;
    this.clock = new ServerClock();
    this.lags = [];
    this.panel.rest(); // what is set is told next
    this.stand(paused);
    this.jitterBuffer = new JitterBuffer(rate_hz);
    for (const id of ["text", "say", "voice"]) byId(id).disabled = !voice;
    byId("text").placeholder = voice ? "Type a sentence and press Enter" : "The server has no voice; phones come by OSC";
    this.heardElsewhere = sound === "server";
    const on = this.sound.on && !this.heardElsewhere;
    this.showSound(on);
    if (on) this.link.send("plays", { on });
  }

  keys() {
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape") this.hush();
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.target.matches("[type=text], [type=search], select")) return;
      if (event.key === " " && event.target.matches("button, summary, [type=checkbox]")) return; // it means these
      const key = event.key.toLowerCase();
      if (key === "/") byId("text").focus();
      else if (key === "m") this.setSound(!this.sound.on);
      else if (key === "b") this.link.send("blink");
      else if (key === " ") this.pause(!this.paused);
      else if (key >= "1" && key <= "9") this.fly(Number(key) - 1);
      else return;
      event.preventDefault();
    });
  }
}

try {
  const [setup, head] = await Promise.all([fetched("/setup.json", "json"), fetched("/head.bin", "arrayBuffer")]);
  window.page = new Page(setup, parseHead(head)); // for the console
} catch (error) {
  fail(error);
}
