// Read /fap/1/frame of docs/frames-out.md with any OSC library that gives address and args; mask is a Uint8Array.
const widths = n => (n === 1 ? 4 : n === 2 ? 6 : 1);
function onMessage({ address, args: [session, number, timeUs, mask, ...values] }) {
  if (address !== "/fap/1/frame") return;
  let next = 0;
  for (let n = 1; n <= 68; n++) {
    if (!(mask[(n - 1) >> 3] & (0x80 >> ((n - 1) & 7)))) continue;
    face.set(n, values.slice(next, (next += widths(n))));
  }
}
