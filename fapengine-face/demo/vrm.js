// One face on two rigs: <fap-face>, and an avatar that three.js draws with the same FAPs.

import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { VRMLoaderPlugin } from "@pixiv/three-vrm";
import { ARKIT_NAMES, ArkitFollower, applyARKit, turns } from "../arkit.js";
import "../index.js";
import { sayAloud } from "./aloud.js";

const at = (id) => document.getElementById(id);
const [face, canvas, status] = ["face", "avatar", "status"].map(at);
const renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
const camera = new THREE.PerspectiveCamera(26, 1, 0.05, 20);
const light = new THREE.DirectionalLight(0xffffff, 2.2);
light.position.set(0.6, 1.2, 2);
const loader = new GLTFLoader();
loader.register((parser) => new VRMLoaderPlugin(parser));
let avatar = null; // { scene, vrm, meshes, head, rest, side }

const tell = (text, isWrong = false) => {
  status.textContent = text;
  status.classList.toggle("wrong", isWrong);
};

async function load(url) {
  const { scene: model, userData } = await loader.loadAsync(url);
  const vrm = userData.vrm ?? null;
  const isVrm0 = vrm?.meta?.metaVersion === "0"; // it looks the other way
  if (isVrm0) model.rotation.y = Math.PI;
  const scene = new THREE.Scene();
  scene.background = new THREE.Color(0xdfe3e6);
  scene.add(model, light, new THREE.HemisphereLight(0xffffff, 0x8a8f98, 1.6));
  const meshes = [];
  model.traverse((one) => one.morphTargetDictionary && meshes.push(one));
  const head = vrm?.humanoid.getNormalizedBoneNode("head") ?? model.getObjectByName("Head") ?? null;
  scene.updateMatrixWorld(true);
  const box = new THREE.Box3().setFromObject(model);
  const foot = head?.getWorldPosition(new THREE.Vector3()) ?? box.getCenter(new THREE.Vector3());
  const size = box.max.y - foot.y; // of the head, above its joint
  camera.position.set(foot.x, foot.y + 0.35 * size, foot.z + 3.8 * size);
  camera.lookAt(foot.x, foot.y + 0.3 * size, foot.z);
  avatar = { scene, vrm, meshes, head, rest: head?.quaternion.clone(), side: isVrm0 ? -1 : 1 };
  tell(vrm ? "" : "This file is not a VRM: its shapes with ARKit's names move.");
}

// Expressions that every VRM has, from ARKit's weights: rough, for avatars without ARKit's shapes.
const follower = new ArkitFollower();
function presets(manager, faps) {
  const weights = Object.fromEntries([...follower.follow(faps)].map((weight, index) => [ARKIT_NAMES[index], weight]));
  const round = Math.max(weights.mouthFunnel, weights.mouthPucker);
  const open = Math.max(weights.jawOpen - weights.mouthClose, 0) * 1.6;
  manager.setValue("aa", Math.min(open * (1 - round), 1));
  manager.setValue("oh", Math.min(open * round, 1));
  manager.setValue("ou", Math.min(round * Math.max(1 - open, 0) * 0.8, 1));
  manager.setValue("ee", Math.min(weights.mouthStretchLeft + weights.mouthSmileLeft, 1) * 0.5);
  manager.setValue("blinkLeft", weights.eyeBlinkLeft);
  manager.setValue("blinkRight", weights.eyeBlinkRight);
}

let before = performance.now();
face.addEventListener("picture", () => {
  if (!avatar) return;
  const { scene, vrm, meshes, head, rest, side } = avatar;
  const { faps } = face;
  if (!vrm) for (const mesh of meshes) applyARKit(mesh, faps);
  else if (vrm.expressionManager?.getExpression("jawOpen")) applyARKit(vrm.expressionManager, faps);
  else if (vrm.expressionManager) presets(vrm.expressionManager, faps);
  if (head) {
    const { yaw, pitch, roll } = turns(faps).head;
    head.quaternion.copy(rest).multiply(new THREE.Quaternion().setFromEuler(new THREE.Euler(side * pitch, yaw, side * roll)));
  }
  const now = performance.now();
  vrm?.update((now - before) / 1000);
  before = now;
  const { clientWidth: width, clientHeight: height } = canvas;
  renderer.setPixelRatio(devicePixelRatio);
  renderer.setSize(width, height, false);
  camera.aspect = width / height;
  camera.updateProjectionMatrix();
  renderer.render(scene, camera);
});

const attempt = (action) => async (event) => {
  event?.preventDefault?.();
  try {
    await action(event);
  } catch (error) {
    tell(error.message, true);
  }
};
at("file").addEventListener("change", attempt(async ({ target }) => {
  if (!target.files.length) return;
  const url = URL.createObjectURL(target.files[0]);
  await load(url).finally(() => URL.revokeObjectURL(url));
}));
at("text").addEventListener("submit", attempt(async () => {
  const found = await sayAloud(face, at("words").value, at("aloud").checked);
  if (found?.unread?.length) tell(`This is not read: ${found.unread.join(" ")}`, true);
}));
face.addEventListener("error", ({ detail }) => tell(detail, true));
const given = new URL(location).searchParams.get("avatar");
if (given) await attempt(() => load(given))();
else tell("Choose an avatar on this page.");
globalThis.isReady = true;
