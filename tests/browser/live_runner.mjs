// Plans streams and lists of phones, recognizes sounds, follows them, glides and draws gestures with fapengine-face/live, for tests/browser/test_live.py: a JSON file in, one out.
//
//     node live_runner.mjs PACKAGE INPUT OUTPUT

import { readFile, writeFile } from "node:fs/promises";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const [folder, input, output] = process.argv.slice(2).map((name) => resolve(name));
const given = JSON.parse(await readFile(input, "utf8"));
if (given.isPlain) globalThis.WebAssembly = undefined; // as where a policy forbids it
const imported = (name) => import(pathToFileURL(join(folder, "live", name)).href);
const { Live, Planner, Profile, Recognizer, planAll } = await imported("index.js");
const bytes = async (name) => {
  const data = await readFile(name);
  return data.buffer.slice(data.byteOffset, data.byteOffset + data.byteLength);
};
const profile = new Profile(await bytes(join(folder, "assets", "planner.bin")));
const { streams = [], tracks = [], sounds = [], ramps = [], faces = [], said = [], followed = [] } = given;

const played = ({ events, frames, rate, options, expression, gestures }) => {
  const planner = new Planner(profile, options);
  const waiting = [...events];
  const faps = [];
  for (let number = 0; number < frames; ++number) {
    while (waiting.length && waiting[0].at <= number / rate) {
      const event = waiting.shift();
      if (event.phones) planner.feed(event.phones);
      else planner.cancel(event.cancel, event.fade);
    }
    faps.push([...planner.frame(number / rate, undefined, expression, gestures)]);
  }
  return { faps, counts: planner.counts };
};
const planned = ({ phones, options }) => {
  const { faps, unknown } = planAll(profile, phones, options);
  return { faps: faps.map((frame) => [...frame]), unknown };
};
const recognized = ({ samples, pieces }, recognizer) => {
  const sound = Int16Array.from(samples);
  const [phones, partials] = [[], []];
  for (let at = 0, piece = 0; at < sound.length; at += pieces[piece++ % pieces.length]) {
    phones.push(...recognizer.push(sound.subarray(at, at + pieces[piece % pieces.length])));
    partials.push(recognizer.partial);
  }
  return { phones: [...phones, ...recognizer.end()], partials };
};
const recognizer = sounds.length ? new Recognizer(await bytes(join(folder, "assets", "recognizer.bin"))) : null;
const heard = sounds.map((sound) => recognized(sound, recognizer));
const { Ramp } = await imported("ramp.js");
const glided = ({ events, times }) => {
  const ramp = new Ramp();
  for (const { goal, at, over, takesOver } of events) (takesOver ? ramp.to : ramp.then).call(ramp, goal, at, over);
  return times.map((time) => ramp.value(time));
};
const { Gestures } = await imported("gestures.js");
const drawn = ({ seed, phones, times }) => {
  const gestures = new Gestures(seed, 0);
  return times.map((time) => {
    gestures.draw(time, phones.filter(({ known }) => known <= time), 0);
    const faps = gestures.faps(time);
    gestures.vary(faps, time, 1);
    return [...faps];
  });
};
// A face that says phones, at times of its clock: its FAPs.
const say = async ({ phones, times, style }) => {
  const [live, faps] = [await Live.make({ still: true, ...style }), new Float32Array(68)];
  let now = 0;
  live.say(phones, { clock: () => now });
  return times.map((time) => {
    now = time;
    live.sample(performance.now() / 1000, faps);
    return [...faps];
  });
};
// A face that follows sound in pieces of 10 ms, with a frame after each: what it tells, [position, FAP 4, FAP 5], and how
// many nods it makes.
const follow = async ({ samples, rate, delay, cancelAt, still = true }) => {
  const [live, faps, told] = [await Live.make({ still, seed: 1 }), new Float32Array(68), []];
  for (const type of ["started", "phone", "finished", "cancelled", "error"]) {
    live.addEventListener(type, ({ detail }) => told.push([type, detail?.label ?? null, live.position]));
  }
  const frames = [];
  const sound = Float32Array.from(samples, (sample) => sample / 32768);
  for (let at = 0; at < sound.length; at += rate / 100) {
    await live.push(sound.subarray(at, at + rate / 100), rate, { delay });
    live.sample(at / rate, faps);
    frames.push([live.position, faps[3], faps[4]]);
    if (cancelAt && at === cancelAt * rate) live.cancel();
  }
  live.express("joy");
  const joy = live.sample(performance.now() / 1000 + 9, faps) && faps[11];
  const weights = await new Promise((done) => (live.onweights = (arkit, these) => done([arkit.length, these.length])));
  live.close();
  return { told, frames, joy, weights, nods: live.gestures?.random[4].drawn };
};
await writeFile(output, JSON.stringify({ streams: streams.map(played), tracks: tracks.map(planned), heard, glided: ramps.map(glided), drawn: faces.map(drawn), said: await Promise.all(said.map(say)), followed: await Promise.all(followed.map(follow)) }));
