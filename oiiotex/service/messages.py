# SPDX-License-Identifier: Apache-2.0
"""Messages between the resident process and its clients: JSON on a Unix socket, arrays as shared memory beside it.

A message is 8 bytes (`MAGIC` with the version, length of the text), the text, and a file descriptor for each array:
sealed memory that belongs to nobody's name, so that nothing is left behind whoever dies.
"""

from __future__ import annotations

import fcntl
import json
import mmap
import os
import socket
import struct
import threading
from collections.abc import Sequence
from typing import Any

from ..deferred import np
from ..errors import Error, ImageError

VERSION = 1
_MAGIC = b"oxs" + bytes([VERSION])
_HEADER = struct.Struct("<4sI")
_MOST_TEXT = 16 << 20  # bytes
_MOST_ARRAYS = 64  # of a message
_SEALS = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_WRITE


class LinkError(Error):
    """The other side has ended, or speaks another version."""


class Link:
    """One end of a connection. Any thread may send; one receives.

    Parameters
    ----------
    connection : socket.socket
        A connected Unix socket.
    """

    def __init__(self, connection: socket.socket):
        self._socket = connection
        self._sending = threading.Lock()

    def send(self, facts: dict[str, Any], arrays: Sequence[np.ndarray] = ()) -> None:
        """Send a message.

        Raises
        ------
        LinkError
            Nobody listens any more.
        """
        layout = [{"type": array.dtype.str, "shape": list(array.shape)} for array in arrays]
        text = json.dumps(facts | {"arrays": layout}).encode()
        if len(text) > _MOST_TEXT or len(arrays) > _MOST_ARRAYS:
            raise ImageError("the message is too large for the resident process")
        memories: list[int] = []
        try:
            for array in arrays:
                memories.append(_shared(array))
            with self._sending:
                header = _HEADER.pack(_MAGIC, len(text))
                if socket.send_fds(self._socket, [header], memories) != len(header):
                    raise LinkError("the connection to the resident process is broken")
                self._socket.sendall(text)
        except OSError as error:
            raise LinkError(f"the resident process has ended: {error.strerror}") from error
        finally:
            for memory in memories:
                os.close(memory)

    def receive(self) -> tuple[dict[str, Any], list[np.ndarray]]:
        """Wait for a message: its facts and its arrays, which cannot be written.

        Raises
        ------
        LinkError
            Nobody sends any more, or what comes is no message of this version.
        """
        memories: list[int] = []
        try:
            header = b""
            while len(header) < _HEADER.size:
                piece, more, _, _ = socket.recv_fds(self._socket, _HEADER.size - len(header), _MOST_ARRAYS)
                memories += more
                if not piece:
                    raise LinkError("the resident process has ended")
                header += piece
            magic, length = _HEADER.unpack(header)
            if magic != _MAGIC or length > _MOST_TEXT:
                raise LinkError("the resident process is of another version of oiiotex: end it and try again")
            facts = json.loads(self._exactly(length))
            layout = facts.pop("arrays")
            if len(layout) != len(memories):
                raise LinkError("a message of the resident process has lost its arrays")
            return facts, [_array(m, one["type"], one["shape"]) for m, one in zip(memories, layout, strict=True)]
        except OSError as error:
            raise LinkError(f"the resident process has ended: {error.strerror}") from error
        except (ValueError, KeyError, TypeError) as error:
            raise LinkError("what came from the resident process is no message") from error
        finally:
            for memory in memories:
                os.close(memory)

    def _exactly(self, length: int) -> bytearray:
        text, at = bytearray(length), 0
        while at < length:
            count = self._socket.recv_into(memoryview(text)[at:])
            if not count:
                raise LinkError("the resident process has ended")
            at += count
        return text

    def close(self) -> None:
        """Hang up: who receives is told."""
        try:
            self._socket.shutdown(socket.SHUT_RDWR)
        except OSError:  # the other side was first
            pass
        self._socket.close()


def _shared(array: np.ndarray) -> int:
    """A descriptor of sealed memory that holds the array's bytes."""
    memory = os.memfd_create("oiiotex", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    try:
        left = memoryview(np.ascontiguousarray(array).reshape(-1).view(np.uint8))
        while left:
            left = left[os.write(memory, left) :]
        fcntl.fcntl(memory, fcntl.F_ADD_SEALS, _SEALS)
    except BaseException:
        os.close(memory)
        raise
    return memory


def _array(memory: int, kind: str, shape: list[int]) -> np.ndarray:
    """The array in sealed memory, which lives as long as the array."""
    dtype = np.dtype(kind)
    if dtype.hasobject or any(not isinstance(n, int) or n < 0 for n in shape):
        raise ValueError(kind)
    size = dtype.itemsize * int(np.prod(shape, dtype=object)) if shape else dtype.itemsize
    if os.fstat(memory).st_size != size or fcntl.fcntl(memory, fcntl.F_GET_SEALS) & _SEALS != _SEALS:
        raise ValueError(size)  # who could cut it short could kill who reads
    if not size:
        return np.empty(shape, dtype)
    return np.frombuffer(mmap.mmap(memory, size, prot=mmap.PROT_READ), dtype).reshape(shape)
