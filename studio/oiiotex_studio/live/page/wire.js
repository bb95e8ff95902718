// SPDX-License-Identifier: Apache-2.0
// The connection to the server: JSON in both directions, images as binary frames. It reconnects by itself.

const listeners = { message: [], frame: [], link: [] };
let socket = null;
let wait = 200;

/** Listen for 'message' (object), 'frame' (facts, bytes) or 'link' (true when connected). */
export function on(kind, listener) {
  listeners[kind].push(listener);
}

function say(kind, ...what) {
  for (const listener of listeners[kind]) listener(...what);
}

/** Send an object, followed by bytes. False, and nothing sent, while disconnected: the server resends its state later. */
export function send(message, bytes) {
  if (!socket || socket.readyState !== WebSocket.OPEN) return false;
  const text = JSON.stringify(message);
  if (!bytes) {
    socket.send(text);
    return true;
  }
  const head = new TextEncoder().encode(text);
  const frame = new Uint8Array(4 + head.length + bytes.length);
  new DataView(frame.buffer).setUint32(0, head.length, true);
  frame.set(head, 4);
  frame.set(bytes, 4 + head.length);
  socket.send(frame);
  return true;
}

function unpack(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const facts = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  return [facts, new Uint8Array(buffer, 4 + length)];
}

/** Connect, and reconnect whenever the connection closes. */
export function connect() {
  const url = new URL("wire", location.href);
  url.protocol = "ws:";
  const tab = url.hash.slice(1).split("/")[0];
  url.hash = "";
  url.search = location.search; // names the photo
  if (tab) url.searchParams.set("tab", tab); // whose work comes first
  socket = new WebSocket(url);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => { wait = 200; say("link", true); };
  socket.onmessage = (event) => {
    if (typeof event.data === "string") say("message", JSON.parse(event.data));
    else say("frame", ...unpack(event.data));
  };
  socket.onclose = () => {
    say("link", false);
    setTimeout(connect, wait);
    wait = Math.min(3000, wait * 1.5);
  };
}

/** A frame's pixels as a canvas. */
export function canvasOf(facts, bytes) {
  const { width, height, channels } = facts;
  const image = new ImageData(width, height);
  const out = new Uint32Array(image.data.buffer);
  if (channels === 3) {
    for (let n = 0, i = 0; n < out.length; n++, i += 3)
      out[n] = 0xff000000 | bytes[i] | (bytes[i + 1] << 8) | (bytes[i + 2] << 16);
  } else {
    for (let n = 0; n < out.length; n++) out[n] = 0xff000000 | (bytes[n] * 0x010101);
  }
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height;
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}
