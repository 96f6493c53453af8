// A face that follows a microphone, a recording or phones, in a page of static files: README.md has the same in short.

import "../index.js";

const [face, status, mood] = ["face", "status", "mood"].map((id) => document.getElementById(id));
const player = new Audio();
let [context, source, stream] = [null, null, null];
let said = [];

face.addEventListener("started", () => (said = []));
face.addEventListener("phone", ({ detail: { label } }) => {
  said = [...said, label].slice(-24);
  status.textContent = said.join(" ");
});
face.addEventListener("error", ({ detail }) => (status.textContent = detail));
const attempt = (action) => async (event) => {
  event.preventDefault?.();
  try {
    await action(event);
  } catch (error) {
    status.textContent = error.message;
  }
};

function quiet() {
  player.pause();
  for (const track of stream?.getTracks() ?? []) track.stop();
  stream = null;
}

document.getElementById("phones").addEventListener("submit", attempt(async () => {
  quiet();
  const length = Number(document.getElementById("length").value) / 1000;
  const labels = document.getElementById("ipa").value.trim().split(/\s+/);
  const phones = labels.map((label, number) => ({ label, start: 0.2 + number * length, end: 0.2 + (number + 1) * length }));
  await face.say(phones.filter(({ label }) => label !== "_"));
}));

document.getElementById("file").addEventListener("change", attempt(async ({ target }) => {
  quiet();
  if (!target.files.length) return;
  context ??= new AudioContext();
  source ??= new MediaElementAudioSourceNode(context, { mediaElement: player });
  URL.revokeObjectURL(player.src);
  player.src = URL.createObjectURL(target.files[0]);
  const heard = await face.hear(source);
  heard.connect(context.destination); // later by as much as the face
  await context.resume();
  await player.play();
}));

document.getElementById("microphone").addEventListener("click", attempt(async () => {
  quiet();
  stream = await navigator.mediaDevices.getUserMedia({ audio: true });
  await face.hear(stream); // what it returns is not connected: nobody wants to hear himself
}));

document.getElementById("stop").addEventListener("click", attempt(() => {
  quiet();
  face.cancel();
}));

mood.addEventListener("change", attempt(async () => {
  await face.express("neutral");
  if (mood.value !== "neutral") await face.express(mood.value, 0.8);
}));
for (const name of ["joy", "sadness", "anger", "fear", "disgust", "surprise", "contempt"]) mood.add(new Option(name));
