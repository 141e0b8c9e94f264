"""Where the tiles of a map are worked on: threads of this process, or a Ray cluster.

A tile is a tuple of arrays, and the work a function of a module that takes one and returns another. What comes out
depends on the tiles alone, never on who worked on them or in what order.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

from drillenv.checks import InputError, count, shown
from drillenv.dynamics.survey import allowed_cores

KNOCK_SECONDS = 5.0

Mapper = Callable[[Callable[..., Any], Sequence[tuple]], Iterator[Any]]
"""Takes the work and the tiles, gives the results in the order of the tiles."""


@contextmanager
def tile_workers(cluster: str | None = None, workers: int | None = None) -> Iterator[Mapper]:
    """A mapper over this machine's cores (``cluster`` None), or over a Ray cluster.

    Args:
        cluster: Address of a Ray cluster ("HOST:6379", "ray://HOST:10001", "auto"), or "local" for one of its own here.
        workers: Threads, one a core where not given; a cluster brings its own.

    Raises:
        InputError: ``workers`` is no count, Ray is not installed, or there is no cluster at that address.
    """
    if cluster is None:
        threads = allowed_cores() if workers is None else count("workers", workers, 1, 1024)
        pool = ThreadPoolExecutor(threads)
        try:
            yield lambda work, tiles: pool.map(lambda tile: work(*tile), tiles)
        finally:
            # on an interrupt the tiles that wait are dropped
            pool.shutdown(cancel_futures=True)
        return
    ray, started = _connect(cluster)
    try:
        yield lambda work, tiles: _on_cluster(ray, work, tiles)
    finally:
        if started:
            ray.shutdown()


def _connect(cluster: object) -> tuple[Any, bool]:
    """Ray, connected, and whether that was done here."""
    if not isinstance(cluster, str) or not cluster.strip():
        raise InputError(
            f'cluster is {shown(cluster)}: give the address of a Ray cluster, "local", or None for threads'
        )
    try:
        import ray
    except ImportError:
        raise InputError(
            f"cluster is {shown(cluster)} but Ray is not installed: pip install 'drillenv[cluster]', or leave it out"
        ) from None
    if ray.is_initialized():
        return ray, False
    try:
        _knock(cluster)
        ray.init(address=cluster, log_to_driver=False, logging_level="error")
    except (OSError, ValueError, RuntimeError, ray.exceptions.RayError) as error:
        reason = str(error).strip().partition("\n")[0]
        raise InputError(
            f"cluster is {shown(cluster)}, where no Ray cluster answers ({shown(reason)}): start one with "
            f'ray start --head and give its address, or give "local"'
        ) from None
    return ray, True


def _knock(address: str) -> None:
    """Fail where nobody listens at HOST:PORT: Ray itself would try for minutes."""
    host, colon, port = address.strip().removeprefix("ray://").rpartition(":")
    if colon:
        socket.create_connection((host.strip("[]"), int(port)), timeout=KNOCK_SECONDS).close()


def _on_cluster(ray: Any, work: Callable[..., Any], tiles: Sequence[tuple]) -> Iterator[Any]:
    """The results of the tiles, worked on by remote tasks."""
    task = ray.remote(work)
    for reference in [task.remote(*tile) for tile in tiles]:
        yield ray.get(reference)
