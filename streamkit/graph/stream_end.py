"""StreamEnd: tracks preroll and end of the sinks of a run."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable

from streamkit.element.base import Element
from streamkit.element.sink import Sink
from streamkit.errors import ElementFailure, ResourceError, StreamkitError
from streamkit.flow.messages import Message, MessageKind
from streamkit.graph.bus import Bus


class StreamEnd:
    """Posts the end of a run once: EOS when every sink has ended, or the first error.

    Attributes:
        error: the first failure, or None.
        ended: set at EOS, failure and stop.
        is_prerolled: set while every sink of a paused graph holds a frame.
    """

    def __init__(self, bus: Bus) -> None:
        self.error: Exception | None = None
        self.ended = threading.Event()
        self.is_prerolled = threading.Event()
        self._bus = bus
        self._changed = threading.Condition()
        self._open: set[Element] = set()
        self._not_prerolled: set[Element] = set()

    def expect_end(self, sinks: Iterable[Sink]) -> None:
        """Adds sinks that have to end before the run does."""
        with self._changed:
            self._open.update(sinks)

    def expect_preroll(self, sinks: Iterable[Sink]) -> None:
        """Adds sinks of a paused graph that have to preroll, unless their `async` is off."""
        with self._changed:
            self._not_prerolled.update(sink for sink in sinks if sink.wait_for_preroll)
            if self._not_prerolled:
                self.is_prerolled.clear()
            else:
                self.is_prerolled.set()

    def remove(self, elements: Iterable[Element]) -> None:
        """Removes sinks that have ended or leave the run, which ends with the last one."""
        with self._changed:
            had_some = bool(self._open)
            self._open.difference_update(elements)
            self._not_prerolled.difference_update(elements)
            is_over = had_some and not self._open
            self._changed.notify_all()
        if is_over:
            self.post_eos()

    def sink_prerolled(self, sink: Element) -> None:
        """A sink of the paused graph holds its first frame."""
        with self._changed:
            self._not_prerolled.discard(sink)
            is_last = not self._not_prerolled and not self.is_prerolled.is_set()
            if is_last:
                self.is_prerolled.set()
        if is_last:
            self._bus.post(Message(MessageKind.ELEMENT, "", "prerolled", {"name": "async-done"}))

    def wait_prerolled(self, timeout_s: float) -> bool:
        """Waits until every sink holds its first frame; raises the error of a failed run."""
        deadline = time.monotonic() + timeout_s
        while not self.is_prerolled.wait(min(0.1, max(0.0, deadline - time.monotonic()))):
            if self.error is not None:
                raise self.error
            if time.monotonic() >= deadline:
                return False
        return True

    def wait(self, elements: Iterable[Element], timeout_s: float) -> None:
        """Waits until these sinks have ended, the run has failed, or the timeout."""
        members = set(elements)
        with self._changed:
            self._changed.wait_for(lambda: self.error is not None or not members & self._open, timeout_s)

    def fail(self, error: Exception) -> None:
        """Posts a failure; the first one ends the run, later ones are warnings."""
        source = error.element if isinstance(error, ElementFailure) else ""
        with self._changed:
            is_first = self.error is None
            if is_first:
                self.error = error if isinstance(error, StreamkitError) else ResourceError(str(error))
            self._changed.notify_all()
        if is_first:
            self._bus.post(Message(MessageKind.ERROR, source, str(error), error=self.error))
            self.ended.set()
        else:
            self._bus.post(Message(MessageKind.WARNING, source, f"after the first error: {error}"))

    def post_eos(self) -> None:
        """Posts EOS, once, and not after a failure."""
        with self._changed:
            if self.ended.is_set() or self.error is not None:
                return
            self.ended.set()
        self._bus.post(Message(MessageKind.EOS, "", "end of stream"))
