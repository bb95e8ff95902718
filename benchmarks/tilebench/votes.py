# SPDX-License-Identifier: Apache-2.0
"""The voting page: two tiles of one photo next to each other, which tool is unknown, and the votes as JSON."""

from __future__ import annotations

import json

_PAGE = """<!doctype html>
<html lang="en">
<!-- SPDX-License-Identifier: Apache-2.0 -->
<meta charset="utf-8">
<title>Which tile is better?</title>
<style>
  body { font: 16px sans-serif; margin: 1rem auto; max-width: 80rem; text-align: center; background: #ddd; color: #222 }
  figure { display: inline-block; margin: .5rem; vertical-align: top }
  button.tile { width: 34rem; height: 34rem; max-width: 46vw; max-height: 46vw; border: 3px solid #888; cursor: pointer;
    background-repeat: repeat; image-rendering: auto }
  button.tile:focus, button.tile:hover { border-color: #06c }
  #photo { width: 10rem }
</style>
<h1>Which tile is better?</h1>
<p>Each pane repeats one tile. Look for seams, repeats, broken structures, and texture that the photo does not have.
  Click the better one, or press <kbd>1</kbd>, <kbd>2</kbd>, or <kbd>0</kbd> if you see no difference.</p>
<p><img id="photo" alt="the photo"></p>
<figure><button class="tile" id="one" aria-label="first tile"></button><figcaption>1</figcaption></figure>
<figure><button class="tile" id="two" aria-label="second tile"></button><figcaption>2</figcaption></figure>
<p><button id="same">0: no difference</button> <span id="count"></span>
  <button id="save">Save the votes</button></p>
<script>
const tiles = TILES;
const votes = [];
const of = name => name.slice(0, -4).split("--");
const pairs = [];
for (let i = 0; i < tiles.length; i++)
  for (let j = i + 1; j < tiles.length; j++)
    if (of(tiles[i])[0] === of(tiles[j])[0])
      pairs.push(Math.random() < 0.5 ? [tiles[i], tiles[j]] : [tiles[j], tiles[i]]);
for (let i = pairs.length - 1; i > 0; i--) {
  const j = Math.floor(Math.random() * (i + 1));
  [pairs[i], pairs[j]] = [pairs[j], pairs[i]];
}
const get = id => document.getElementById(id);
function show() {
  const pair = pairs[votes.length];
  get("count").textContent = votes.length + " of " + pairs.length;
  if (!pair) return;
  get("photo").src = of(pair[0])[0] + ".png";
  get("one").style.backgroundImage = `url("${encodeURI(pair[0])}")`;
  get("two").style.backgroundImage = `url("${encodeURI(pair[1])}")`;
}
function vote(better) {
  const pair = pairs[votes.length];
  if (!pair) return;
  votes.push({ photo: of(pair[0])[0], first: of(pair[0])[1], second: of(pair[1])[1], better });
  show();
}
get("one").onclick = () => vote("first");
get("two").onclick = () => vote("second");
get("same").onclick = () => vote("same");
const keys = { 1: "first", 2: "second", 0: "same" };
document.onkeydown = event => { if (keys[event.key]) vote(keys[event.key]); };
get("save").onclick = () => {
  const link = document.createElement("a");
  const text = JSON.stringify({ schema: 1, votes }, null, 1);
  link.href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
  link.download = "votes.json";
  link.click();
};
show();
</script>
</html>
"""


def page(tiles: list[str]) -> str:
    """The page for tiles called PHOTO--TOOL.png in its folder; it loads nothing else."""
    return _PAGE.replace("TILES", json.dumps(tiles).replace("<", "\\u003c"))


def score(votes: list[dict[str, str]]) -> dict[str, float]:
    """Share of its pairs that each tool won; `same` counts half."""
    points: dict[str, list[float]] = {}
    for one in votes:
        worth = {"first": 1.0, "second": 0.0, "same": 0.5}[one["better"]]
        points.setdefault(one["first"], []).append(worth)
        points.setdefault(one["second"], []).append(1 - worth)
    return {tool: sum(won) / len(won) for tool, won in sorted(points.items())}
