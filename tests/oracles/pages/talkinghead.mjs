// A head in TalkingHead, on a clock of its own.
window.requestAnimationFrame = () => 0;  // frames are asked for one by one, on a clock of their own
let seed = 1;
Math.random = () => (seed = (seed * 16807) % 2147483647) / 2147483647;  // of its idle faces and glances
const { TalkingHead } = await import('talkinghead');
const [above, below] = window.LIPS;
window.load = async (url) => {
  const head = window.head = new TalkingHead(document.body, { lipsyncModules: [], cameraView: 'head', avatarIdleHeadMove: 0 });
  await head.showAvatar({ url, body: 'F' });
  const face = head.armature.getObjectByName('Face');
  const one = head.armature.position.clone(), other = one.clone(), turn = head.armature.quaternion.clone();
  const gap = () => {  // mm upwards in the head
    head.armature.updateMatrixWorld(true);
    face.skeleton.update();
    face.getVertexPosition(above, one);
    face.getVertexPosition(below, other);
    return 1000 * one.sub(other).applyQuaternion(head.objectHead.getWorldQuaternion(turn).invert()).y;
  };
  let now = performance.now();
  head.animTimeLast = now;
  const step = () => head.animate(now += 1000 / 30 + 0.001);
  for (let frame = 0; frame < 60; frame++) step();  // into its pose
  const rest = gap();
  window.speak = async (visemes, frames) => {  // the opening in each frame, and the weight of PP
    const sound = head.audioCtx.createBuffer(1, 22050 * 5, 22050);
    head.speakAudio({ audio: sound, words: [''], wtimes: [0], wdurations: [0], ...visemes });
    while (!head.animQueue.some((one) => one.template.name === 'viseme')) await new Promise((done) => setTimeout(done, 20));
    const rows = [];
    for (let frame = 0; frame < frames; frame++) {
      step();
      rows.push([gap() - rest, head.getValue('viseme_PP')]);
    }
    return rows;
  };
  const show = (weights) => {
    for (const [name, weight] of Object.entries(weights)) Object.assign(head.mtAvatar[name], { realtime: weight, needsUpdate: true });
    step();
    return gap() - rest;
  };
  window.avatar = {
    opening: show,
    openings: (names, rows) => rows.map((row) => show(Object.fromEntries(names.map((name, at) => [name, row[at]])))),
    draw: (weights) => {
      for (let frame = 0; frame < 15; frame++) show(weights);  // its weights have a largest speed
      head.render();
      return head.renderer.domElement.toDataURL();
    },
    facts: () => ({ joints: new Set(head.posePropNames.map((name) => name.split('.')[0])).size }),
  };
};
window.ready = true;
