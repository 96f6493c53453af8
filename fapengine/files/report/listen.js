// A listening test: pairs of films in an order of each listener's own, attention checks, and a CSV of answers.
"use strict";

const config = JSON.parse(document.getElementById("config").textContent);
const at = (id) => document.getElementById(id);
const SIDES = ["left", "right"];

/** Keep a text on this computer; where storage is off, a reload begins anew. */
const kept = {
  read(key) { try { return localStorage.getItem(key); } catch { return null; } },
  write(key, text) { try { localStorage.setItem(key, text); } catch { /* nothing is kept */ } },
};

const listener = whoListens();
const place = `fapengine-listen-${config.id}-${listener}`;
const rows = JSON.parse(kept.read(place) ?? "[]");
const trials = plan(config, listener);
let sound = null;
let began = 0;
let plays = 0;
let seen = new Set();

/** Name of the listener: from the address (?listener=NAME), or one that was drawn once. */
function whoListens() {
  const given = new URLSearchParams(location.search).get("listener");
  if (given) return given.replace(/[^\w.-]/g, "_").slice(0, 60);
  const key = `fapengine-listener-${config.id}`;
  const name = kept.read(key) ?? crypto.getRandomValues(new Uint32Array(1))[0].toString(16).padStart(8, "0");
  kept.write(key, name);
  return name;
}

/** Random numbers in 0..1 that a text decides: FNV-1a, then mulberry32. */
function randomOf(text) {
  let state = 0x811c9dc5;
  for (const byte of new TextEncoder().encode(text)) state = Math.imul(state ^ byte, 0x01000193);
  return () => {
    state = (state + 0x6d2b79f5) | 0;
    let mixed = Math.imul(state ^ (state >>> 15), 1 | state);
    mixed = (mixed + Math.imul(mixed ^ (mixed >>> 7), 61 | mixed)) ^ mixed;
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 4294967296;
  };
}

/** Trials in the listener's order. Each system is on the left in half of them (of an odd number, chance decides which
 * is there once more); checks are spread evenly. */
function plan({ items, systems, checks, seed }, name) {
  const random = randomOf(`${seed} ${name}`);
  const shuffled = (list) => {
    const copy = [...list];
    for (let last = copy.length - 1; last > 0; last -= 1) {
      const other = Math.floor(random() * (last + 1));
      [copy[last], copy[other]] = [copy[other], copy[last]];
    }
    return copy;
  };
  const first = Math.floor(random() * 2);
  const swaps = shuffled(items.map((_, index) => (index + first) % 2));
  const list = shuffled(items).map(({ id, clips }, index) => {
    const order = swaps[index] ? [1, 0] : [0, 1];
    return { item: id, shown: order.map((one) => systems[one]), clips: order.map((one) => clips[one]), still: -1 };
  });
  const checked = shuffled(items);
  for (let number = 0; number < checks; number += 1) {
    const { id, clips } = checked[number % checked.length];
    const clip = clips[Math.floor(random() * 2)];
    const still = Math.floor(random() * 2);
    const shown = still ? ["moving", "still"] : ["still", "moving"];
    const where = Math.floor(((number + 0.5) / checks) * items.length) + number;
    list.splice(where, 0, { item: id, shown, clips: [clip, clip], still });
  }
  return list;
}

function show() {
  const done = rows.length >= trials.length;
  at("welcome").hidden = true;
  at("test").hidden = done;
  at("end").hidden = !done;
  if (done) {
    const link = at("save");
    link.href = URL.createObjectURL(new Blob([answers()], { type: "text/csv" }));
    link.download = `answers-${listener}.csv`;
    link.focus();
    return;
  }
  const trial = trials[rows.length];
  seen = new Set();
  plays = 0;
  began = performance.now();
  at("state").textContent = `Pair ${rows.length + 1} of ${trials.length}`;
  at("progress").max = trials.length;
  at("progress").value = rows.length;
  SIDES.forEach((side, index) => {
    at(side).src = trial.clips[index];
    at(`choose-${side}`).disabled = true;
  });
  at("play-left").focus();
}

function stop() {
  SIDES.forEach((side) => at(side).pause());
  sound?.pause();
  sound = null;
}

function play(index) {
  stop();
  plays += 1;
  const film = at(SIDES[index]);
  const isStill = trials[rows.length].still === index;
  film.currentTime = 0;
  sound = isStill ? new Audio(film.src) : null;  // the picture stands, the sound plays
  const source = sound ?? film;
  source.onended = () => {
    seen.add(index);
    if (seen.size === 2) SIDES.forEach((side) => { at(`choose-${side}`).disabled = false; });
  };
  source.play().catch((error) => { if (error.name !== "AbortError") complain(`The film does not play: ${error.message}`); });
}

function choose(index) {
  if (at(`choose-${SIDES[index]}`).disabled) return;
  stop();
  const { item, shown } = trials[rows.length];
  const seconds = ((performance.now() - began) / 1000).toFixed(1);
  rows.push([listener, config.seed, rows.length + 1, item, shown[0], shown[1], SIDES[index], seconds, plays]);
  kept.write(place, JSON.stringify(rows));
  show();
}

/** The answers as CSV. */
function answers() {
  const cell = (value) => (/[",\n]/.test(String(value)) ? `"${String(value).replaceAll('"', '""')}"` : String(value));
  return [config.columns, ...rows].map((row) => `${row.map(cell).join(",")}\n`).join("");
}

function complain(text) {
  at("trouble").textContent = text;
  at("trouble").hidden = false;
}

at("begin").addEventListener("click", show);
SIDES.forEach((side, index) => {
  at(`play-${side}`).addEventListener("click", () => play(index));
  at(`choose-${side}`).addEventListener("click", () => choose(index));
  at(side).addEventListener("error", () => complain("A film cannot be loaded."));
});
document.addEventListener("keydown", (event) => {
  if (at("test").hidden) return;
  const action = { 1: () => play(0), 2: () => play(1), ArrowLeft: () => choose(0), ArrowRight: () => choose(1) }[event.key];
  if (action) {
    event.preventDefault();
    action();
  }
});
