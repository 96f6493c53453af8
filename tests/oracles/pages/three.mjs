// A head in three.js, or as a VRM in three-vrm; what both pages offer is `load(url)`, then `avatar`.
import * as THREE from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { VRMLoaderPlugin } from '@pixiv/three-vrm';
const [above, below] = window.LIPS;
const opening = (root) => {  // mm upwards in the head, by the program's own morphs and skins
  const face = root.getObjectByName('Face'), one = new THREE.Vector3(), other = new THREE.Vector3();
  root.updateMatrixWorld(true);
  face.skeleton.update();
  face.getVertexPosition(above, one);
  face.getVertexPosition(below, other);
  const turn = root.getObjectByName('Head').getWorldQuaternion(new THREE.Quaternion());
  return 1000 * one.sub(other).applyQuaternion(turn.invert()).y;
};
window.load = async (url) => {
  const loader = new GLTFLoader();
  loader.register((parser) => new VRMLoaderPlugin(parser));
  const gltf = await loader.loadAsync(url), vrm = gltf.userData.vrm, scene = new THREE.Scene();
  const meshes = [];
  gltf.scene.traverse((one) => { if (one.morphTargetDictionary) meshes.push(one); });
  const show = (weights) => {
    for (const [name, weight] of Object.entries(weights)) {
      if (vrm) vrm.expressionManager.setValue(name, weight);
      else for (const mesh of meshes) {
        if (name in mesh.morphTargetDictionary) mesh.morphTargetInfluences[mesh.morphTargetDictionary[name]] = weight;
      }
    }
    if (vrm) vrm.expressionManager.update();
  };
  const renderer = new THREE.WebGLRenderer({ antialias: true });
  renderer.setSize(innerWidth, innerHeight);
  document.body.replaceChildren(renderer.domElement);
  const eyes = ['LeftEye', 'RightEye'].map((name) => gltf.scene.getObjectByName(name).getWorldPosition(new THREE.Vector3()));
  const middle = eyes[0].clone().add(eyes[1]).divideScalar(2);
  const camera = new THREE.PerspectiveCamera(30, innerWidth / innerHeight, 0.05, 10);
  camera.position.copy(middle).add(new THREE.Vector3(0.1, -0.04, 0.72));
  camera.lookAt(middle.x, middle.y - 0.04, middle.z);
  const light = new THREE.DirectionalLight(0xffffff, 2.5);
  light.position.set(0.5, 3, 2);
  scene.add(gltf.scene, light, new THREE.HemisphereLight(0xffffff, 0x888888, 1.5));
  scene.background = new THREE.Color(0xdfe6ea);
  const rest = opening(gltf.scene);
  window.avatar = {
    opening: (weights) => { show(weights); return opening(gltf.scene) - rest; },
    openings: (names, rows) => rows.map((row) => window.avatar.opening(Object.fromEntries(names.map((name, at) => [name, row[at]])))),
    draw: (weights) => { show(weights); renderer.render(scene, camera); return renderer.domElement.toDataURL(); },
    facts: () => ({
      bones: vrm ? Object.keys(vrm.humanoid.humanBones) : [], meta: vrm ? vrm.meta : null,
      expressions: vrm ? Object.keys(vrm.expressionManager.expressionMap) : [],
      eyes: middle.toArray(),
    }),
    look: (x, y, z) => {  // turns of the left eye, degrees
      vrm.lookAt.lookAt(new THREE.Vector3(middle.x + x, middle.y + y, middle.z + z));
      vrm.update(0);
      return new THREE.Euler().setFromQuaternion(gltf.scene.getObjectByName('LeftEye').quaternion, 'YXZ').toArray().slice(0, 2)
        .map((turn) => turn * 180 / Math.PI);
    },
  };
};
window.ready = true;
