// The recognizer in a thread of its own: pieces of sound in by a port, phones out. design/live_tables.py joins it with
// what it imports to worker.js, one file, which bundlers may copy and a content security policy may name.

import { protocol } from "./constants.js";
import { Recognizer } from "./recognizer.js";

globalThis.onmessage = ({ data: { tables, port, options } }) => {
  const recognizer = new Recognizer(tables, options);
  recognizer.push(new Int16Array(protocol.RATE_HZ)); // so that the browser has compiled it when sound comes
  recognizer.reset();
  port.onmessage = ({ data }) => {
    const before = recognizer.scores.seen;
    const final = recognizer.push(data);
    if (recognizer.scores.seen === before) return;
    postMessage({ final, partial: recognizer.partial, heard: recognizer.came / protocol.RATE_HZ });
  };
  postMessage({ isReady: true });
};
