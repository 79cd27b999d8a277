"""Calls of `start` and `stop`, each in its own thread, so that a hanging call can be abandoned."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from streamkit.element.base import Element
from streamkit.errors import ElementFailure, HangDetected, StartCancelled
from streamkit.flow.messages import Message, MessageKind
from streamkit.graph.watchdog import hang_of, hang_warning

POLL_S = 0.1
CANCEL_GRACE_S = 5.0  # time for an interrupted call to return


@dataclass(frozen=True)
class CallLimits:
    """Time limits of calls.

    Attributes:
        watchdog_s: time until a warning; 0 is never.
        stop_s: time until a `stop` is abandoned; a `start` has no limit.
        cancelled: set to cancel the call.
        post: called with the warning.
    """

    watchdog_s: float
    stop_s: float
    cancelled: threading.Event
    post: Callable[[Message], None]


class ElementCall(threading.Thread):
    """One call of a method of an element.

    Attributes:
        error: raised by the method, or None.
    """

    def __init__(self, element: Element, method: str) -> None:
        super().__init__(name=f"streamkit:{element.name}:{method}")
        self.element = element
        self.method = method
        self.error: BaseException | None = None

    def run(self) -> None:
        """Calls the method."""
        try:
            with self.element.calling(self.method):
                getattr(self.element, self.method)()
        except BaseException as error:
            self.error = error

    def interrupt(self, grace_s: float) -> bool:
        """Makes the element end its waits; whether the call returned in time."""
        self.element.stopping.set()
        self.element.waking.set()
        with contextlib.suppress(Exception):
            self.element.interrupt()
        self.join(grace_s)
        return not self.is_alive()


def start_element(element: Element, limits: CallLimits) -> None:
    """Starts an element.

    Raises:
        ElementFailure: `start` failed, was cancelled (`StartCancelled`), or did not return after that
            (`HangDetected`).
    """
    element.stopping.clear()
    element.rearm()
    element.is_flushing = False
    try:
        _call_start(element, limits)
    except Exception as cause:
        raise (cause if isinstance(cause, ElementFailure) else element.failure(cause)) from cause


def _call_start(element: Element, limits: CallLimits) -> None:
    call = _begin_call(element, "start")
    if call is None:
        return
    try:
        _wait(call, limits, None)
    except BaseException:  # Ctrl-C in the calling thread: `start` must not overlap with `stop`
        call.interrupt(CANCEL_GRACE_S)
        raise
    if limits.cancelled.is_set():
        if not call.interrupt(CANCEL_GRACE_S):
            raise _hang("start", CANCEL_GRACE_S)
        raise StartCancelled(f"{element.name}: its start was interrupted")
    _raise_error(call)


def wake_elements(elements: Iterable[Element], post: Callable[[Message], None]) -> None:
    """Ends the waits of elements that are to stop."""
    members = list(elements)
    for element in members:
        element.stopping.set()
    for element in members:
        element.halt()
        try:
            element.interrupt()
        except Exception as cause:
            post(Message(MessageKind.WARNING, element.name, f"interrupt failed: {cause}"))


def stop_elements(elements: list[Element], limits: CallLimits) -> list[str]:
    """Stops started elements in reverse order, sinks last; empties the list.

    Returns:
        Names of the elements whose `stop` did not return.
    """
    stuck = []
    while elements:
        element = elements.pop()
        element.is_playing = False
        try:
            _call_stop(element, limits)
        except HangDetected as cause:
            stuck.append(element.name)
            limits.post(Message(MessageKind.WARNING, element.name, str(cause), {"code": "watchdog"}))
        except Exception as cause:
            failure = element.failure(cause)
            limits.post(Message(MessageKind.WARNING, element.name, f"stop failed: {failure}"))
        for pad in list(element.pads.values()):
            pad.known_caps = None
    return stuck


def _call_stop(element: Element, limits: CallLimits) -> None:
    call = _begin_call(element, "stop")
    if call is None:
        return
    began = time.monotonic()
    _wait(call, limits, limits.stop_s)
    if call.is_alive():
        raise _hang("stop", time.monotonic() - began)
    _raise_error(call)


def _begin_call(element: Element, method: str) -> ElementCall | None:
    """Starts the call; None if the element does not override the method."""
    if getattr(type(element), method) is getattr(Element, method) and method not in vars(element):
        return None
    call = ElementCall(element, method)
    call.start()
    return call


def _wait(call: ElementCall, limits: CallLimits, limit_s: float | None) -> None:
    """Waits until the call returns, is cancelled, or reaches its limit; warns once.

    Time is counted in polls, because a suspended process does not hang.
    """
    polls = 0
    call.join(POLL_S)
    while call.is_alive() and not limits.cancelled.is_set():
        polls += 1
        seconds = polls * POLL_S
        if limits.watchdog_s and seconds - POLL_S < limits.watchdog_s <= seconds:
            limits.post(hang_warning(call.element, hang_of(call.method, limits.watchdog_s)))
        if limit_s is not None and seconds >= limit_s:
            return
        call.join(POLL_S)
    if limit_s is not None and call.is_alive():
        call.join(min(1.0, limit_s))


def _raise_error(call: ElementCall) -> None:
    if isinstance(call.error, Exception):
        raise call.error
    if call.error is not None:  # SystemExit must not end the process in silence
        raise RuntimeError(f"its {call.method} raised {call.error!r}")


def _hang(method: str, seconds: float) -> HangDetected:
    return HangDetected(f"its {method} has not returned within {seconds:.0f} s; its thread is abandoned")
