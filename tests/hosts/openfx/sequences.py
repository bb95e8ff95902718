# SPDX-License-Identifier: Apache-2.0
"""Random sequences of actions, as a program: `python -m tests.hosts.openfx.sequences FILE SEED COUNT KILLS`.

It prints how many sequences ended, how many renders succeeded, and how often the resident process was killed.
"""

from __future__ import annotations

import os
import random
import signal
import sys
import threading
from collections import Counter
from pathlib import Path

import numpy as np

from oiiotex.engine.session import Session
from oiiotex.oiiotool.service.client import connect
from oiiotex.oiiotool.service.settings import ResidentSettings
from tests.hosts.openfx.conftest import SPACE, photo
from tests.hosts.openfx.host import COMPONENTS, DEPTHS, OK, Host, Image, Node

STATUS = {*range(16), 1000, 1001}  # that OpenFX knows
_ACTIONS = (
    "OfxImageEffectActionGetClipPreferences", "OfxImageEffectActionGetRegionOfDefinition",
    "OfxImageEffectActionGetRegionsOfInterest", "OfxImageEffectActionGetFramesNeeded",
    "OfxImageEffectActionIsIdentity", "OfxImageEffectActionGetOutputColourspace", "OfxActionInstanceChanged",
    "OfxImageEffectActionBeginSequenceRender", "OfxActionPurgeCaches", "OfxActionSyncPrivateData", "no such action",
)  # fmt: skip


class Sequences:
    """Random sequences of actions on the nodes of a host."""

    def __init__(self, file: Path, seed: int):
        self.random, self.host, self.statuses = random.Random(seed), Host(file), Counter[tuple[str, int]]()
        self.killers: list[threading.Timer] = []

    def image(self) -> Image:
        """Pixels of any layout."""
        width, height = self.random.randint(1, 40), self.random.randint(1, 40)
        channels, dtype = self.random.choice(list(COMPONENTS)), np.dtype(self.random.choice(list(DEPTHS)))
        pixels = np.resize(photo(48, 48), (height, width, channels))
        pixels = (pixels * (255 if dtype == np.uint8 else 1)).astype(dtype)
        corner = self.random.randint(-50, 50), self.random.randint(-50, 50)
        return Image(self.host, pixels, corner, self.random.choice((0, 4, 60)), self.random.random() < 0.5)

    def change(self, node: Node) -> None:
        """Set a parameter to anything of its type, or connect or disconnect a clip."""
        if self.random.random() < 0.3 and node.clips:
            clip = node.clips[self.random.choice(list(node.clips))]
            clip.connect(None if self.random.random() < 0.2 else self.image())
            return
        parameter = node.parameters[self.random.choice(list(node.parameters))]
        word = self.random.choice(("", "x", "3", "1,2,3,4,5,6,7,8", SPACE, "a b:c", "\u20ac" * 40))
        number = self.random.choice((-(2**31), -1, 0, 1, 2, 3, 7, 100, 2**31 - 1))
        kinds = {bytes: word, float: float(number) / 3}
        parameter.set(*(kinds.get(type(value), number) for value in parameter.values))

    def render(self, node: Node) -> int:
        """Render a window into an image of any layout; nothing else may be written."""
        out = self.image()
        left, bottom = (self.random.randint(-60, 60) for _ in range(2))
        window = left, bottom, left + self.random.randint(0, 60), bottom + self.random.randint(0, 60)
        if self.random.random() < 0.5:
            window = tuple(out["OfxImagePropBounds"])
        asked = iter([False] * self.random.choice((0, 1, 3, 100000)))
        node.abort = lambda: next(asked, True)
        scale = self.random.choice((1.0, 0.5, 1 / 3, 0.0))
        status = self.host.render(node, window, out, float(self.random.randint(-3, 3)), (scale, scale))
        assert out.guarded(), window
        return status

    def run(self) -> None:
        """One sequence on one instance."""
        name = self.random.choice(list(self.host.plugins))
        node = self.host.instance(name, self.random.choice(("Filter", "General", "Generator")))
        if self.random.random() < 0.6:
            node.parameters["colorspace"].set(SPACE)
        if self.random.random() < 0.8:
            node.clips["Source"].connect(self.image())
        for _ in range(self.random.randint(1, 8)):
            kind = self.random.random()
            if kind < 0.4:
                self.change(node)
                continue
            action = "render" if kind < 0.6 else self.random.choice(_ACTIONS)
            if action == "render":
                status = self.render(node)
            else:
                given = {"OfxPropTime": 0.0, "OfxPropChangeReason": "OfxChangeUserEdited"}
                given["OfxPropName"] = self.random.choice(list(node.parameters))
                status, _ = node.ask(action, **given)
            assert status in STATUS, (action, status)
            assert all("\n" not in text for text in node.messages), node.messages
            self.statuses[action, status] += 1
        assert node.do("OfxActionDestroyInstance") in STATUS

    def kill_soon(self) -> None:
        """Kill the resident process during one of the next sequences."""
        for killer in self.killers[-1:]:
            killer.join()
        client = connect(ResidentSettings.of(Session(device_name=None)))
        words = client.hello()["pid"], signal.SIGKILL
        client.close()
        self.killers.append(threading.Timer(self.random.random() / 4, os.kill, words))
        self.killers[-1].start()


def main(file: str, seed: str, count: str, kills: str) -> None:
    """Run sequences; the process is killed `kills` times meanwhile."""
    sequences = Sequences(Path(file), int(seed))
    for number in range(int(count)):
        sequences.run()
        if int(kills) and number % (int(count) // int(kills)) == 0:
            sequences.kill_soon()
    for killer in sequences.killers[-1:]:
        killer.join()
    host = sequences.host
    assert host.wrong == [] and host.taken == 0, (host.wrong[:3], host.taken)
    host.unload()
    rendered = sequences.statuses["render", OK]
    print(f"{count} sequences, {rendered} renders, {len(sequences.killers)} kills")
    print(dict(sequences.statuses), file=sys.stderr)


if __name__ == "__main__":
    main(*sys.argv[1:])
