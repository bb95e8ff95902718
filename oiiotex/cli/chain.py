# SPDX-License-Identifier: Apache-2.0
"""The image stack: runs the actions of a command line one after the other."""

from __future__ import annotations

import logging
import os

from ..color import TAG
from ..errors import Error, ParameterError
from ..images import Image, read, tagged, type_named, without_nonfinite, write
from ..params import parse_modifiers
from ..session import Session
from .parse import Action

log = logging.getLogger("oiiotex")


class ActionError(Error):
    """An error together with the action that raised it."""

    def __init__(self, action: Action, cause: Error):
        super().__init__(f"{action.word.split(':')[0]} : {cause}" if action.word.startswith("-") else str(cause))


class Chain:
    """A stack of images and what is to be done with it."""

    def __init__(self, session: Session):
        self._session = session
        self._stack: list[Image] = []
        self._waiting: list[Action] = []  # ops that lack operands yet: infix order works
        self._pixel_type = None
        self._unwritten = False

    def run(self, actions: tuple[Action, ...]) -> None:
        """Do all actions.

        Raises
        ------
        ActionError
            One failed; its text names it.
        """
        for action in actions:
            if action.op is not None:
                self._waiting.append(action)
            else:
                if action.option != "-i":
                    self._nothing_waits()
                try:
                    self._do(action)
                except Error as error:
                    raise ActionError(action, error) from error
            self._run_waiting()
        self._nothing_waits()
        if self._unwritten:
            log.warning("nothing was written: did you forget -o?")

    def _do(self, action: Action) -> None:
        argument = action.arguments[0] if action.arguments else ""
        if action.option == "-i":
            log.info("read %s", argument)
            self._push(read(argument))
        elif action.option == "-d":
            self._pixel_type = type_named(argument)
        elif action.option == "-o":
            self._write(argument)
        elif action.option == "--iscolorspace":
            self._push(tagged(self._pop(), TAG, self._session.color.resolve(argument)))
        elif action.option == "--fixnan":
            self._push(without_nonfinite(self._pop(), argument))

    def _nothing_waits(self) -> None:
        """Refuse to go on past an op that still lacks operands: what follows would happen to the wrong image."""
        if self._waiting:
            action = self._waiting[0]
            need = len(action.op.images())  # type: ignore[union-attr]
            raise ActionError(action, ParameterError(f"takes {need} image(s), there are {len(self._stack)}"))

    def _run_waiting(self) -> None:
        while self._waiting and len(self._stack) >= len(self._waiting[0].op.images()):  # type: ignore[union-attr]
            action = self._waiting.pop(0)
            assert action.op is not None
            try:
                images = action.op.images()
                operands = self._stack[-len(images) :]
                given = {declared.name: image for declared, image in zip(images, operands, strict=True)}
                op = action.op(**given, **parse_modifiers(action.op, action.modifiers))
                log.info("%s on %s", action.word, ", ".join(image.source for image in operands))
                result = op.compute(self._session)
            except Error as error:
                raise ActionError(action, error) from error
            del self._stack[-len(images) :]
            self._push(result)
            self._unwritten = True

    def _write(self, path: str) -> None:
        if not self._stack:
            raise ParameterError("there is no image to write")
        if os.path.realpath(path) in self._session.written:
            raise ParameterError(f"{path} has just been written by an op's modifier")
        with self._session.stats.time("write"):
            write(self._stack[-1], path, self._pixel_type)
        log.info("wrote %s", path)
        self._unwritten = False

    def _push(self, image: Image) -> None:
        self._stack.append(image)

    def _pop(self) -> Image:
        if not self._stack:
            raise ParameterError("there is no image to work on")
        return self._stack.pop()
