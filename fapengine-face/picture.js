// A canvas that shows a face: as often as the screen asks while it speaks, half as often at rest, and not at all where
// nothing changes; with as many pixels as the machine can draw in time. Without WebGL2 the face is followed unseen.

import { FaceView } from "./face.js";
import { PixelBudget } from "./time.js";

const MAX_PIXELS = 2_600_000;
const REST_MS = 32; // from picture to picture of a face at rest, somewhat less than two turns of most screens
const MOVED_MS = 600; // the camera counts as in motion for so long

export class Picture {
  // sample(now, faps): writes the 68 values at a time in s; returns { time }, or null while there is nothing to show yet.
  // steering: where one looks from. options: wall (linear RGB, or null for a clear ground), edges ("fine", "soft"; else as
  // the machine can), rest (share of the pose at rest, 0 to 1), isBusy (whether every turn of the screen counts), shown(shown, now) after each sample.
  constructor(canvas, setup, head, sample, steering, { wall = null, edges = null, rest = 1, isBusy = () => true, shown = () => {} } = {}) {
    Object.assign(this, { canvas, sample, steering, edges, isBusy, shown });
    this.faps = new Float32Array(68);
    this.drawn = null; // what was drawn last
    this.count = 0; // pictures drawn
    try {
      this.view = new FaceView(canvas, head, setup, wall, rest);
    } catch (error) {
      this.view = null;
      this.trouble = error.message;
    }
    this.budget = new PixelBudget(this.view !== null && !this.view.frugal);
    this.end = new AbortController();
    this.observer = new ResizeObserver(() => (this.resized = true));
    this.observer.observe(canvas);
    this.resized = true;
    this.lastTurn = this.lastShown = -Infinity;
    this.hasDrawn = false;
    document.addEventListener("visibilitychange", () => (this.hasDrawn = false), { signal: this.end.signal });
    canvas.addEventListener("webglcontextrestored", () => (this.drawn = null), { signal: this.end.signal });
    this.asked = requestAnimationFrame((now) => this.turn(now));
  }

  close() {
    cancelAnimationFrame(this.asked);
    this.end.abort();
    this.observer.disconnect();
    this.view?.close();
  }

  // Show another head (head.js).
  wear(head) {
    this.view?.wear(head);
    this.resized = true;
  }

  // One turn of the screen.
  turn(now) {
    this.asked = requestAnimationFrame((next) => this.turn(next));
    // The turn behind a picture tells how long that took; others tell nothing.
    if (this.hasDrawn && this.budget.add((now - this.lastTurn) / 1000)) this.resized = true;
    this.lastTurn = now;
    this.hasDrawn = false;
    const camera = this.steering.at(now);
    if (camera !== this.camera) [this.camera, this.movedAt] = [camera, now];
    const isBusy = this.isBusy() || this.resized || now - this.movedAt < MOVED_MS;
    if (!isBusy && now - this.lastShown < REST_MS) return;
    this.lastShown = now;
    const shown = this.sample(performance.now() / 1000, this.faps);
    this.hasDrawn = this.draw();
    this.shown(shown, now);
  }

  // Returns whether there was something new to draw.
  draw() {
    if (!this.view || this.view.gl.isContextLost()) return false;
    if (this.resized) this.size();
    const { drawn, faps, camera } = this;
    if (drawn?.camera === camera && drawn.faps.every((value, column) => value === faps[column])) return false;
    this.view.draw(faps, camera);
    this.drawn = { camera, faps: faps.slice() };
    this.count += 1;
    return true;
  }

  size() {
    this.resized = false;
    this.drawn = null;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const dense = Math.min(devicePixelRatio, 2, Math.sqrt(MAX_PIXELS / Math.max(width * height, 1))) * this.budget.scale;
    const [across, down] = [width, height].map((side) => Math.max(1, Math.round(side * dense)));
    this.view.resize(across, down, this.wantsFineEdges);
  }

  // Where a graphics card draws and holds the rate, if nobody decided otherwise.
  get wantsFineEdges() {
    return this.edges ? this.edges === "fine" : this.budget.fine;
  }
}
