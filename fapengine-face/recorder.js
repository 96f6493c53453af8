// A film of the canvas and of the sound that is played, as this browser can write one.

const FRAMES_HZ = 30;
const KINDS = ["video/mp4;codecs=avc1,mp4a.40.2", "video/webm;codecs=vp9,opus", "video/webm"];

export class Recorder {
  static get isPossible() {
    return typeof MediaRecorder === "function" && KINDS.some((kind) => MediaRecorder.isTypeSupported(kind));
  }

  // sound: see sound.js.
  constructor(canvas, sound) {
    this.canvas = canvas;
    this.sound = sound;
    this.on = false;
  }

  start() {
    this.sound.open();
    const heard = new MediaStreamAudioDestinationNode(this.sound.context);
    this.sound.output.connect(heard);
    const stream = new MediaStream([...this.canvas.captureStream(FRAMES_HZ).getVideoTracks(), ...heard.stream.getAudioTracks()]);
    const kind = KINDS.find((kind) => MediaRecorder.isTypeSupported(kind));
    this.name = `face.${kind.startsWith("video/mp4") ? "mp4" : "webm"}`;
    const pieces = [];
    this.recorder = new MediaRecorder(stream, { mimeType: kind });
    this.recorder.ondataavailable = ({ data }) => pieces.push(data);
    this.over = new Promise((resolve) => {
      this.recorder.onstop = () => {
        this.sound.output.disconnect(heard);
        for (const track of stream.getTracks()) track.stop();
        resolve(new Blob(pieces, { type: kind }));
      };
    });
    this.recorder.start(1000);
    this.on = true;
  }

  // Resolves to the film, a Blob.
  stop() {
    this.on = false;
    this.recorder.stop();
    return this.over;
  }
}
