// SPDX-License-Identifier: Apache-2.0
// What a room saves: file name, pixel type, the command that makes the same file, and a download of the saved file.

import { choice, make, section, words } from "./controls.js";

const TYPES = [["uint8", "8-bit"], ["uint16", "16-bit"], ["half", "16-bit float"], ["float", "32-bit float"]];
const NAME = /^[^./\\][^/\\]*\.(png|exr|tiff?|jpe?g)$/;

export class Output {
  /** `name`: the document's value with the file name. `buttons`: those that save. */
  constructor(shell, name, buttons) {
    this.shell = shell;
    this.name = name;
    this.file = words("File", { title: "Name of the file in the document's folder: .png, .exr, .tif or .jpg. Empty: automatic", change: (text) => this.rename(text) });
    this.type = choice("Type", { title: "Pixel type of the file", options: [], change: (type) => shell.set("output", { type }) });
    this.line = make("textarea", { className: "line", readOnly: true, rows: 3, spellcheck: false, ariaLabel: "Command that makes this file", title: "The command that makes this file. Copy it with C" });
    this.downloads = make("span", { className: "downloads" });
    this.element = section("Save", this.file, this.type, make("div", { className: "buttons" }, ...buttons, this.downloads), this.line);
  }

  rename(text) {
    if (text && !NAME.test(text)) this.shell.status(`File: ${text}: expected a name without a folder that ends with .png, .exr, .tif or .jpg`, true);
    else this.shell.set("output", { [this.name]: text });
  }

  refresh() {
    const { output } = this.shell.state;
    if (document.activeElement !== this.file.field) this.file.field.value = output[this.name];
    const own = TYPES.find(([type]) => type === this.shell.facts.type)?.[1] ?? this.shell.facts.type;
    this.type.offer([["", `As photo: ${own}`], ...TYPES]);
    this.type.set(output.type);
  }

  /** Show the command, and the name that it writes. */
  show(line) {
    this.line.value = line;
    this.file.field.placeholder = line.slice(line.lastIndexOf(" -o ") + 4);
  }

  /** Offer a saved file as a download, next to the other maps that were saved with it. */
  offer(name) {
    this.downloads.append(make("a", { className: "download", href: `saved/${encodeURIComponent(name)}`, download: name, textContent: `Download ${name}` }));
    while (this.downloads.children.length > (this.name === "tile" ? 1 + this.shell.facts.maps.length : 1)) this.downloads.firstChild.remove();
  }
}
