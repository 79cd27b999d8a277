"""The signals that end a pipeline."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any


@contextlib.contextmanager
def handling_signals(handler: Callable[[int, Any], object]) -> Iterator[None]:
    """Context in which a function handles the signals that end a pipeline; `nohup` leaves out SIGHUP.

    Only a main thread can; in others it does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    kept = [] if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else [signal.SIGHUP]
    before = {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM, *kept)}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)
