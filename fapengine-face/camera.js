// Where the camera stands; as fapengine/render/camera.py, but pictures are drawn upright. Lengths in mm.

const NEAR = 100;
const FAR = 3000;
const RADIANS = Math.PI / 180;
export const LIMITS = { yaw: 180, pitch: 60, distance: [260, 1900] };

const minus = (a, b) => a.map((value, axis) => value - b[axis]);
const dot = (a, b) => a.reduce((sum, value, axis) => sum + value * b[axis], 0);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((value) => value / Math.hypot(...a));
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

// camera: { yaw, pitch (degrees), target (mm), distance (mm), field (degrees from bottom to top) }
export function cameraPosition({ yaw, pitch, target, distance }) {
  const [y, p] = [yaw * RADIANS, pitch * RADIANS];
  const towards = [Math.sin(y) * Math.cos(p), Math.sin(p), Math.cos(y) * Math.cos(p)];
  return target.map((value, axis) => value + distance * towards[axis]);
}

// How large a millimetre at the target is in a picture of that height.
export function pixelsPerMm({ distance, field }, height) {
  return height / (2 * distance * Math.tan((field * RADIANS) / 2));
}

// Sixteen numbers, column by column. A picture that is higher than wide keeps the width that a square one shows.
export function clipFromWorld(camera, aspect) {
  const position = cameraPosition(camera);
  const forward = unit(minus(camera.target, position));
  const right = unit(cross(forward, [0, 1, 0]));
  const rows = [right, cross(right, forward), forward.map((value) => -value)];
  const moved = rows.map((row) => -dot(row, position));
  const scale = Math.min(1, aspect) / Math.tan((camera.field * RADIANS) / 2);
  const depth = FAR - NEAR;
  const projected = [
    [...rows[0], moved[0]].map((value) => (value * scale) / aspect),
    [...rows[1], moved[1]].map((value) => value * scale),
    [...rows[2], moved[2]].map((value) => (-(FAR + NEAR) / depth) * value),
    [...rows[2], moved[2]].map((value) => -value),
  ];
  projected[2][3] -= (2 * FAR * NEAR) / depth;
  return new Float32Array([0, 1, 2, 3].flatMap((column) => projected.map((row) => row[column])));
}

export function turned(camera, yaw, pitch) {
  return {
    ...camera,
    yaw: clamp(camera.yaw + yaw, -LIMITS.yaw, LIMITS.yaw),
    pitch: clamp(camera.pitch + pitch, -LIMITS.pitch, LIMITS.pitch),
  };
}

export function zoomed(camera, factor) {
  return { ...camera, distance: clamp(camera.distance * factor, ...LIMITS.distance) };
}

// Between two cameras, share 0..1: presets are flown to, not jumped to.
export function between(from, to, share) {
  const mix = (a, b) => a + (b - a) * share;
  return {
    yaw: mix(from.yaw, to.yaw),
    pitch: mix(from.pitch, to.pitch),
    target: from.target.map((value, axis) => mix(value, to.target[axis])),
    distance: mix(from.distance, to.distance),
    field: mix(from.field, to.field),
  };
}
