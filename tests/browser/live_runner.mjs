// Plans streams and lists of phones, and recognizes sounds, with fapengine-face/live, for tests/browser/test_live.py: a JSON file in, one out.
//
//     node live_runner.mjs PACKAGE INPUT OUTPUT

import { readFile, writeFile } from "node:fs/promises";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const [folder, input, output] = process.argv.slice(2).map((name) => resolve(name));
const { Planner, Profile, Recognizer, planAll } = await import(pathToFileURL(join(folder, "live", "index.js")).href);
const bytes = async (name) => {
  const data = await readFile(name);
  return data.buffer.slice(data.byteOffset, data.byteOffset + data.byteLength);
};
const profile = new Profile(await bytes(join(folder, "assets", "planner.bin")));
const { streams = [], tracks = [], sounds = [], options } = JSON.parse(await readFile(input, "utf8"));

const played = ({ events, frames, rate, options, expression }) => {
  const planner = new Planner(profile, options);
  const waiting = [...events];
  const faps = [];
  for (let number = 0; number < frames; ++number) {
    while (waiting.length && waiting[0].at <= number / rate) {
      const event = waiting.shift();
      if (event.phones) planner.feed(event.phones);
      else planner.cancel(event.cancel, event.fade);
    }
    faps.push([...planner.frame(number / rate, undefined, expression)]);
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
const recognizer = sounds.length ? new Recognizer(await bytes(join(folder, "assets", "recognizer.bin")), options) : null;
const heard = sounds.map((sound) => recognized(sound, recognizer));
await writeFile(output, JSON.stringify({ streams: streams.map(played), tracks: tracks.map(planned), heard }));
