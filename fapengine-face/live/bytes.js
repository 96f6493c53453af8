// Content of a file of the package: in a page by fetch, in Node from the disk.
export async function bytesOf(address) {
  const url = new URL(address, globalThis.document?.baseURI);
  if (url.protocol === "file:" && globalThis.process) {
    const files = "node:fs/promises"; // a name that bundlers for pages do not look for
    const data = await (await import(/* @vite-ignore */ /* webpackIgnore: true */ files)).readFile(url);
    return data.buffer.slice(data.byteOffset, data.byteOffset + data.byteLength);
  }
  const answer = await fetch(url);
  if (!answer.ok) throw new Error(`${url}: got ${answer.status}`);
  return answer.arrayBuffer();
}
