# SPDX-License-Identifier: Apache-2.0
"""A cache of pieces of images, shared by threads."""

from __future__ import annotations

import functools
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor

from ..deferred import np


class PieceCache:
    """A thread-safe cache of image pieces; the least recently used ones are evicted beyond `limit` bytes.

    A piece that two threads request is computed once. Prefetching runs on separate threads, so that decoding continues
    while decoded pieces are processed.
    """

    def __init__(self, limit: int):
        self.limit = limit
        self._pieces: OrderedDict[Hashable, Future[np.ndarray]] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()

    @functools.cached_property
    def _ahead(self) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(2, "oiiotex-read")

    def get(self, key: Hashable, make: Callable[[], np.ndarray]) -> np.ndarray:
        """The piece of that key, computed if it is not cached."""
        with self._lock:
            piece = self._pieces.get(key)
            if piece is not None:
                self._pieces.move_to_end(key)
            else:
                mine = self._pieces[key] = Future()
        if piece is not None:
            return piece.result()
        return self._fill(key, mine, make)

    def forget(self) -> None:
        """Evict all finished pieces, and return all freed memory to the system: a stage of the work has ended."""
        from ..machine import return_freed_memory  # few runs free so much

        with self._lock:
            for key in [key for key, piece in self._pieces.items() if piece.done()]:
                self._bytes -= self._pieces.pop(key).result().nbytes
        return_freed_memory()

    def holds(self, key: Hashable) -> bool:
        """Whether the piece is cached or being computed."""
        with self._lock:
            return key in self._pieces

    def ahead(self, key: Hashable, make: Callable[[], np.ndarray]) -> None:
        """Compute the piece in the background if it is not cached."""
        with self._lock:
            if key in self._pieces:
                return
            mine = self._pieces[key] = Future()
        self._ahead.submit(self._fill_quietly, key, mine, make)

    def _fill_quietly(self, key: Hashable, mine: Future[np.ndarray], make: Callable[[], np.ndarray]) -> None:
        try:
            self._fill(key, mine, make)
        except BaseException:  # raised where the piece is requested
            pass

    def _fill(self, key: Hashable, mine: Future[np.ndarray], make: Callable[[], np.ndarray]) -> np.ndarray:
        try:
            pixels = make()
        except BaseException as error:
            with self._lock:
                self._pieces.pop(key, None)
            mine.set_exception(error)
            raise
        mine.set_result(pixels)
        with self._lock:
            self._bytes += pixels.nbytes
            for old in list(self._pieces):
                if self._bytes <= self.limit:
                    break
                if old != key and self._pieces[old].done():
                    self._bytes -= self._pieces.pop(old).result().nbytes
        return pixels
