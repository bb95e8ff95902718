# SPDX-License-Identifier: Apache-2.0
"""Errors by their fields: which parameter, which value, what is expected; not by the sentence around them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import pytest

from oiiotex.engine.errors import Error, shown, spelled


@contextlib.contextmanager
def refused(kind: type[Error] = Error, **fields: object) -> Iterator[pytest.ExceptionInfo[Error]]:
    """Expect an error of a kind whose fields are these; the value as the error prints it."""
    with pytest.raises(kind) as caught:
        yield caught
    error = caught.value
    if "value" in fields:
        assert error.value is not ..., error
        assert shown(error.value, error.words) == shown(fields.pop("value"), error.words), error
    assert {name: _plain(getattr(error, name), error) for name in fields} == fields, error


def _plain(field: Any, error: Error) -> object:
    """A field as a test writes it: a text without marks, an array as a list."""
    return spelled(field, error.words) if isinstance(field, str) else getattr(field, "tolist", lambda: field)()
