// What bench/browser_peers.py has the browser draw: draw(count) gives seconds, picture() the pixels of the last frame.

const SIZE = 512;
const NAME = decodeURIComponent(location.search.slice(1));
const pixels = new Uint8Array(SIZE * SIZE * 4);
const fetched = async (name) => (await fetch(`/${name}.bin`)).arrayBuffer();

function publish(drawOne) {
  let next = 0;
  window.picture = () => {
    let text = "";
    for (let at = 0; at < pixels.length; at += 8192) text += String.fromCharCode(...pixels.subarray(at, at + 8192));
    return btoa(text);
  };
  window.draw = (count) => {
    const started = performance.now();
    for (let n = 0; n < count; ++n) drawOne(next++);
    return (performance.now() - started) / 1000;
  };
}

async function three() {
  const THREE = await import("/three.module.js");
  const [positions, normals] = (await Promise.all(["positions", "normals"].map(fetched))).map((data) => new Float32Array(data));
  const colours = new Uint8Array(await fetched("colours"));
  const vertices = colours.length / 3;
  const frames = positions.length / vertices / 3;
  const own = NAME === "three.js, morphs";
  const bare = NAME === "three.js, bare";

  const geometry = new THREE.BufferGeometry();
  const attribute = (array) => new THREE.BufferAttribute(array, 3).setUsage(own ? THREE.StaticDrawUsage : THREE.DynamicDrawUsage);
  geometry.setAttribute("position", attribute(positions.slice(0, 3 * vertices)));
  geometry.setAttribute("normal", attribute(normals.slice(0, 3 * vertices)));
  const linear = Float32Array.from(colours, (value) => (value / 255) ** 2);
  geometry.setAttribute("color", new THREE.BufferAttribute(linear, 3));
  geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(await fetched("triangles")), 1));
  const Material = bare ? THREE.MeshPhongMaterial : THREE.MeshStandardMaterial;
  const mesh = new THREE.Mesh(geometry, new Material(bare ? { vertexColors: true } : { vertexColors: true, roughness: 0.6 }));
  mesh.frustumCulled = false;
  let influences = null;
  if (own) {
    const targets = new Float32Array(await fetched("targets"));
    influences = new Float32Array(await fetched("influences"));
    const count = targets.length / 6 / vertices;
    const part = (kind) => Array.from({ length: count }, (_, n) =>
      new THREE.BufferAttribute(targets.subarray(3 * vertices * (kind * count + n), 3 * vertices * (kind * count + n + 1)), 3));
    geometry.morphAttributes = { position: part(0), normal: part(1) };
    geometry.morphTargetsRelative = true;
    mesh.updateMorphTargets();
  }

  const scene = new THREE.Scene();
  scene.background = new THREE.Color(0.3, 0.36, 0.42);
  scene.add(mesh, new THREE.HemisphereLight(0xdde4ff, 0x807060, 1.2));
  for (const [colour, strength, x, y, z] of [[0xfff2e0, 2.4, -0.42, 0.52, 0.75], [0xdde8ff, 0.8, 0.8, 0.1, 0.6], [0xeef2ff, 1.2, 0.62, 0.4, -0.68]]) {
    const light = new THREE.DirectionalLight(colour, strength);
    light.position.set(x, y, z);
    scene.add(light);
  }
  const camera = new THREE.PerspectiveCamera(18.5, 1, 100, 3000);
  camera.position.set(0, 10, 930);
  camera.lookAt(0, 10, 30);
  const renderer = new THREE.WebGLRenderer({ antialias: !bare, preserveDrawingBuffer: false });
  renderer.setSize(SIZE, SIZE, false);
  const gl = renderer.getContext();
  publish((number) => {
    const frame = number % frames;
    if (own) {
      const count = influences.length / frames;
      for (let n = 0; n < count; ++n) mesh.morphTargetInfluences[n] = influences[frame * count + n];
    } else {
      for (const [name, data] of [["position", positions], ["normal", normals]]) {
        const target = geometry.attributes[name];
        target.array.set(data.subarray(3 * vertices * frame, 3 * vertices * (frame + 1)));
        target.needsUpdate = true;
      }
    }
    renderer.render(scene, camera);
    gl.readPixels(0, 0, SIZE, SIZE, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  });
}

async function ours() {
  const [{ FaceView }, { parseHead }] = await Promise.all([import("/face/face.js"), import("/face/head.js")]);
  const setup = await (await fetch("/setup.json")).json();
  const head = parseHead(await (await fetch("/head.bin")).arrayBuffer());
  const faps = new Float32Array(await fetched("faps"));
  const view = new FaceView(document.createElement("canvas"), head, setup, setup.wall);
  view.resize(SIZE, SIZE);
  publish((number) => {
    const frame = number % (faps.length / 68);
    view.draw(faps.subarray(68 * frame, 68 * frame + 68), setup.cameras.front);
    view.gl.readPixels(0, 0, SIZE, SIZE, view.gl.RGBA, view.gl.UNSIGNED_BYTE, pixels);
  });
}

(NAME === "our page" ? ours() : three()).catch((error) => (window.trouble = `${error}`));
