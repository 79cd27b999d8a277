"""Waits for what another thread, process or server is about to do."""

import threading
import time
from collections.abc import Callable

from streamkit import Message, MessageKind, Pipeline

POLL_S = 0.01


def wait_for(condition: Callable[[], bool], limit_s: float = 20.0) -> bool:
    """Whether a condition becomes true within the time limit."""
    deadline_s, never = time.monotonic() + limit_s, threading.Event()
    while not condition():
        if time.monotonic() > deadline_s:
            return False
        never.wait(POLL_S)
    return True


def next_state(pipeline: Pipeline, wanted: str, limit_s: float = 20.0) -> Message:
    """The next message of a state of an element's connection."""
    deadline_s = time.monotonic() + limit_s
    while (left_s := deadline_s - time.monotonic()) > 0:
        message = pipeline.bus.pop(left_s, (MessageKind.ELEMENT,))
        if message is not None and message.fields.get("state") == wanted:
            return message
    raise AssertionError(f"{wanted} has not come within {limit_s} s")
