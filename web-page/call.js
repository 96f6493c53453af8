// A call: the face by WHEP, the microphone by WHIP. Session and token are those of the address.

const query = new URLSearchParams(location.search);
const session = query.get("session") ?? "face";
const token = query.get("token") ?? sessionStorage.getItem("token");
if (query.has("token")) {
  sessionStorage.setItem("token", token);
  query.delete("token"); // it is kept for this tab, and not shown
  history.replaceState(null, "", `${location.pathname}${query.size ? `?${query}` : ""}`);
}

const one = (id) => document.getElementById(id);
const [face, callButton, microphoneButton, soundButton] = ["face", "call", "microphone", "sound"].map(one);
one("session").textContent = session;

const GATHER_MS = 2000;
const LOOK_MS = 1000;
const SILENT_MS = 1500; // a server sends sound at any time: without it, it is gone
const CONNECT_MS = 15000; // until the first sound
const POST_MS = 10000;
const DELETE_MS = 2000;
const [FIRST_WAIT_MS, MAX_WAIT_MS] = [250, 3000];

const tell = (text) => (one("state").textContent = text);
function complain(text) {
  one("trouble").textContent = text;
  one("trouble").hidden = !text;
}

// What is not better a second later: no calls there, no permission, a wrong offer.
class Refused extends Error {}

// One offer to the server and its answer.
class Call {
  constructor(path, on) {
    this.path = path;
    this.on = on; // { lost(why): once, if the call ends by itself; pictures(): while pictures come }
    this.peer = new RTCPeerConnection({ iceServers: [] });
    this.peer.onconnectionstatechange = () => this.peer.connectionState === "failed" && this.fail();
  }

  async begin() {
    await this.peer.setLocalDescription();
    await this.gathered();
    const response = await this.ask("POST", `${this.path}?${new URLSearchParams({ session })}`, POST_MS, {
      body: this.peer.localDescription.sdp,
      headers: { "Content-Type": "application/sdp" },
    });
    const text = await response.text();
    if (response.status === 404) throw new Refused("Calls are not enabled on this server: start it with fapengine serve --webrtc.");
    if (response.status !== 201) throw new (response.status < 500 ? Refused : Error)(text || `The server answered ${response.status}.`);
    this.place = response.headers.get("Location");
    if (this.over) return this.end(); // hung up meanwhile
    await this.peer.setRemoteDescription({ type: "answer", sdp: text });
    this.count = 0;
    this.moved = performance.now();
    this.watch = setInterval(() => this.look(), LOOK_MS);
  }

  // All addresses at once, for the server takes no later ones; it needs none of them to answer, so this may give up.
  gathered() {
    return new Promise((done) => {
      if (this.peer.iceGatheringState === "complete") return done();
      this.peer.addEventListener("icegatheringstatechange", () => this.peer.iceGatheringState === "complete" && done());
      setTimeout(done, GATHER_MS);
    });
  }

  ask(method, url, limit, more = {}) {
    const headers = { ...more.headers, ...(token ? { Authorization: `Bearer ${token}` } : {}) };
    const signal = AbortSignal.timeout(limit);
    return fetch(url, { ...more, method, headers, signal, keepalive: method === "DELETE" }).catch(() => {
      throw new Error("The server does not answer.");
    });
  }

  // Once a second: a server that is killed says no goodbye, and the browser waits long for one.
  async look() {
    if (["disconnected", "closed"].includes(this.peer.connectionState)) return this.fail();
    if (this.path !== "whep") return; // nothing comes
    let [count, pictures] = [0, 0];
    for (const one of (await this.peer.getStats()).values()) {
      if (one.type !== "inbound-rtp") continue;
      pictures += one.framesDecoded ?? 0;
      count += one.packetsReceived ?? 0;
    }
    const now = performance.now();
    if (count !== this.count) {
      if (pictures) this.on.pictures();
      this.moved = now;
    } else if (now - this.moved > (count ? SILENT_MS : CONNECT_MS)) return this.fail();
    this.count = count;
  }

  async fail() {
    if (this.over) return;
    const reason = await this.end().catch((error) => error.message);
    this.on.lost(reason || "The connection was lost.");
  }

  // Hangs up. Resolves to why the call was over before, if it was.
  async end() {
    this.over = true;
    clearInterval(this.watch);
    try {
      if (!this.place) return "";
      const response = await this.ask("DELETE", this.place, DELETE_MS);
      return response.status === 410 ? await response.text() : "";
    } finally {
      this.peer.close(); // not before: the server would see the connection end, and count it as lost
    }
  }
}

// Calls until it is ended: where a call is lost it calls again, later and later up to three seconds.
class Line {
  constructor(path, prepare, on) {
    this.path = path;
    this.prepare = prepare; // adds media to a peer
    this.on = on; // { lost(why), answered(), over(why) }
    this.wait = FIRST_WAIT_MS;
  }

