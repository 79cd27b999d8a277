"""What test elements report of the frames they see: callbacks, messages, hexadecimal dumps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from streamkit.element.pad import Pad
from streamkit.flow.frame import Frame
from streamkit.handoff.frame_queue import data_size

MAX_DUMPED = 4096


class Callbacks:
    """Functions called on an event, as GStreamer's signals: `element.on_handoff(function)` adds one.

    They run in the streaming thread: keep them short.
    """

    __slots__ = ("_callables",)

    def __init__(self) -> None:
        self._callables: tuple[Callable[..., Any], ...] = ()

    def __call__(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Adds a function; usable as a decorator."""
        self._callables = (*self._callables, function)
        return function

    def __bool__(self) -> bool:
        return bool(self._callables)

    def remove(self, function: Callable[..., Any]) -> None:
        """Removes a function, if it is there."""
        self._callables = tuple(known for known in self._callables if known != function)

    def emit(self, *args: object) -> None:
        """Calls each function, in the order in which they were added."""
        for function in self._callables:
            function(*args)


def report_frame(element: Any, verb: str, pad: Pad, frame: Frame, *handoff: object) -> None:
    """Reports a frame as the properties `silent`, `dump` and `signal_handoffs` of an element say.

    Args:
        element: fakesrc, identity or fakesink.
        verb: what the element does with the frame.
        pad: the pad that the frame passes.
        frame: the frame.
        *handoff: arguments of `on_handoff`.
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
