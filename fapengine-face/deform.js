// What a frame of FAPs sets: channel weights, bones, pupil. The same arithmetic as fapengine/mesh/deform.py, whose
// comments say why; a test compares the numbers. Matrices are column by column, as WebGL takes them.

const AU_RAD = 1e-5;
const MAX_CHANNELS = 128;
export const HEAD = 4;

const fapOf = (faps, number) => faps[number - 1];
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

// Share of the pose at rest, 0 to 1, of an attribute or a part of an address; 1 if it is missing or not a number.
export function restShare(text) {
  const share = Number.parseFloat(text);
  return Number.isNaN(share) ? 1 : clamp(share, 0, 1);
}

// FAPs within their limits, with the pose at rest added (fapengine/mesh/deform.py): (68,). Of /setup.json, rest is rows
// of values, FAPs to which they yield, and the limit of these; smile is rows of the FAP of a lip corner, where it begins
// and ends to act, and the values that it adds; lips is rows of the FAPs of an upper and a lower lip, inner and then
// outer; parted is how much farther a smile parts them, as a fraction of their opening, the opening where that is 0, and
// the upper lip's share; limits is rows of a FAP and the most that is drawn; lids is rows of the FAPs of an upper and a
// lower lid, and their sum at which they meet.
export function withRest(faps, { rest, smile, lips, parted, limits, lids }, share, rested = new Float64Array(faps.length)) {
  rested.set(faps);
  for (const [number, limit] of limits) rested[number - 1] = clamp(fapOf(faps, number), -limit, limit);
  for (const [values, yieldsTo, limit] of share ? rest : []) {
    const moved = Math.min(Math.max(...yieldsTo.map((number) => Math.abs(fapOf(faps, number)))) / limit, 1);
    const left = share * (1 - moved ** 3 * (10 + moved * (6 * moved - 15)));
    for (const [number, value] of values) rested[number - 1] += left * value;
  }
  let smiles = 0;
  for (const [corner, start, stop, values] of share ? smile : []) {
    const smiling = share * clamp((fapOf(faps, corner) - start) / (stop - start), 0, 1);
    smiles += smiling / smile.length;
    for (const [number, value] of values) rested[number - 1] += smiling * value;
  }
  const [fraction, limit, upperShare] = parted;
  for (const [upper, lower, upperOuter, lowerOuter] of share ? lips : []) {
    const opening = clamp(-fapOf(faps, upper) - fapOf(faps, lower), 0, limit);
    const added = fraction * smiles * opening * (1 - opening / limit);
    for (const number of [upper, upperOuter]) rested[number - 1] -= upperShare * added;
    for (const number of [lower, lowerOuter]) rested[number - 1] -= (1 - upperShare) * added;
  }
  for (const [upper, lower, shut] of lids) {
    rested[lower - 1] = Math.min(rested[lower - 1], Math.max(shut - rested[upper - 1], 0));
  }
  return rested;
}

// How far each channel has gone, mixed if the head says so, FAPU: (128,), zeros behind the last.
export function channelWeights(head, faps, weights = new Float32Array(MAX_CHANNELS)) {
  const table = head.channels.array;
  const mix = head.mix.array;
  const count = table.length / 3;
  const gone = mix.length ? new Float64Array(count) : weights;
  for (let channel = 0; channel < count; ++channel) {
    const [number, start, stop] = table.subarray(3 * channel, 3 * channel + 3);
    const value = fapOf(faps, number);
    gone[channel] =
      start === -Infinity ? value : clamp((value - start) * Math.sign(stop - start), 0, Math.abs(stop - start));
  }
  for (let row = 0; row < mix.length / count; ++row) {
    let sum = 0;
    for (let channel = 0; channel < count; ++channel) sum += mix[row * count + channel] * gone[channel];
    weights[row] = sum;
  }
  return weights;
}

// Five 4x4 matrices, moved from rest: none, jaw, left eye, right eye, head.
export function boneMatrices(head, faps, matrices = new Float32Array(5 * 16)) {
  const { units } = head;
  const fap = (number) => fapOf(faps, number);
  const place = (bone, rotation, pivot, shift) => matrices.set(turnAbout(rotation, pivot, shift), 16 * bone);
  place(0, rotationX(0), [0, 0, 0], [0, 0, 0]);
  place(1, rotationX(jawAngle(head, fap(3))), head.jawPivot, [-fap(15) * units.MW, 0, fap(14) * units.MNS]);
  [[2, 23, 25, 27], [3, 24, 26, 28]].forEach(([bone, yaw, pitch, thrust], side) => {
    const turn = product(rotationY(fap(yaw) * AU_RAD), rotationX(fap(pitch) * AU_RAD));
    place(bone, turn, head.eyePivots[side], [0, 0, fap(thrust) * units.ES]);
  });
  const yawed = product(rotationY(fap(49) * AU_RAD), rotationX(fap(48) * AU_RAD));
  place(HEAD, product(yawed, rotationZ(fap(50) * AU_RAD)), head.headPivot, [0, 0, 0]);
  return matrices;
}

// Radius of iris and pupil, as shares of the eyeball's.
export function irisAndPupil(head, faps) {
  const dilation = (fapOf(faps, 29) + fapOf(faps, 30)) / 2 / 1024;
  return [head.iris, head.iris * clamp(head.pupilShare + dilation, ...head.pupilRange)];
}

// Heights of the lids' margins, as shares of the eyeball's radius: upper and lower of the left eye, then of the right.
export function lidMargins(head, faps) {
  return [[19, 1], [21, -1], [20, 1], [22, -1]].map(
    ([number, sign]) => sign * head.lid * (1 - (2 * fapOf(faps, number)) / 1024),
  );
}

function jawAngle(head, openJaw) {
  const y = head.chin[1] - head.jawPivot[1];
  const z = head.chin[2] - head.jawPivot[2];
  const drop = openJaw * head.units.MNS;
  return Math.acos(clamp((y - drop) / Math.hypot(y, z), -1, 1)) - Math.atan2(z, y);
}

// Rotations are three rows of three.
function rotation(angle, first, second) {
  const rows = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  rows[first][first] = rows[second][second] = Math.cos(angle);
  rows[first][second] = -Math.sin(angle);
  rows[second][first] = Math.sin(angle);
  return rows;
}
const rotationX = (angle) => rotation(angle, 1, 2);
const rotationY = (angle) => rotation(angle, 2, 0);
const rotationZ = (angle) => rotation(angle, 0, 1);

function product(a, b) {
  return a.map((row) => [0, 1, 2].map((column) => row.reduce((sum, value, k) => sum + value * b[k][column], 0)));
}

function turnAbout(rows, pivot, shift) {
  const moved = rows.map((row, k) => pivot[k] + shift[k] - row.reduce((sum, value, axis) => sum + value * pivot[axis], 0));
  const column = (k) => rows.map((row) => row[k]);
  return [...column(0), 0, ...column(1), 0, ...column(2), 0, ...moved, 1];
}
