# SPDX-License-Identifier: Apache-2.0
"""Jobs on a running Dask cluster, such as `tcp://scheduler:8786`. `local:4` means local processes without Dask."""

from __future__ import annotations

import contextlib
import logging
import re
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, TypeVar

from oiiotex.engine.errors import Error, ParameterError, present

if TYPE_CHECKING:
    from distributed import Client

Job = TypeVar("Job")
Result = TypeVar("Result")

RETRIES = 2  # retries of a job whose worker has died
_WAIT = "20s"  # timeout of the connection to the scheduler
_LOCAL = re.compile(r"local:([1-9]\d{0,3})", re.ASCII)
_ADDRESS = re.compile(r"(tcp|tls|ws|wss)://\S+:\d+", re.ASCII)


def local_workers(address: str) -> int:
    """Number of local processes in an address such as `local:4`, which needs neither scheduler nor open ports.

    Returns
    -------
    int
        0 for the address of a scheduler.

    Raises
    ------
    ParameterError
        The address is neither.
    """
    local = _LOCAL.fullmatch(address)
    if not local and not _ADDRESS.fullmatch(address):
        raise ParameterError(
            f"dask={address}: expected the address of a scheduler, such as tcp://HOST:PORT or tls://HOST:PORT,"
            " or local:WORKERS (1 to 9999)"
        )
    return int(local[1]) if local else 0


@contextlib.contextmanager
def cluster(address: str) -> Iterator[tuple[Client, int]]:
    """A client of a cluster, and the number of its workers.

    Raises
    ------
    Error
        Dask is not installed, the scheduler does not answer, or it has no workers.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise Error("Dask is not installed: pip install oiiotex-studio[farm]") from error
    logging.getLogger("distributed").setLevel(logging.ERROR)  # the cluster has its own log
    with contextlib.ExitStack() as stack:
        try:
            client = stack.enter_context(Client(address, timeout=_WAIT))
        except (OSError, TimeoutError) as error:
            raise Error(f"dask={address}: no answer from the scheduler; check the address, and that it runs") from error
        except TypeError as error:  # raised by Dask if its configuration has no TLS files
            if not address.startswith("tls:"):
                raise
            raise Error(
                f"dask={address}: TLS requires a certificate, a key and a certificate authority; configure them in"
                " ~/.config/dask/distributed.yaml (docs/how-to/farm.md)"
            ) from error
        workers = client.scheduler_info(n_workers=-1)["workers"]
        if not workers:
            raise Error(f"dask={address}: the scheduler has no workers; start one with `dask worker {address}`")
        yield client, len(workers)


def results(
    client: Client,
    work: Callable[[Job], Result],
    jobs: Sequence[Job],
    instead: Callable[[Job, str], Result] | None = None,
) -> Iterator[Result]:
    """Yield the results of `work` as jobs end. A job whose worker dies is retried on another worker.

    Parameters
    ----------
    client : Client
    work : callable
        Function of a module that workers can import.
    jobs : sequence
    instead : callable, optional
        Called with (job, reason): returns a substitute result for a failed job.

    Raises
    ------
    Error
        A job has lost more than `RETRIES` workers or raised an exception, and `instead` is None.
    """
    from distributed import KilledWorker, as_completed

    futures = {client.submit(work, job, pure=False, retries=RETRIES): job for job in jobs}
    with_killed: list[Job] = []
    try:
        for future in as_completed(futures):
            if future.status == "finished":
                yield future.result()
            elif instead is None:
                raise Error(f"a job failed on its worker: {future.exception()}")
            elif isinstance(future.exception(), KilledWorker):
                with_killed.append(futures[future])
            else:
                yield instead(futures[future], str(future.exception()))
        for job in with_killed:  # one at a time, because Dask fails all jobs that a dead worker had queued
            future = client.submit(work, job, pure=False)
            futures[future] = job
            why = future.exception()
            yield future.result() if why is None else present(instead)(job, str(why))
    finally:
        client.cancel(list(futures))
