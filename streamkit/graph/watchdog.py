"""Watchdog: notices from outside that an element does not come back from a call of the engine."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable

from streamkit.element.base import Element
from streamkit.element.source import Source
from streamkit.errors import ElementFailure, HangDetected
from streamkit.flow.messages import Message, MessageKind

LOOK_S = 1.0  # longest time between two looks


class Watchdog:
    """A thread that looks at every element now and then while a graph streams.

    Time is counted in looks and not read from a clock: a process that was suspended has not hung. Sources are
    left out, because they may wait for the next frame as long as they like; so is an element that waits on
    purpose (`Element.waiting`) or that stands in a call of the element behind it.

    Args:
        elements: gives the elements of the graph.
        limit_s: how long a call may take, s; 0 switches the watchdog off.
        post: takes a warning, for a call such as `drain` that may take long.
        fail: takes the failure of an element that does not come back with a frame.
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
        self._look_s = min(LOOK_S, limit_s / 4)
        self._looks: dict[
            int, tuple[int, int]
        ] = {}  # by the element's id: since_ns of its call, looks so far
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begins to look."""
        if self.limit_s > 0:
            self._thread = threading.Thread(target=self._run, name="streamkit-watchdog")
            self._thread.start()

    def stop(self) -> None:
        """Ends the thread."""
        self._stopping.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()

    def _run(self) -> None:
        while not self._stopping.wait(self._look_s):
            self.look()

    def look(self) -> None:
        """Counts a look at every element that is still in the same call; reports those that are too long."""
        looks: dict[int, tuple[int, int]] = {}
        for element in list(self._elements()):
            activity = element.activity
            if activity is None or not _is_stuck(element):
                continue
            since_ns = activity[1]
            known_ns, count = self._looks.get(id(element), (since_ns, 0))
            count = count + 1 if known_ns == since_ns else 1
            looks[id(element)] = since_ns, count
            if (count - 1) * self._look_s < self.limit_s <= count * self._look_s:
                self._report(element, activity[0])
        self._looks = looks

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
    """What to say of a call that has not come back."""
    what = "taking a frame" if call == "frame" else f"`{call}`"
    return HangDetected(
        f"{what} has not come back for {seconds:g} s; it hangs in its own code or in a library it calls; "
        "raise watchdog-s if it may take so long"
    )


def hang_warning(element: Element, cause: HangDetected) -> Message:
    """The warning that an element does not come back from a call, which goes on."""
    return Message(MessageKind.WARNING, element.name, str(cause), {"code": "watchdog"})


def _is_stuck(element: Element) -> bool:
    """Whether an element stands in a call of its own code, not of an element behind it, and does not wait."""
    if element.is_waiting or isinstance(element, Source):
        return False
    behind = [pad.peer.element for pad in element.src_pads() if pad.peer is not None]
    return not any(other.activity is not None for other in behind)


def is_hang(error: Exception | None) -> bool:
    """Whether an error is that of an element that did not come back."""
    return isinstance(error, ElementFailure) and isinstance(error.cause, HangDetected)
