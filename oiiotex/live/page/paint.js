// SPDX-License-Identifier: Apache-2.0
// Room Paint: labels of the photo are painted, and become its texture.

import { make } from "./controls.js";

export class PaintRoom {
  constructor(shell) {
    this.shell = shell;
    this.element = make("div", { className: "room" });
  }

  refresh() {}
  frame() {}
  askLine() {}
}
