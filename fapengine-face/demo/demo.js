// A face that says words and phones and follows a microphone, a recording or an agent's track, in a page of static files.

import "../index.js";
import { sayAloud } from "./aloud.js";

const at = (id) => document.getElementById(id);
const [face, status, mood] = ["face", "status", "mood"].map(at);
const player = new Audio();
let [context, source, stream, calls] = [null, null, null, []];
let said = [];

function show(text, isWrong = false) {
  status.textContent = text;
  status.classList.toggle("wrong", isWrong);
}

face.addEventListener("started", () => (said = []));
face.addEventListener("phone", ({ detail: { label } }) => {
  said = [...said, label].slice(-24);
  show(said.join(" "));
});
face.addEventListener("error", ({ detail }) => show(detail, true));
const attempt = (action) => async (event) => {
  event.preventDefault?.();
  try {
    await action(event);
  } catch (error) {
    show(error.message, true);
  }
};

function quiet() {
  globalThis.speechSynthesis?.cancel();
  player.pause();
  for (const track of stream?.getTracks() ?? []) track.stop();
  for (const call of calls) call.close();
  [stream, calls] = [null, []];
}

function playing(file) {
  context ??= new AudioContext();
  source ??= new MediaElementAudioSourceNode(context, { mediaElement: player });
  source.disconnect();
  URL.revokeObjectURL(player.src);
  player.src = URL.createObjectURL(file);
  return source;
}

at("text").addEventListener("submit", attempt(async () => {
  quiet();
  const found = await sayAloud(face, at("words").value, at("aloud").checked);
  if (found?.unread?.length) show(`This is not read: ${found.unread.join(" ")}`, true);
  else if (found?.isSilent && at("aloud").checked) show("There is no English voice here: the face speaks in silence.");
}));

at("phones").addEventListener("submit", attempt(async () => {
  quiet();
  const length = Number(at("length").value) / 1000;
  const labels = at("ipa").value.trim().split(/\s+/);
  const phones = labels.map((label, number) => ({ label, start: 0.2 + number * length, end: 0.2 + (number + 1) * length }));
  await face.say(phones.filter(({ label }) => label !== "_"));
}));

at("file").addEventListener("change", attempt(async ({ target }) => {
  quiet();
  if (!target.files.length) return;
  const heard = await face.hear(playing(target.files[0]));
  heard.connect(context.destination); // later by as much as the face
  await context.resume();
  await player.play();
}));

// A track as it comes from an agent: what an element plays is sent from one connection of this page to another.
at("track").addEventListener("change", attempt(async ({ target }) => {
  quiet();
  if (!target.files.length) return;
  const sent = new MediaStreamAudioDestinationNode(playing(target.files[0]).context);
  source.connect(sent);
  const [agent, own] = (calls = [new RTCPeerConnection(), new RTCPeerConnection()]);
  agent.onicecandidate = ({ candidate }) => own.addIceCandidate(candidate);
  own.onicecandidate = ({ candidate }) => agent.addIceCandidate(candidate);
  const came = new Promise((resolve) => (own.ontrack = ({ streams }) => resolve(streams[0])));
  agent.addTrack(sent.stream.getAudioTracks()[0], sent.stream);
  await agent.setLocalDescription();
  await own.setRemoteDescription(agent.localDescription);
  await own.setLocalDescription();
  await agent.setRemoteDescription(own.localDescription);
  const heard = await face.hear(await came, { context });
  heard.connect(context.destination);
  await context.resume();
  await player.play();
}));

at("microphone").addEventListener("click", attempt(async () => {
  quiet();
  stream = await navigator.mediaDevices.getUserMedia({ audio: true });
  await face.hear(stream); // what it returns is not connected: nobody wants to hear themselves
  show("Speak, in English.");
}));

at("stop").addEventListener("click", attempt(() => {
  quiet();
  face.cancel();
}));

mood.addEventListener("change", attempt(async () => {
  await face.express("neutral");
  if (mood.value !== "neutral") await face.express(mood.value, 0.8);
}));
for (const name of ["joy", "sadness", "anger", "fear", "disgust", "surprise", "contempt"]) mood.add(new Option(name));
