// Where one looks from: presets that are flown to, and a hand, wheel or keys that turn the camera.

import { between, turned, zoomed } from "./camera.js";

const FLIGHT_MS = 450;
const calm = globalThis.matchMedia?.("(prefers-reduced-motion: reduce)"); // on a server there is none

export class Steering {
  // presets: camera by name (camera.js), the first one is where it begins. moved(name): told of a preset, or null.
  constructor(presets, moved = () => {}) {
    this.presets = Object.entries(presets);
    this.moved = moved;
    this.camera = this.presets[0][1];
    this.flight = null;
  }

  // The camera at a time of this page, ms.
  at(now) {
    if (this.flight) {
      const share = Math.min(Math.max((now - this.flight.since) / FLIGHT_MS, 0), 1);
      this.camera = between(this.flight.from, this.flight.to, share * share * (3 - 2 * share));
      if (share === 1) this.flight = null;
    }
    return this.camera;
  }

  // To a preset by name or place; others stay where they are.
  fly(which, { atOnce = calm?.matches } = {}) {
    const [name, camera] = this.presets[which] ?? this.presets.find(([name]) => name === which) ?? [];
    if (!camera) return;
    this.flight = atOnce ? null : { from: this.camera, to: camera, since: performance.now() };
    if (atOnce) this.camera = camera;
    this.moved(name);
  }

  move(camera) {
    this.flight = null;
    this.camera = camera;
    this.moved(null);
  }

  listen(canvas) {
    const pointers = new Map();
    const spread = () => {
      const [a, b] = [...pointers.values()];
      return Math.hypot(a.x - b.x, a.y - b.y);
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    });
    canvas.addEventListener("pointermove", (event) => {
      const last = pointers.get(event.pointerId);
      if (!last) return;
      const before = pointers.size === 2 ? spread() : 0;
      pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      if (before) this.move(zoomed(this.camera, before / Math.max(spread(), 1)));
      else this.move(turned(this.camera, (last.x - event.clientX) * 0.35, (event.clientY - last.y) * 0.25));
    });
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
    }
    canvas.addEventListener("dblclick", () => this.fly(0));
    const nearer = (event) => {
      event.preventDefault();
      this.move(zoomed(this.camera, Math.exp(Math.min(Math.max(event.deltaY, -200), 200) * 0.0012)));
    };
    canvas.addEventListener("wheel", nearer, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const turns = { ArrowLeft: [-6, 0], ArrowRight: [6, 0], ArrowUp: [0, 4], ArrowDown: [0, -4] };
      if (turns[event.key]) this.move(turned(this.camera, ...turns[event.key]));
      else if (event.key === "+" || event.key === "=") this.move(zoomed(this.camera, 0.92));
      else if (event.key === "-") this.move(zoomed(this.camera, 1 / 0.92));
      else return;
      event.preventDefault();
    });
  }
}
