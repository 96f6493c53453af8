// HeadAudio on one sound, from npm (MIT): node rival_headaudio.mjs FOLDER < PCM > JSON [[seconds, viseme], ...]
// FOLDER is where `make oracles` installed it; PCM is mono, 16 bit, 16 kHz. Its processor runs as in a browser's audio
// worklet, with its own model and defaults: blocks of 128 samples in, a viseme every 16 ms out.
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { pathToFileURL } from "node:url";

const NAMES = ["aa", "E", "I", "O", "U", "PP", "SS", "TH", "DD", "FF", "kk", "nn", "RR", "CH", "sil"];
const BLOCK = 128, RATE_HZ = 16000;

const home = join(process.argv[2], "node_modules", "@met4citizen", "headaudio");
const load = (name) => import(pathToFileURL(join(home, "modules", name)));
const { Processor } = await load("processor.mjs");
const { Training } = await load("training.mjs");

const told = [];
const port = {
  postMessage: (message) => {
    if (message.event === "viseme" && message.viseme !== null) told.push([message.t, NAMES[message.viseme]]);
    if (message.event === "ended") told.push([message.t, "sil"]);
  },
};
const processor = new Processor({ sampleRate: RATE_HZ }, { port });
const bytes = readFileSync(join(home, "dist", "model-en-mixed.bin"));
globalThis.fetch = async () => new Response(bytes);
const { model } = await new Training().loadModel("model-en-mixed.bin");
processor._onmessage({ data: { event: "model", model } });

const pcm = readFileSync(0);
const samples = new Int16Array(pcm.buffer, pcm.byteOffset, pcm.length >> 1);
for (let at = 0; at < samples.length; at += BLOCK) {
  processor.process(Float32Array.from(samples.subarray(at, at + BLOCK), (value) => value / 32768));
}
process.stdout.write(JSON.stringify(told));