  // The first call: throws if it cannot be made.
  async dial() {
    const on = { lost: (why) => this.lost(why), pictures: () => (this.wait = FIRST_WAIT_MS) };
    this.call = new Call(this.path, on);
    try {
      this.prepare(this.call.peer);
      await this.call.begin();
    } catch (error) {
      await this.call.end().catch(() => "");
      throw error;
    }
    if (!this.over) this.on.answered();
  }

  lost(why) {
    if (this.over) return;
    this.on.lost(why);
    this.timer = setTimeout(() => this.again(), this.wait * (0.75 + 0.5 * Math.random()));
    this.wait = Math.min(this.wait * 1.7, MAX_WAIT_MS);
  }

  again() {
    return this.dial().catch((error) => {
      if (this.over) return;
      if (error instanceof Refused) this.on.over(error.message);
      else this.lost(error.message);
    });
  }

  end() {
    this.over = true;
    clearTimeout(this.timer);
    return this.call.over ? "" : this.call.end().catch(() => "");
  }
}

let watching = null;
let speaking = null;
let stream = null;

function show() {
  callButton.textContent = watching ? "Hang up" : "Call";
  microphoneButton.textContent = speaking ? "Microphone on" : "Microphone off";
  microphoneButton.setAttribute("aria-pressed", String(Boolean(speaking)));
  soundButton.textContent = face.muted ? "Sound off" : "Sound on";
  soundButton.setAttribute("aria-pressed", String(!face.muted));
  document.body.dataset.watching = String(Boolean(watching));
  document.body.dataset.speaking = String(Boolean(speaking));
}

function receive(peer) {
  peer.addTransceiver("video", { direction: "recvonly" });
  peer.addTransceiver("audio", { direction: "recvonly" });
  const media = new MediaStream();
  peer.ontrack = ({ track }) => {
    media.addTrack(track);
    track.onunmute = () => play(media); // until media comes, the last picture of the call before stays
    if (!track.muted) play(media);
  };
}

function play(media) {
  if (!watching || face.srcObject === media) return;
  face.srcObject = media;
  face.play().catch(({ name }) => {
    if (name !== "NotAllowedError") return; // another call came meanwhile
    face.muted = true; // a browser that wants a click first
    face.play();
    show();
  });
}

async function call() {
  complain("");
  tell("Calling …");
  const own = (watching = new Line("whep", receive, {
    lost: (why) => {
      tell("The connection was lost; calling again …");
      complain(why);
    },
    answered: () => {
      tell("Answered; the face is being drawn.");
      complain("");
    },
    over: hangUp,
  }));
  show();
  face.onplaying = () => watching && tell("You see the face.");
  try {
    await own.dial();
  } catch (error) {
    if (watching === own) await hangUp(error.message);
  }
}

async function hangUp(reason = "") {
  const own = watching;
  watching = null;
  face.srcObject = null;
  show();
  tell("Not connected.");
  complain(reason);
  await own?.end();
}

async function speak() {
  complain("");
  if (!navigator.mediaDevices?.getUserMedia) {
    complain("A browser gives its microphone only to https and to this very machine.");
    return;
  }
  microphoneButton.disabled = true;
  try {
    stream = await navigator.mediaDevices.getUserMedia({ audio: { channelCount: 1, echoCancellation: true, noiseSuppression: true } });
    const send = (peer) => {
      for (const track of stream.getAudioTracks()) peer.addTransceiver(track, { direction: "sendonly", streams: [stream] });
    };
    const own = (speaking = new Line("whip", send, { lost: complain, answered: () => complain(""), over: silence }));
    for (const track of stream.getAudioTracks()) track.onended = () => speaking === own && silence("The microphone was disconnected.");
    await own.dial();
    face.muted = true; // or you would hear yourself
  } catch (error) {
    const refused = error.name === "NotAllowedError" ? "The microphone was not allowed." : null;
    const missing = error.name === "NotFoundError" ? "There is no microphone." : null;
    await silence(refused ?? missing ?? error.message);
  } finally {
    microphoneButton.disabled = false;
    show();
  }
}

async function silence(reason = "") {
  const own = speaking;
  speaking = null;
  for (const track of stream?.getTracks() ?? []) track.stop();
  stream = null;
  show();
  complain(reason);
  await own?.end();
}

callButton.onclick = () => (watching ? hangUp() : call());
microphoneButton.onclick = () => (speaking ? silence() : speak());
soundButton.onclick = () => {
  face.muted = !face.muted;
  show();
};
addEventListener("pagehide", () => {
  watching?.end();
  speaking?.end();
});
show();
