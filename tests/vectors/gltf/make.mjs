// Writes the two GLB files beside it with other people's exporters:
//   npm install three@0.187 @gltf-transform/core@4.5 && node make.mjs
// A skinned square with two named morph targets, below a node that turns and doubles.
import { writeFileSync } from "node:fs";

globalThis.FileReader = class {
  // GLTFExporter asks the browser for this
  readAsArrayBuffer(blob) {
    blob.arrayBuffer().then((result) => {
      this.result = result;
      this.onloadend?.();
    });
  }
};
const THREE = await import("three");
const { GLTFExporter } = await import("three/examples/jsm/exporters/GLTFExporter.js");
const { NodeIO } = await import("@gltf-transform/core");

const floats = (values, size = 3) => new THREE.Float32BufferAttribute(values, size);
const square = new THREE.BufferGeometry();
square.setAttribute("position", floats([0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0]));
square.setAttribute("normal", floats([0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1]));
square.setAttribute("uv", floats([0, 0, 1, 0, 1, 1, 0, 1], 2));
square.setAttribute("skinIndex", new THREE.Uint16BufferAttribute(new Array(16).fill(0), 4));
square.setAttribute("skinWeight", floats([1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0], 4));
square.setIndex([0, 1, 2, 0, 2, 3]);
const jaw = Object.assign(floats([0, 0, 0, 0, 0, 0, 0, -0.5, 0, 0, -0.5, 0]), { name: "jawOpen" });
const smile = Object.assign(floats([0, 0, 0.25, 0, 0, 0, 0, 0, 0, 0, 0, 0]), { name: "mouthSmileLeft" });
square.morphAttributes.position = [jaw, smile];
square.morphTargetsRelative = true;

const head = Object.assign(new THREE.Bone(), { name: "Head" });
head.position.set(0, 1.5, 0);
const mesh = new THREE.SkinnedMesh(square, new THREE.MeshStandardMaterial({ color: 0x808080, name: "Skin" }));
mesh.name = "Face";
mesh.updateMorphTargets();
const root = Object.assign(new THREE.Group(), { name: "Armature" });
root.rotation.x = Math.PI / 2;
root.scale.setScalar(2);
root.add(head, mesh);
root.updateMatrixWorld(true);
mesh.bind(new THREE.Skeleton([head]));

const glb = await new GLTFExporter().parseAsync(new THREE.Scene().add(root), { binary: true });
writeFileSync("three_r187.glb", Buffer.from(glb));

const io = new NodeIO(); // writes everything anew, and sparse
const document = await io.readBinary(new Uint8Array(glb));
for (const accessor of document.getRoot().listAccessors()) accessor.setSparse(accessor.getType() === "VEC3");
writeFileSync("gltf_transform.glb", Buffer.from(await io.writeBinary(document)));
