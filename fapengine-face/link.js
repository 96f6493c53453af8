// The WebSocket: comes back by itself after the server went away, later and later up to three seconds.

import { packSound, parseFrame } from "./wire.js";

const FIRST_WAIT_MS = 250;
const MAX_WAIT_MS = 3000;
const PING_EVERY_MS = 1000;
const SILENCE_MS = 4000;
const MAX_UNSENT = 1 << 16; // bytes of a line that is too slow for sound

export class Link {
  // on: { state(name), refused(why), message(object), frame(frame, arrival), pong(sent, server, received) }; times in s.
  // watched(): whether frames are wanted; a page that nobody sees is sent none, and asks for the time no more.
  constructor(url, on, watched = () => !document.hidden) {
    this.url = url;
    this.on = on;
    this.watched = watched;
    this.wait = FIRST_WAIT_MS;
    this.pings = new Map();
    this.number = 0;
    this.end = new AbortController();
    const { signal } = this.end;
    window.addEventListener("online", () => this.hurry(), { signal });
    document.addEventListener("visibilitychange", () => this.watch(), { signal });
    this.pinging = setInterval(() => this.ping(), PING_EVERY_MS);
    this.connect();
  }

  close() {
    this.end.abort();
    clearInterval(this.pinging);
    clearTimeout(this.timer);
    const { socket } = this;
    this.socket = null;
    socket?.close();
  }

  get isOpen() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  connect() {
    clearTimeout(this.timer);
    this.on.state("connecting");
    this.heard = performance.now();
    this.isWatched = true; // the server takes it so at first
    const socket = (this.socket = new WebSocket(this.url));
    socket.binaryType = "arraybuffer";
    socket.onmessage = ({ data }) => {
      if (socket === this.socket) this.receive(data);
    };
    socket.onclose = () => {
      if (socket === this.socket) this.lost();
    };
  }

  receive(data) {
    const now = performance.now();
    this.heard = now;
    if (data instanceof ArrayBuffer) {
      const frame = parseFrame(data);
      if (frame) this.on.frame(frame, now / 1000);
      return;
    }
    const message = JSON.parse(data);
    if (message.type === "pong") {
      const sent = this.pings.get(message.number);
      if (sent !== undefined) this.on.pong(sent, message.time_s, now / 1000);
      this.pings.clear();
      return;
    }
    if (message.type === "hello") {
      this.wait = FIRST_WAIT_MS;
      this.on.state("connected");
      this.on.message(message);
      this.watch();
      this.ping();
      return;
    }
    this.on.message(message);
  }

  lost() {
    this.pings.clear();
    this.on.state("waiting");
    this.ask();
    this.timer = setTimeout(() => this.connect(), this.wait * (0.75 + 0.5 * Math.random()));
    this.wait = Math.min(this.wait * 1.7, MAX_WAIT_MS);
  }

  // A WebSocket is not told why it was refused; plain HTTP is.
  async ask() {
    try {
      const answer = await fetch(this.url.replace(/^ws/, "http"));
      this.on.refused([400, 403].includes(answer.status) ? await answer.text() : "");
    } catch {
      this.on.refused(""); // nobody there
    }
  }

  hurry() {
    if (this.socket?.readyState === WebSocket.CLOSED) {
      this.wait = FIRST_WAIT_MS;
      this.connect();
    }
  }

  // Says whether frames are wanted, when that has changed.
  watch() {
    const wanted = this.watched();
    if (wanted) this.hurry();
    if (wanted === this.isWatched || !this.send("watch", { on: wanted })) return;
    this.isWatched = wanted;
    this.heard = performance.now(); // it was silent because it was told to be
    if (wanted) this.ping();
  }

  ping() {
    if (!this.isOpen) return;
    this.watch();
    if (!this.isWatched) return;
    if (performance.now() - this.heard > SILENCE_MS) {
      const silent = this.socket; // the cable is out: nobody says goodbye
      this.socket = null;
      silent.close();
      this.connect();
      return;
    }
    this.pings.set(++this.number, performance.now() / 1000);
    this.send("ping", { number: this.number });
  }

  // Sound, as an Int16Array; left out where the line does not keep up.
  sendSound(rate, samples) {
    if (!this.isOpen || this.socket.bufferedAmount > MAX_UNSENT) return false;
    this.socket.send(packSound(rate, samples));
    return true;
  }

  // Returns whether it could be sent.
  send(type, fields = {}) {
    if (!this.isOpen) return false;
    this.socket.send(JSON.stringify({ type, ...fields }));
    return true;
  }
}
