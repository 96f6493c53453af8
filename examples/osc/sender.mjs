// Say "mama" by the reliable protocol of docs/osc.md, in Node, without a library: node sender.mjs
import dgram from "node:dgram";
const socket = dgram.createSocket("udp4");

const padded = bytes => Buffer.concat([bytes, Buffer.alloc(4 - (bytes.length % 4))]);   // one zero byte at least
const write = {
  s: text => padded(Buffer.from(text)),
  i: value => { const b = Buffer.alloc(4); b.writeInt32BE(value); return b; },
  h: value => { const b = Buffer.alloc(8); b.writeBigInt64BE(BigInt(value)); return b; },
  f: value => { const b = Buffer.alloc(4); b.writeFloatBE(value); return b; },
};
const send = (address, types, ...values) =>
  socket.send(Buffer.concat([write.s(address), write.s("," + types), ...[...types].map((t, n) => write[t](values[n]))]),
    9110, "127.0.0.1");

const phones = [["m", 0, 80000], ["ɑ", 80000, 120000], ["m", 200000, 80000], ["ɑ", 280000, 120000]];
send("/fap/1/hello", "sissi", "anna", 1, "ipa", "en", 1);
send("/fap/1/utt/begin", "siis", "anna", 1, 0, "now");
send("/fap/1/phones", "siiii" + "siiif".repeat(phones.length), "anna", 1, 0, 0, phones.length,
  ...phones.flatMap(([label, start, duration]) => [label, start, duration, 0, 1]));
send("/fap/1/utt/end", "sii", "anna", 1, phones.length);

socket.on("message", packet => {                          // the kind of an event is its third argument
  const address = packet.toString("latin1", 0, packet.indexOf(0));
  if (address === "/fap/1/event" && packet.includes("finished")) socket.close();
});
