# SPDX-License-Identifier: Apache-2.0
"""Jobs on a Dask cluster that runs: `tcp://scheduler:8786`. What `local:4` says is done without Dask."""

from __future__ import annotations

import contextlib
import logging
import re
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, TypeVar

from ..errors import Error, ParameterError, present

if TYPE_CHECKING:
    from distributed import Client

Job = TypeVar("Job")
Result = TypeVar("Result")

RETRIES = 2  # of a job whose worker has died
_WAIT = "20s"  # for a scheduler to answer
_LOCAL = re.compile(r"local:([1-9]\d{0,3})", re.ASCII)
_ADDRESS = re.compile(r"(tcp|tls|ws|wss)://\S+:\d+", re.ASCII)


def local_workers(address: str) -> int:
    """Processes of this machine that an address asks for (`local:4`): they need no scheduler, and nothing listens.

    Returns
    -------
    int
        0 where the address is that of a scheduler.

    Raises
    ------
    ParameterError
        It is neither.
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
    """A client of a cluster, and how many workers that has.

    Raises
    ------
    Error
        Dask is not installed, nobody answers there, or there are no workers.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise Error("Dask is not installed: pip install oiiotex[farm]") from error
    logging.getLogger("distributed").setLevel(logging.ERROR)  # whoever runs a cluster reads its own log
    with contextlib.ExitStack() as stack:
        try:
            client = stack.enter_context(Client(address, timeout=_WAIT))
        except (OSError, TimeoutError) as error:
            raise Error(f"dask={address}: no scheduler answers there") from error
        except TypeError as error:  # Dask's, of a configuration without them
            if not address.startswith("tls:"):
                raise
            raise Error(
                f"dask={address}: TLS requires a certificate, a key and an authority: name them in"
                " ~/.config/dask/distributed.yaml (docs/how-to/farm.md)"
            ) from error
        workers = client.scheduler_info(n_workers=-1)["workers"]
        if not workers:
            raise Error(f"dask={address}: the scheduler has no workers: start `dask worker {address}` on some machine")
        yield client, len(workers)


def results(
    client: Client,
    work: Callable[[Job], Result],
    jobs: Sequence[Job],
    instead: Callable[[Job, str], Result] | None = None,
) -> Iterator[Result]:
    """What `work` makes of each job, as they end; a job whose worker dies is done again elsewhere.

    Parameters
    ----------
    client : Client
    work : callable
        A function of a module that workers can import.
    jobs : sequence
    instead : callable, optional
        (job, why): gives the result of a job that could not be done.

    Raises
    ------
    Error
        A job has lost `RETRIES` workers, or failed otherwise than by an answer, and nothing stands instead.
    """
    from distributed import KilledWorker, as_completed

    futures = {client.submit(work, job, pure=False, retries=RETRIES): job for job in jobs}
    beside_killed: list[Job] = []
    try:
        for future in as_completed(futures):
            if future.status == "finished":
                yield future.result()
            elif instead is None:
                raise Error(f"a worker could not do its share: {future.exception()}")
            elif isinstance(future.exception(), KilledWorker):
                beside_killed.append(futures[future])
            else:
                yield instead(futures[future], str(future.exception()))
        for job in beside_killed:  # alone: Dask blames all that a worker had before it when it died
            future = client.submit(work, job, pure=False)
            futures[future] = job
            why = future.exception()
            yield future.result() if why is None else present(instead)(job, str(why))
    finally:
        client.cancel(list(futures))
