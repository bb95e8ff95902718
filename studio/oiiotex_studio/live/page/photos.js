// SPDX-License-Identifier: Apache-2.0
// The open photos: a strip of links at the edge, files that are dropped or chosen, color spaces, and the batch.

import { button, make } from "./controls.js";
import { canvasOf, send } from "./wire.js";

const PIECE = 4 << 20; // bytes of a photo in one message
const IMAGE = /\.(exr|png|jpe?g|tiff?|hdr|webp|tga|bmp|psd|dpx)$/i;
const TYPES = ".exr,.png,.jpg,.jpeg,.tif,.tiff,.hdr,.webp,.tga,.bmp,.psd,.dpx";

/** The address of a photo's page, in the same tab. */
export const addressOf = (key) => `?photo=${encodeURIComponent(key)}${location.hash.split("/")[0]}`;

export class Photos {
  constructor(shell) {
    this.shell = shell;
    this.canvases = new Map(); // thumbnails by key
    this.refused = []; // files of this computer, until the others are opened
    this.waiting = null; // for the answer to a piece: { resolve, reject }
    this.input = make("input", { type: "file", multiple: true, accept: TYPES, hidden: true, ariaLabel: "Photos from this computer" });
    this.input.addEventListener("change", () => this.take([...this.input.files]));
    this.apply = button("Apply to all", "Use this photo's Tile parameters for all other photos, and save a tile of each next to its document", () => this.ask({ do: "apply", key: this.key }));
    this.cancel = button("Cancel", "Stop applying the parameters. Files that were saved are kept", () => this.ask({ do: "cancel" }));
    this.list = make("ul");
    this.element = document.getElementById("photos");
    this.element.append(this.list, this.apply, this.cancel);
    this.opening = make("dialog", { ariaLabel: "Open photos" });
    this.asking = make("dialog", { ariaLabel: "Color space" });
    this.welcome = make("div", { className: "welcome", hidden: true }, make("p", { textContent: "Drop photos here, or open them." }), button("Open photos", "Open photos from this computer or from the server's folder", () => this.open()), this.said = make("p", { className: "hint" }));
    document.body.append(this.input, this.opening, this.asking);
    document.getElementById("stage").append(this.welcome);
    document.getElementById("open").addEventListener("click", () => this.open());
    document.getElementById("ask").addEventListener("click", () => this.askSpace());
    addEventListener("dragover", (event) => {
      event.preventDefault();
      document.body.classList.add("dropping");
    });
    addEventListener("dragleave", (event) => { if (!event.relatedTarget) document.body.classList.remove("dropping"); });
    addEventListener("drop", (event) => {
      event.preventDefault();
      document.body.classList.remove("dropping");
      this.take([...event.dataTransfer.files]);
    });
  }

  ask(message, bytes) {
    return send({ room: "photos", ...message }, bytes);
  }

  /** Take the list of a new connection. */
  greet(facts) {
    this.key = facts.key;
    this.show(facts.photos);
    if (facts.photos.list.length > 1) this.ask({ do: "thumbnails" });
    if (this.own()?.asks) this.askSpace();
  }

  own() {
    return this.facts.list.find((one) => one.key === this.key);
  }

  /** A message about photos; false if it is about something else. */
  hear(message) {
    const told = this.waiting;
    if (message.do === "error" && told) {
      this.waiting = null;
      told.reject(new Error(message.text));
      return true;
    }
    if (message.do === "received" || message.do === "uploaded") {
      this.waiting = null;
      told?.resolve(message.name);
    } else if (message.do === "photos") this.show(message);
    else if (message.do === "photo") this.showProgress(message);
    else if (message.do === "files") this.offer(message.names);
    else if (message.do === "spaces") this.askWith(message);
    else if (message.do === "again") location.reload();
    else if (message.do === "opened") this.opened(message);
    else if (message.do === "closed") this.leave(message.photo, message.text);
    else return false;
    return true;
  }

  frame(facts, bytes) {
    this.canvases.set(facts.key, canvasOf(facts, bytes));
    this.show(this.facts);
  }

  /** Go to a photo that was opened, and say there what was not. */
  opened({ photo, refused }) {
    const text = [...this.refused.splice(0), ...refused].join("; ");
    if (photo !== null && photo !== this.key) this.leave(photo, text && `Not opened: ${text}`, true);
    else if (text) this.tell(`Not opened: ${text}`, true);
    else this.shell.status("This photo is already open");
  }

  /** Go to another photo, or to none, and say something there. */
  leave(key, text, wrong = false) {
    if (text) sessionStorage.setItem("said", JSON.stringify([text, wrong]));
    location.href = addressOf(key ?? "");
  }

  /** Say what the page has left to say. */
  tellLeft() {
    const said = sessionStorage.getItem("said");
    sessionStorage.removeItem("said");
    if (said) this.tell(...JSON.parse(said));
  }

  tell(text, wrong) {
    this.shell.status(text, wrong);
    this.said.textContent = text;
  }

  // --- the strip ---

