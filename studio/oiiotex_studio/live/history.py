# SPDX-License-Identifier: Apache-2.0
"""The history of a document: changes of parameters, masks and paintings in one order, for undo and redo."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, TypedDict

from oiiotex.engine.errors import ParameterError

from ..api.files import Allowed, read_as

MOST_STEPS = 2000  # older ones are forgotten; the files of masks and paintings are kept

Values = dict[str, Any]


class _Change(TypedDict):
    room: str
    name: str
    before: Any
    after: Any


class _Step(TypedDict):
    text: Annotated[str, Allowed(most=200)]
    changes: list[_Change]


class _History(TypedDict):
    at: Annotated[int, Allowed(0, MOST_STEPS)]
    steps: Annotated[list[_Step], Allowed(most=MOST_STEPS)]


class History:
    """Steps and a position among them. Undone steps are not lost: a new step first adds one that undoes them.

    `at`: the number of steps that are in effect.
    """

    def __init__(self) -> None:
        self.steps, self.at = list[_Step](), 0
        self._gesture: object = None  # what the last step came from

    def read(self, content: object, checked: Callable[[str, Values], Values]) -> None:
        """Replace the steps by those of a document; `checked(room, values)` returns valid values."""
        said = read_as(_History, content, "history", ParameterError)
        for step in said["steps"]:
            for change in step["changes"]:
                for when in ("before", "after"):
                    change |= {when: checked(change["room"], {change["name"]: change[when]})[change["name"]]}
        self.steps, self.at, self._gesture = said["steps"], min(said["at"], len(said["steps"])), None

    def content(self) -> Values:
        """The content for the document."""
        return {"at": self.at, "steps": self.steps}

    def record(self, room: str, before: Mapping[str, Any], after: Values, text: str, gesture: object) -> None:
        """Add a change. Changes of one gesture (the drag of a slider, a stroke) are one step; None: never the same."""
        changes: list[_Change] = [
            {"room": room, "name": name, "before": before[name], "after": value} for name, value in after.items()
        ]
        if self.at < len(self.steps):
            undone = [change for step in reversed(self.steps[self.at :]) for change in reversed(step["changes"])]
            back: list[_Change] = [change | {"before": change["after"], "after": change["before"]} for change in undone]
            self.steps.append({"text": "Return to an earlier step", "changes": _joined(back)})
        elif self.steps and gesture is not None and gesture == self._gesture:
            last = self.steps.pop()
            changes, text = last["changes"] + changes, text or last["text"]
        changes = _joined(changes)
        if changes:
            text = text or ", ".join(dict.fromkeys(change["name"] for change in changes))
            self.steps.append({"text": text[:200], "changes": changes})
        del self.steps[: max(0, len(self.steps) - MOST_STEPS)]
        self.at, self._gesture = len(self.steps), gesture

    def go(self, forward: bool) -> tuple[str, dict[str, Values]] | None:
        """Move by one step. Returns its text, and values to set by room; None at the end."""
        n = self.at if forward else self.at - 1
        if not 0 <= n < len(self.steps):
            return None
        step, values = self.steps[n], dict[str, Values]()
        for change in step["changes"]:
            values.setdefault(change["room"], {})[change["name"]] = change["after" if forward else "before"]
        self.at, self._gesture = n + forward, None
        return step["text"], values

    def facts(self) -> Values:
        """Names of the steps that undo and redo would change; '' if there are none."""
        texts = [step["text"] for step in self.steps]
        return {"undo": texts[self.at - 1] if self.at else "", "redo": "".join(texts[self.at : self.at + 1])}


def _joined(changes: list[_Change]) -> list[_Change]:
    """One change for each value, from the first to the last; none where both are equal."""
    joined: dict[tuple[str, str], _Change] = {}
    for change in changes:
        key = change["room"], change["name"]
        joined[key] = change | {"before": joined[key]["before"]} if key in joined else change
    return [change for change in joined.values() if change["before"] != change["after"]]
