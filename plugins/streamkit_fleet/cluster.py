"""The connection to Ray."""

from __future__ import annotations

import logging
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from streamkit import ResourceError, needs_extra

NAMESPACE = "streamkit"


@contextmanager
def connected(address: str | None, *, cores: int | None = None, wait_s: float = 0.0) -> Iterator[None]:
    """Context with a connection to Ray: the one there is, a cluster's, or a local one that ends with it.

    Args:
        address: HOST:PORT of a cluster, "auto" for the one on this machine, None to start one here.
        cores: of a local Ray; None is all.
        wait_s: how long to wait for a cluster that starts, s.

    Raises:
        ResourceError: Ray is missing, or the cluster does not answer.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    with needs_extra("this command", "fleet"):
        import ray
    if ray.is_initialized():
        yield
        return
    deadline_s = time.monotonic() + wait_s
    while address is not None and not _listens(address) and time.monotonic() < deadline_s:
        time.sleep(0.1)
    local: dict[str, Any] = {"num_cpus": cores, "include_dashboard": False} if address is None else {}
    try:
        ray.init(
            address or "local", log_to_driver=False, logging_level=logging.ERROR, namespace=NAMESPACE, **local
        )
    except (ConnectionError, RuntimeError, ValueError, ray.exceptions.RayError) as error:
        reason = str(error).partition("\n")[0]
        raise ResourceError(f"Ray at {address or 'this machine'} does not answer: {reason}") from error
    try:
        yield
    finally:
        ray.shutdown()


def _listens(address: str) -> bool:
    """Whether something takes connections at HOST:PORT."""
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host, int(port)), timeout=1.0).close()
    except (OSError, ValueError):
        return False
    return True


def cluster_cores() -> float:
    """Cores of the cluster."""
    import ray

    resources: dict[str, float] = ray.cluster_resources()  # type: ignore[no-untyped-call]
    return resources.get("CPU", 1.0)
