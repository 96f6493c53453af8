// Rhubarb Lip Sync on one sound, its WebAssembly build from npm (MIT): node rival_rhubarb.cjs FOLDER [TEXT] < PCM > JSON
// FOLDER is where `make oracles` installed it; PCM is mono, 16 bit, 16 kHz.
const { join } = require("node:path");
const { readFileSync } = require("node:fs");

async function main() {
  const [folder, text] = process.argv.slice(2);
  const { Rhubarb } = await import(join(folder, "node_modules", "rhubarb-lip-sync-wasm", "dist", "index.js"));
  const found = await Rhubarb.getLipSync(readFileSync(0), text ? { dialogText: text } : {});
  process.stdout.write(JSON.stringify({ mouthCues: found.mouthCues }));
}

main().then(() => process.exit(0), (error) => {
  process.stderr.write(`${error}\n`);
  process.exit(1);
});
