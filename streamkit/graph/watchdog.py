"""Watchdog: detects calls of elements that do not return."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable

from streamkit.element.base import Element
from streamkit.element.source import Source
from streamkit.errors import HangDetected
from streamkit.flow.messages import Message, MessageKind

POLL_S = 1.0  # maximum interval between two checks


class Watchdog:
    """A thread that checks every element periodically while a graph streams.

    Time is counted in checks, not read from a clock, because a suspended process does not hang. It ignores
    sources, which may wait for frames without limit, elements that wait on purpose (`Element.waiting`), and
    elements inside a call of a downstream element.

    Args:
        elements: returns the elements of the graph.
        limit_s: maximum duration of a call, s; 0 disables the watchdog.
        post: called with a warning for a long call such as `drain`.
        fail: called with the failure of an element that does not return from a frame.
    """

    def __init__(
        self,
        elements: Callable[[], Iterable[Element]],
        limit_s: float,
        post: Callable[[Message], None],
        fail: Callable[[Exception], None],
    ) -> None:
        self.limit_s = limit_s
        self._elements = elements
        self._post = post
        self._fail = fail
        self._interval_s = min(POLL_S, limit_s / 4)
        self._checks: dict[Element, tuple[int, int]] = {}  # start of the call and number of checks
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Starts the thread."""
        if self.limit_s > 0:
            self._thread = threading.Thread(target=self._run, name="streamkit-watchdog")
            self._thread.start()

    def stop(self) -> None:
        """Stops the thread."""
        self._stopping.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()

    def _run(self) -> None:
        while not self._stopping.wait(self._interval_s):
            self.check()

    def check(self) -> None:
        """Checks every element once; reports calls that exceed the limit."""
        checks: dict[Element, tuple[int, int]] = {}
        for element in list(self._elements()):
            activity = element.activity
            if activity is None or not _is_stuck(element):
                continue
            since_ns = activity[1]
            known_ns, count = self._checks.get(element, (since_ns, 0))
            count = count + 1 if known_ns == since_ns else 1
            checks[element] = since_ns, count
            if (count - 1) * self._interval_s < self.limit_s <= count * self._interval_s:
                self._report(element, activity[0])
        self._checks = checks

    def _report(self, element: Element, call: str) -> None:
        activity = element.activity
        if activity is None:
            return
        cause = hang_of(call, self.limit_s)
        if call == "frame":
            self._fail(element.failure(cause, activity[2]))
        else:
            self._post(hang_warning(element, cause))


def hang_of(call: str, seconds: float) -> HangDetected:
    """The error for a call that did not return."""
    if call == "start":
        return HangDetected(
            f"`start` takes more than {seconds:g} s; where it compiles loops for this machine, once, "
            "`streamkit prepare` does that beforehand; it is not cut off, and Ctrl-C cancels it"
        )
    what = "the call with a frame" if call == "frame" else f"`{call}`"
    return HangDetected(
        f"{what} has not returned for {seconds:g} s; it hangs in its own code or in a library it calls; "
        "raise watchdog-s if it may take so long"
    )


def hang_warning(element: Element, cause: HangDetected) -> Message:
    """The warning for a call that does not return."""
    return Message(MessageKind.WARNING, element.name, str(cause), {"code": "watchdog"})


def _is_stuck(element: Element) -> bool:
    """Whether an element is inside its own code, not downstream of it, and does not wait."""
    if element.is_waiting or isinstance(element, Source):
        return False
    behind = [pad.peer.element for pad in element.src_pads() if pad.peer is not None]
    return not any(other.activity is not None for other in behind)
