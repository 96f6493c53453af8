// A conversation with an agent: microphone and text there, face and voice back. The data channel carries RTVI messages.

const query = new URLSearchParams(location.search);
const token = query.get("token") ?? sessionStorage.getItem("token");
if (query.has("token")) {
  sessionStorage.setItem("token", token);
  history.replaceState(null, "", location.pathname); // it is kept for this tab, and not shown
}

const one = (id) => document.getElementById(id);
const [face, said, ask, text, sendButton, callButton, microphoneButton] = ["face", "said", "ask", "text", "send", "call", "microphone"].map(one);

const GATHER_MS = 2000;
const PING_MS = 1000; // the agent hangs up without it
const SILENT_MS = 5000; // an agent sends sound at any time: without it, it is gone
const READY_MS = 60000;

const tell = (words) => (one("state").textContent = words);
function complain(words) {
  one("trouble").textContent = words;
  one("trouble").hidden = !words;
}

let talk = null;
let microphone = null;

// Adds a line of the conversation; a line that has a key is replaced.
function write(who, words, key = "") {
  let line = key && said.querySelector(`[data-key="${CSS.escape(key)}"]`);
  if (!line) {
    line = said.appendChild(document.createElement("div"));
    line.className = who;
    if (key) line.dataset.key = key;
  }
  line.textContent = words;
  said.scrollTop = said.scrollHeight;
}

const HEARD = {
  "bot-ready": () => tell("Connected: speak or type."),
  "user-started-speaking": () => tell("Listening …"),
  "user-stopped-speaking": () => tell("Thinking …"),
  "bot-started-speaking": () => tell("Speaking …"),
  "bot-stopped-speaking": () => tell("Connected: speak or type."),
  "user-input": ({ text: words, final }) => final && write("user", words),
  "bot-output": ({ text: words, segment_id: segment }) => write("bot", words, `bot ${segment}`),
  error: ({ error }) => complain(error),
  "error-response": ({ error }) => complain(error),
};

class Talk {
  constructor() {
    this.peer = new RTCPeerConnection({ iceServers: [] });
    this.channel = this.peer.createDataChannel("chat", { ordered: true });
    this.channel.onopen = () => {
      this.pings = setInterval(() => this.channel.readyState === "open" && this.channel.send(`ping: ${Date.now()}`), PING_MS);
      this.send("client-ready", { version: "2.2.0", about: { library: "fapengine" } });
      sendButton.disabled = false;
      this.watch = setInterval(() => this.look(), PING_MS);
      this.moved = performance.now();
    };
    this.channel.onclose = () => this.lost("The agent has hung up.");
    this.channel.onmessage = ({ data }) => {
      const message = JSON.parse(data);
      if (message.label === "rtvi-ai") HEARD[message.type]?.(message.data ?? {});
    };
    this.peer.onconnectionstatechange = () => this.peer.connectionState === "failed" && this.lost("The connection failed.");
    const media = new MediaStream();
    this.peer.ontrack = ({ track }) => {
      media.addTrack(track);
      face.srcObject = media;
    };
  }

  async begin() {
    const audio = this.peer.addTransceiver("audio", { direction: "sendrecv" });
    this.peer.addTransceiver("video", { direction: "recvonly" });
    if (microphone) await audio.sender.replaceTrack(microphone);
    await this.peer.setLocalDescription();
    await new Promise((done) => {
      if (this.peer.iceGatheringState === "complete") return done();
      this.peer.addEventListener("icegatheringstatechange", () => this.peer.iceGatheringState === "complete" && done());
      setTimeout(done, GATHER_MS);
    });
    const { sdp, type } = this.peer.localDescription;
    const headers = { "Content-Type": "application/json", ...(token ? { Authorization: `Bearer ${token}` } : {}) };
    const answer = await fetch("api/offer", { method: "POST", headers, body: JSON.stringify({ sdp, type }) }).catch(() => {
      throw new Error("The agent does not answer.");
    });
    if (!answer.ok) throw new Error((await answer.text()) || `The agent answered ${answer.status}.`);
    await this.peer.setRemoteDescription(await answer.json());
    this.late = setTimeout(() => this.channel.readyState !== "open" && this.lost("No connection came about."), READY_MS);
  }

  send(type, data) {
    this.channel.send(JSON.stringify({ label: "rtvi-ai", id: crypto.randomUUID?.() ?? String(Math.random()).slice(2), type, data }));
  }

  // Once a second: a program that is killed says no goodbye.
  async look() {
    let count = 0;
    for (const stat of (await this.peer.getStats()).values()) count += stat.type === "inbound-rtp" ? (stat.packetsReceived ?? 0) : 0;
    const now = performance.now();
    if (count !== this.count) this.moved = now;
    else if (now - this.moved > SILENT_MS) this.lost("The agent is gone.");
    this.count = count;
  }

  lost(why) {
    if (talk !== this) return;
    hangUp();
    complain(why);
  }

  end() {
    clearInterval(this.pings);
    clearInterval(this.watch);
    clearTimeout(this.late);
    this.peer.close();
  }
}

function show() {
  callButton.textContent = talk ? "Hang up" : "Talk";
  microphoneButton.disabled = !microphone;
  const on = Boolean(microphone?.enabled);
  microphoneButton.textContent = on ? "Microphone on" : "Microphone off";
  microphoneButton.setAttribute("aria-pressed", String(on));
  if (!talk) sendButton.disabled = true;
}

// Opens the microphone; without one, one can still type.
async function listen() {
  if (!navigator.mediaDevices?.getUserMedia) return complain("A browser gives its microphone only to https and to this very machine: type.");
  try {
    const stream = await navigator.mediaDevices.getUserMedia({ audio: { echoCancellation: true, noiseSuppression: true } });
    return stream.getAudioTracks()[0];
  } catch {
    complain("There is no microphone, or it was not allowed: type.");
  }
}

async function call() {
  complain("");
  tell("Connecting …");
  const own = (talk = new Talk());
  show();
  const opened = await listen();
  if (talk !== own) return opened?.stop(); // hung up meanwhile
  microphone = opened;
  show();
  try {
    await own.begin();
  } catch (error) {
    own.lost(error.message);
  }
}

function hangUp() {
  talk?.end();
  talk = null;
  microphone?.stop();
  microphone = null;
  face.srcObject = null;
  tell("Not connected.");
  show();
}

callButton.onclick = () => (talk ? hangUp() : call());
microphoneButton.onclick = () => {
  microphone.enabled = !microphone.enabled;
  show();
};
ask.onsubmit = (event) => {
  event.preventDefault();
  if (!talk || sendButton.disabled || !text.value.trim()) return;
  talk.send("send-text", { content: text.value, options: { run_immediately: true, audio_response: true } });
  text.value = "";
};
addEventListener("pagehide", hangUp);
show();
