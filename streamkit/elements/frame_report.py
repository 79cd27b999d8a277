"""What elements have to do with the application: callbacks, waits of its threads, reports of frames."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import Any

from streamkit.element.base import Element
from streamkit.element.frame_queue import data_size
from streamkit.element.pad import Pad
from streamkit.flow.frame import Frame

MAX_DUMPED = 4096
FAILURE_POLL_S = 0.2  # interval at which the application learns of a failure of the pipeline


class Callbacks(list[Callable[..., Any]]):
    """Functions called on an event, as GStreamer's signals: `element.on_handoff(function)` adds one.

    They run in the streaming thread: keep them short.
    """

    def __call__(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Adds a function; usable as a decorator."""
        self.append(function)
        return function

    def remove(self, function: Callable[..., Any]) -> None:
        """Removes a function, if it is there."""
        with contextlib.suppress(ValueError):
            super().remove(function)

    def emit(self, *args: object) -> None:
        """Calls each function, in the order in which they were added."""
        for function in tuple(self):
            function(*args)


def wait_for_change(
    element: Element, condition: Callable[[], bool], is_over: Callable[[], bool], timeout_s: float
) -> bool:
    """Waits in a thread of the application, with the lock of `changed` held, until a condition holds.

    Returns:
        False at the timeout, if the pipeline stops, or once it `is_over`.

    Raises:
        ElementFailure: the pipeline has failed.
    """
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        left_s = deadline_s - time.monotonic()
        ends = is_over() or element.stopping.is_set() or left_s <= 0
        if (failure := element.pipeline_error()) is not None:  # looked at last: EOS follows a failure
            raise failure
        if ends:
            return False
        element.changed.wait(min(left_s, FAILURE_POLL_S))
    return True


def report_frame(element: Any, verb: str, pad: Pad, frame: Frame, *handoff: object) -> None:
    """Reports a frame that passes a pad, as the properties `silent`, `dump` and `signal_handoffs` say.

    The verb tells what the element, a fakesrc, identity or fakesink, does; `handoff` is for `on_handoff`.
    """
    if not element.silent:
        element.last_message = frame_text(verb, pad, frame)
        if not pad.is_src:
            element.post_message("frame", seq=frame.seq, pts=frame.pts, caps=str(frame.caps))
    if element.dump:
        element.post_message("dump", content=dump_text(frame))
    if element.signal_handoffs:
        element.on_handoff.emit(*handoff)


def frame_text(verb: str, pad: Pad, frame: Frame) -> str:
    """One line: the action, the pad, and the frame's size and times in ns."""
    return (
        f"{verb} ({pad.path}) ({data_size(frame.data)} bytes, pts: {frame.pts}, "
        f"duration: {frame.duration}, seq: {frame.seq}, flags: {frame.flags:#x})"
    )


def dump_text(frame: Frame) -> str:
    """The first bytes of a frame in hexadecimal, 16 per line, with their offset."""
    try:
        content = bytes(memoryview(frame.data).cast("B")[:MAX_DUMPED])
    except (TypeError, ValueError):  # no buffer, or not contiguous
        return repr(frame.data)[:MAX_DUMPED]
    return "\n".join(
        f"{start:08x}: {content[start : start + 16].hex(' ')}" for start in range(0, len(content), 16)
    )
