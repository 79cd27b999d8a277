"""Watchdog: finds elements that hang, and programs that have left their pipeline."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable

from streamkit.element.base import Element
from streamkit.element.source import Source
from streamkit.errors import HangDetected
from streamkit.flow.messages import Message, MessageKind

MAX_INTERVAL_S = 1.0  # between two checks


class Watchdog:
    """A thread that checks every element, and whether the program goes on, while a graph streams.

    Time is counted in checks, not read from a clock, because a suspended process does not hang. It ignores
    sources, which may wait for frames without limit, elements that wait on purpose (`Element.waiting`), and
    elements inside a call of a downstream element. A long call such as `drain` is a warning, an element that
    does not return from a frame fails. Without a limit elements are not checked.

    A program has left its pipeline when both its main thread and the thread that began to stream have ended;
    without `abandon` the pipeline's threads would keep the interpreter from ending.
    """

    def __init__(
        self,
        elements: Callable[[], Iterable[Element]],
        limit_s: float,
        post: Callable[[Message], None],
        fail: Callable[[Exception], None],
        abandon: Callable[[], None],
    ) -> None:
        self._limit_s = limit_s
        self._elements, self._post, self._fail, self._abandon = elements, post, fail, abandon
        self._interval_s = min(MAX_INTERVAL_S, limit_s / 4) if limit_s > 0 else MAX_INTERVAL_S
        self._checks: dict[Element, tuple[int, int]] = {}  # start of the call and number of checks
        self._stopping = threading.Event()
        self._users = threading.main_thread(), threading.current_thread()
        self._thread = threading.Thread(target=self._run, name="streamkit-watchdog")

    def start(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Stops the thread."""
        self._stopping.set()
        if self._thread is not threading.current_thread():
            self._thread.join(MAX_INTERVAL_S)  # it may wait for the caller, as `abandon` does

    def _run(self) -> None:
        while not self._stopping.wait(self._interval_s):
            if not any(thread.is_alive() for thread in self._users):
                self._abandon()
                return
            if self._limit_s > 0:
                self._check()

    def _check(self) -> None:
        checks: dict[Element, tuple[int, int]] = {}
        for element in list(self._elements()):
            activity = element.activity
            if activity is None or not _is_stuck(element):
                continue
            since_ns = activity[1]
            known_ns, count = self._checks.get(element, (since_ns, 0))
            count = count + 1 if known_ns == since_ns else 1
            checks[element] = since_ns, count
            if (count - 1) * self._interval_s < self._limit_s <= count * self._interval_s:
                self._report(element, activity[0])
        self._checks = checks

    def _report(self, element: Element, call: str) -> None:
        activity = element.activity
        if activity is None:
            return
        cause = hang_of(call, self._limit_s)
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
    return not any(other.activity is not None for other in element.downstream())
