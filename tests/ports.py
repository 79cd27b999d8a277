"""Ports of one test alone: no connection gets them, and no test in another process looks for them."""

import itertools
import os
import socket
from collections.abc import Iterator
from typing import Final

FIRST: Final = 10_000  # up to 20 000; Linux gives those from 32 768 on to connections
SHARE: Final = 1_000  # of one worker of pytest-xdist


def _numbers() -> Iterator[int]:
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % 10
    for number in itertools.count(os.getpid()):
        yield FIRST + SHARE * worker + number % SHARE


_NUMBERS: Final = _numbers()


def free_port() -> int:
    """A free port on loopback, another with each call."""
    for port in itertools.islice(_NUMBERS, SHARE):
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
    raise OSError(f"none of {SHARE} ports is free")
