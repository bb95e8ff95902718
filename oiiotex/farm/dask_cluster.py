# SPDX-License-Identifier: Apache-2.0
"""Jobs on a Dask cluster: one that runs (`tcp://scheduler:8786`), or processes of this machine (`local:4`)."""

from __future__ import annotations

import contextlib
import logging
import re
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, TypeVar

from ..errors import Error, ParameterError

if TYPE_CHECKING:
    from distributed import Client

Job = TypeVar("Job")
Result = TypeVar("Result")

RETRIES = 2  # of a job whose worker has died
_WAIT = "20s"  # for a scheduler to answer
_LOCAL = re.compile(r"local:([1-9]\d{0,3})", re.ASCII)
_ADDRESS = re.compile(r"(tcp|tls|ws|wss)://\S+:\d+", re.ASCII)


@contextlib.contextmanager
def cluster(address: str) -> Iterator[Client]:
    """A client of a cluster.

    Raises
    ------
    ParameterError
        The address is none.
    Error
        Dask is not installed, or nobody answers there.
    """
    local = _LOCAL.fullmatch(address)
    if not local and not _ADDRESS.fullmatch(address):
        raise ParameterError(f"dask={address}: allowed is tcp://HOST:PORT of a scheduler, or local:WORKERS")
    try:
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise Error("Dask is not installed: pip install oiiotex[farm]") from error
    with contextlib.ExitStack() as stack:
        logging.getLogger("distributed").setLevel(logging.ERROR)  # whoever runs a cluster reads its own log
        try:
            if local:
                own = LocalCluster(
                    n_workers=int(local[1]), threads_per_worker=1, dashboard_address=None, memory_limit=0
                )
                client = stack.enter_context(Client(stack.enter_context(own)))
            else:
                client = stack.enter_context(Client(address, timeout=_WAIT))
        except (OSError, TimeoutError) as error:
            raise Error(f"dask={address}: no scheduler answers there") from error
        yield client


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
            yield future.result() if why is None else instead(job, str(why))
    finally:
        client.cancel(list(futures))