  show(facts) {
    const news = this.facts && facts.list.some((one) => !this.facts.list.some((old) => old.key === one.key));
    this.facts = facts;
    if (news) this.ask({ do: "thumbnails" });
    this.element.hidden = facts.list.length < 2;
    this.welcome.hidden = facts.list.length > 0;
    this.said.textContent = `Photos from this computer are stored in ${facts.folder}`;
    document.getElementById("ask").hidden = !this.own()?.asks;
    this.apply.hidden = facts.working;
    this.cancel.hidden = !facts.working;
    const focused = document.activeElement.closest?.("#photos li")?.dataset.key;
    this.list.replaceChildren(...facts.list.map((one) => {
      const link = make("a", { href: addressOf(one.key), className: "photo", title: `${one.name}${one.roles.length ? `: color, ${one.roles.join(", ")}` : ""}${one.text ? `. ${one.text}` : ""}` });
      if (one.key === this.key) link.setAttribute("aria-current", "page");
      const maps = one.roles.length ? ` (${one.roles.length + 1} maps)` : "";
      link.append(this.canvases.get(one.key) ?? make("canvas", { width: 1, height: 1 }), make("span", { textContent: `${one.name}${maps}` }));
      const said = one.asks ? "no color space" : one.text;
      if (said) link.append(make("small", { textContent: said, className: one.wrong || one.asks ? "wrong" : "" }));
      if (one.text === "making") link.append(make("progress", { max: 1, value: one.done / one.total, ariaLabel: `Tile of ${one.name}` }));
      const close = button("×", `Close ${one.name}. Its document ${one.document} keeps the parameters, masks and paintings`, () => this.ask({ do: "close", key: one.key }), { className: "close", ariaLabel: `Close ${one.name}`, disabled: facts.working });
      const item = make("li", {}, link, close);
      item.dataset.key = one.key;
      return item;
    }));
    if (focused) (this.list.querySelector(`[data-key="${focused}"] a`) ?? this.list.querySelector("a")).focus();
  }

  showProgress({ key, done, total }) {
    const bar = this.list.querySelector(`[data-key="${CSS.escape(key)}"] progress`);
    if (bar) bar.value = done / total;
  }

  // --- opening ---

  open() {
    this.ask({ do: "files" });
  }

  /** Show the photos of the server's folder, and a button for those of this computer. */
  offer(names) {
    const open = new Set(this.facts.list.map((one) => one.name));
    const boxes = names.map((name) => {
      const box = make("input", { type: "checkbox", value: name });
      return make("label", {}, box, ` ${name}${open.has(name.replace(/\.[^.]*$/, "")) ? " (open)" : ""}`);
    });
    const chosen = () => boxes.map((one) => one.firstChild).filter((box) => box.checked).map((box) => box.value);
    const close = () => this.opening.close();
    this.opening.replaceChildren(
      make("h2", { textContent: "Open photos" }),
      make("p", { textContent: `${names.length ? "Photos" : "There are no photos"} in ${this.facts.folder}. Maps of one material are opened together, for example wall_color.png and wall_normal.png.` }),
      make("div", { className: "files" }, ...boxes),
      make("p", { className: "hint", textContent: "Photos from this computer are copied into this folder. You can also drop them on the page." }),
      make("form", { className: "buttons" },
        button("From this computer", "Choose photos from this computer", () => { close(); this.input.click(); }),
        button("Open", "Open the chosen photos", () => { close(); if (chosen().length) this.ask({ do: "open", names: chosen() }); }),
        button("Close", "Close without opening a photo", close)));
    this.opening.showModal();
  }

  /** Send files to the server, and open them. */
  async take(files) {
    const names = [];
    for (const file of files) {
      try {
        if (!IMAGE.test(file.name)) throw new Error(`${file.name}: expected an image (${TYPES.replaceAll(",", " ")})`);
        if (file.size > this.facts.most) throw new Error(`${file.name}: ${Math.ceil(file.size / 2 ** 20)} MB: expected at most ${this.facts.most >> 20} MB; copy the file to ${this.facts.folder} and open it from there`);
        names.push(await this.upload(file));
      } catch (error) {
        this.refused.push(error.message);
      }
    }
    this.input.value = "";
    if (names.length) this.ask({ do: "open", names });
    else if (this.refused.length) this.opened({ photo: null, refused: [] });
  }

  /** Send a file in pieces. Returns the name that it has on the server. */
  async upload(file) {
    let name;
    for (let offset = 0; name === undefined; offset += PIECE) {
      if (offset >= Math.max(1, file.size)) throw new Error(`${file.name}: the file is empty`);
      const bytes = new Uint8Array(await file.slice(offset, offset + PIECE).arrayBuffer());
      const answer = new Promise((resolve, reject) => { this.waiting = { resolve, reject }; });
      if (!this.ask({ do: "upload", name: file.name, size: file.size, offset }, bytes)) throw new Error(`${file.name}: the server is not connected`);
      this.shell.status(`Sending ${file.name}: ${Math.floor((100 * offset) / file.size)} %`);
      name = await answer;
    }
    this.shell.status("");
    return name;
  }

  // --- color spaces ---

  askSpace() {
    this.ask({ do: "spaces" });
  }

  askWith({ usual, others }) {
    const one = this.own();
    if (!one?.asks || this.asking.open) return;
    const option = (name) => make("option", { value: name, textContent: name });
    const select = make("select", { ariaLabel: "Color space" }, make("option", { value: "", textContent: "Choose ..." }),
      make("optgroup", { label: "Usual" }, ...usual.map(option)), make("optgroup", { label: "Others" }, ...others.map(option)));
    const untagged = this.facts.list.filter((other) => other.asks).length;
    const all = make("input", { type: "checkbox" });
    const use = button("Use", "Use this color space. The document keeps it", () => {
      this.asking.close();
      this.ask({ do: "space", key: this.key, space: select.value, all: all.checked });
    }, { disabled: true });
    select.addEventListener("change", () => { use.disabled = !select.value; });
    this.asking.replaceChildren(make("h2", { textContent: `Color space of ${one.name}` }),
      make("p", { textContent: "The file does not name its color space. Photos from cameras and from the web are usually sRGB, renders are usually linear, and normal and roughness maps are raw data." }),
      select,
      ...(untagged > 1 ? [make("label", {}, all, ` For all ${untagged} photos without a color space`)] : []),
      make("form", { className: "buttons" }, use, button("Later", "Close. To choose later, press Color space", () => this.asking.close())));
    this.asking.showModal();
  }
}
