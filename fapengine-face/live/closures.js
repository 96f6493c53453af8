// Contacts that are made whatever else a face does: fapengine/trajectory/closures.py, whose comments say why.

import { closures, context } from "./constants.js";
import { bump, clamp, smoothstep, softPositive } from "./path.js";

const {
  BITTEN_FAPU, BITTEN_SHARE, BURST_S, CONTACTS, GLIDE_SHARE, HOLD, JOINED_SHARE, LOWER_SHARE, MIN_HOLD_S, NEAR_FAPU, NEAR_SHARE, OPEN_FAPU,
  PAIRS, RAMP_S, RELEASE_S, SIBILANT_FAPU, SIDE_OPENING, SOFTNESS_FAPU, TEETH_FAPU, TOUCHES,
} = closures;
const { MAX_DURATION_S } = context;

export function holdOf({ start, end }, contact, isJoined) {
  const [begin, until] = HOLD[contact];
  const more = Math.max(end - start - MAX_DURATION_S, 0);
  const counted = end - start - more;
  let [from, to] = [start + begin * counted, start + until * counted + more];
  if (contact === "lips") to = isJoined ? start + JOINED_SHARE * (end - start) : to - BURST_S;
  if (TOUCHES.includes(contact) && to - from < MIN_HOLD_S) {
    from = Math.max(Math.min(from, end - MIN_HOLD_S), start);
    to = from + MIN_HOLD_S;
  }
  return { start: from, stop: to, contact };
}

// Nothing of it is seen before the edge; null if it is not a touch and is over by then.
export function holdLate({ stop, contact }, edge) {
  const start = edge + RAMP_S;
  if (!TOUCHES.includes(contact)) return start < stop ? { start, stop, contact } : null;
  return { start, stop: Math.max(stop, start + MIN_HOLD_S), contact };
}

export const holdUntil = ({ start, stop, contact }, end) => ({ start, stop: Math.min(stop, Math.max(end, start + MIN_HOLD_S)), contact });

// How far a moment is under a hold of each contact, 0 to 1.
export function heldAt(time, holds) {
  const free = Object.fromEntries(CONTACTS.map((contact) => [contact, 1]));
  for (const { start, stop, contact } of holds) {
    if (time >= start - RAMP_S && time < stop + RAMP_S) free[contact] *= 1 - bump(time, start, stop, RAMP_S, RELEASE_S[contact] ?? RAMP_S);
  }
  return Object.fromEntries(CONTACTS.map((contact) => [contact, 1 - free[contact]]));
}

// Makes contacts in 68 FAPs, in place. low, high: what can be coded.
export function settle(faps, { lips, teeth, open: vowels, jaw, glide }, low, high) {
  const free = (1 - teeth) * (1 - vowels);
  const limited = (value, number) => clamp(value, low[number - 1], high[number - 1]);
  faps[2] -= jaw * softPositive(faps[2] + SOFTNESS_FAPU / 2 - SIBILANT_FAPU, SOFTNESS_FAPU);
  PAIRS.forEach(([innerUpper, innerLower, outerUpper, outerLower], index) => {
    const [wishedUpper, wishedLower] = [faps[innerUpper - 1], faps[innerLower - 1]];
    let [upper, lower] = [limited(wishedUpper, innerUpper), limited(wishedLower, innerLower)];
    const scale = index ? SIDE_OPENING : 1;
    const parted = vowels * softPositive(scale * OPEN_FAPU + SOFTNESS_FAPU / 2 + upper + lower, SOFTNESS_FAPU);
    upper -= (1 - LOWER_SHARE) * parted;
    lower -= LOWER_SHARE * parted;
    upper *= 1 - BITTEN_SHARE * teeth;
    const short = softPositive(TEETH_FAPU + SOFTNESS_FAPU / 2 - lower, SOFTNESS_FAPU);
    const beyond = softPositive(lower + SOFTNESS_FAPU / 2 - BITTEN_FAPU, SOFTNESS_FAPU);
    lower += teeth * (short - beyond);
    const opening = -(upper + lower);
    const parting = softPositive(opening, SOFTNESS_FAPU);
    const near = NEAR_SHARE * free * (1 - smoothstep(parting / (scale * NEAR_FAPU)));
    const change = opening - (1 - lips) * (1 - GLIDE_SHARE * glide) * ((1 - near) * parting);
    const share = LOWER_SHARE * (1 - teeth);
    upper += (1 - share) * change;
    lower += share * change;
    const carried = limited(upper, innerUpper);
    const reached = lower + upper - carried;
    for (const number of [innerUpper, outerUpper]) faps[number - 1] += carried - wishedUpper;
    for (const number of [innerLower, outerLower]) faps[number - 1] += reached - wishedLower;
  });
}
