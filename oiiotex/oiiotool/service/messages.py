# SPDX-License-Identifier: Apache-2.0
"""Messages between the resident process and its clients: JSON on a Unix socket, with arrays in shared memory.

A message is 8 bytes (magic with version, length of the JSON), the JSON, and a file descriptor for each array. Arrays
are sealed anonymous memory, which the system frees even if both processes are killed.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import mmap
import os
import re
import socket
import struct
import threading
from collections.abc import Sequence
from typing import Any

from ...engine.deferred import np
from ...engine.errors import Error, ImageError

VERSION = 1
_MAGIC = b"oxs" + bytes([VERSION])
_HEADER = struct.Struct("<4sI")
_MOST_TEXT = 16 << 20  # bytes
_MOST_ARRAYS = 64  # per message
_AT_ONCE = 1 << 16  # bytes per recv: a header's length is not allocated before the data arrive
_PATIENCE = struct.pack("ll", 10, 0)  # s; send timeout
_TYPE = re.compile(r"[<>|=]?[biuf]\d{1,2}")
_SEALS = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_WRITE


class LinkError(Error):
    """The other side has ended, or uses another protocol version."""


class Memory:
    """An array in sealed memory that can be sent several times.

    Parameters
    ----------
    array : np.ndarray
    """

    def __init__(self, array: np.ndarray):
        self.dtype, self.shape, self.nbytes = array.dtype, array.shape, array.nbytes
        self.descriptor = _shared(array)

    def __del__(self) -> None:
        if "descriptor" in vars(self):  # otherwise there was no memory for it
            os.close(self.descriptor)


class Link:
    """One end of a connection. Any thread can send; one thread receives."""

    def __init__(self, connection: socket.socket):
        self._socket = connection
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _PATIENCE)
        self._sending = threading.Lock()

    def send(self, facts: dict[str, Any], arrays: Sequence[np.ndarray | Memory] = ()) -> None:
        """Send a message."""
        layout = [{"type": array.dtype.str, "shape": list(array.shape)} for array in arrays]
        text = json.dumps(facts | {"arrays": layout}).encode()
        if len(text) > _MOST_TEXT or len(arrays) > _MOST_ARRAYS:
            raise ImageError("message too large for the resident process")
        memories: list[Memory] = []  # freed after they are sent
        try:
            for array in arrays:
                memories.append(array if isinstance(array, Memory) else Memory(array))
            with self._sending:
                header = _HEADER.pack(_MAGIC, len(text))
                if socket.send_fds(self._socket, [header], [m.descriptor for m in memories]) != len(header):
                    raise LinkError("the connection to the resident process is broken")
                self._socket.sendall(text)
        except OSError as error:
            self.hang_up()  # part of a message may have been sent
            raise LinkError(f"the resident process has ended: {error.strerror}") from error

    def receive(self) -> tuple[dict[str, Any], list[np.ndarray]]:
        """Wait for a message: its facts and its read-only arrays."""
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
                raise LinkError("the resident process is another version of oiiotex: end that process and try again")
            facts = json.loads(self._exactly(length))
            if not isinstance(facts, dict):
                raise ValueError(type(facts))
            layout = facts.pop("arrays")
            if len(layout) != len(memories):
                raise LinkError("a message of the resident process lacks its arrays")
            return facts, [_array(m, one["type"], one["shape"]) for m, one in zip(memories, layout, strict=True)]
        except OSError as error:
            raise LinkError(f"the resident process has ended: {error.strerror}") from error
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise LinkError("invalid message from the resident process") from error
        finally:
            for memory in memories:
                os.close(memory)

    def _exactly(self, length: int) -> bytearray:
        text = bytearray()
        while len(text) < length:
            piece = self._socket.recv(min(_AT_ONCE, length - len(text)))
            if not piece:
                raise LinkError("the resident process has ended")
            text += piece
        return text

    def hang_up(self) -> None:
        """Shut the connection down: `receive` raises LinkError on both sides."""
        with contextlib.suppress(OSError):  # already shut down
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Shut down and close the connection."""
        self.hang_up()
        self._socket.close()


def _shared(array: np.ndarray) -> int:
    """The file descriptor of sealed memory that contains the array's bytes."""
    memory = os.memfd_create("oiiotex", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    try:
        left = np.ascontiguousarray(array).reshape(-1).view(np.uint8).data
        while left:
            left = left[os.write(memory, left) :]
        fcntl.fcntl(memory, fcntl.F_ADD_SEALS, _SEALS)
    except BaseException:
        os.close(memory)
        raise
    return memory


def _array(memory: int, kind: str, shape: list[int]) -> np.ndarray:
    """The array in sealed memory, which is freed with the array."""
    if not isinstance(kind, str) or not _TYPE.fullmatch(kind) or any(type(n) is not int or n < 0 for n in shape):
        raise ValueError(kind)
    dtype = np.dtype(kind)
    size = dtype.itemsize * int(np.prod(shape, dtype=object)) if shape else dtype.itemsize
    if os.fstat(memory).st_size != size or fcntl.fcntl(memory, fcntl.F_GET_SEALS) & _SEALS != _SEALS:
        raise ValueError(size)  # truncating unsealed memory would crash the reader
    if not size:
        return np.empty(shape, dtype)
    return np.frombuffer(mmap.mmap(memory, size, prot=mmap.PROT_READ), dtype).reshape(shape)
