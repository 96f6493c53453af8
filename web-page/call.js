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

const tell = (text) => (one("state").textContent = text);
function complain(text) {
  one("trouble").textContent = text;
  one("trouble").hidden = !text;
}

// One offer to the server and its answer.
class Call {
  constructor(path, lost) {
    this.path = path;
    this.lost = lost; // told why, once, if the call ends by itself
    this.peer = new RTCPeerConnection({ iceServers: [] });
    this.peer.onconnectionstatechange = () => this.peer.connectionState === "failed" && this.fail();
  }

  async begin() {
    await this.peer.setLocalDescription();
    await this.gathered();
    const response = await this.ask("POST", `${this.path}?${new URLSearchParams({ session })}`, {
      body: this.peer.localDescription.sdp,
      headers: { "Content-Type": "application/sdp" },
    });
    const text = await response.text();
    if (response.status === 404) throw new Error("Calls are not enabled on this server: start it with fapengine serve --webrtc.");
    if (response.status !== 201) throw new Error(text || `The server answered ${response.status}.`);
    this.place = response.headers.get("Location");
    if (this.over) return this.end(); // hung up meanwhile
    await this.peer.setRemoteDescription({ type: "answer", sdp: text });
    this.watch = setInterval(() => this.look(), 1000);
  }

  // All addresses at once, for the server takes no later ones; it needs none of them to answer, so this may give up.
  gathered() {
    return new Promise((done) => {
      if (this.peer.iceGatheringState === "complete") return done();
      this.peer.addEventListener("icegatheringstatechange", () => this.peer.iceGatheringState === "complete" && done());
      setTimeout(done, GATHER_MS);
    });
  }

  ask(method, url, more = {}) {
    const headers = { ...more.headers, ...(token ? { Authorization: `Bearer ${token}` } : {}) };
    return fetch(url, { ...more, method, headers, keepalive: method === "DELETE" }).catch(() => {
      throw new Error("The server does not answer.");
    });
  }

  // A server that hangs up sends a goodbye that the browser tells only by tracks that fall silent.
  async look() {
    if (this.peer.connectionState === "disconnected" || this.peer.connectionState === "closed") await this.fail();
  }

  async fail() {
    if (this.over) return;
    const reason = await this.end().catch((error) => error.message);
    this.lost(reason || "The connection was lost.");
  }

  // Hangs up. Resolves to why the call was over before, if it was.
  async end() {
    this.over = true;
    clearInterval(this.watch);
    try {
      if (!this.place) return "";
      const response = await this.ask("DELETE", this.place);
      return response.status === 410 ? await response.text() : "";
    } finally {
      this.peer.close(); // not before: the server would see the connection end, and count it as lost
    }
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

async function call() {
  complain("");
  tell("Calling …");
  const own = (watching = new Call("whep", (reason) => hangUp(reason)));
  show();
  own.peer.addTransceiver("video", { direction: "recvonly" });
  own.peer.addTransceiver("audio", { direction: "recvonly" });
  const media = new MediaStream();
  own.peer.ontrack = ({ track }) => {
    media.addTrack(track);
    face.srcObject = media;
    face.play().catch(() => {
      face.muted = true; // a browser that wants a click first
      face.play();
      show();
    });
  };
  face.onplaying = () => watching && tell("You see the face.");
  try {
    await own.begin();
    if (watching === own) tell("Answered; the face is being drawn.");
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
  if (own && !own.over) await own.end().catch(() => "");
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
    const own = (speaking = new Call("whip", (reason) => silence(reason)));
    for (const track of stream.getAudioTracks()) {
      own.peer.addTransceiver(track, { direction: "sendonly", streams: [stream] });
      track.onended = () => speaking === own && silence("The microphone was disconnected.");
    }
    await own.begin();
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
  if (own && !own.over) await own.end().catch(() => "");
}

callButton.onclick = () => (watching ? hangUp() : call());
microphoneButton.onclick = () => (speaking ? silence() : speak());
soundButton.onclick = () => {
  face.muted = !face.muted;
  show();
};
addEventListener("pagehide", () => {
  watching?.end().catch(() => "");
  speaking?.end().catch(() => "");
});
show();
