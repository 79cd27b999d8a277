"""Calls of `start` and `stop`, which can be cancelled, and abandoned where they hang."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from streamkit.element.base import Element
from streamkit.errors import ElementFailure, HangDetected, StartCancelled, StateError
from streamkit.flow.messages import Message, MessageKind
from streamkit.graph.watchdog import hang_of, hang_warning

POLL_S = 0.1
CANCEL_GRACE_S = 0.5  # time for an interrupted call to return: Ctrl-C ends a start within 1 s


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
    """A call of `start` or `stop` of an element; it begins when it is made.

    Python 3.12 starts no thread once the main thread has ended: the call is then made by the caller's thread.

    Attributes:
        error: what the call raised.
    """

    def __init__(self, element: Element, method: str, limits: CallLimits) -> None:
        super().__init__(name=f"streamkit:{element.name}:{method}")
        self.error: Exception | None = None
        self._element = element
        self._method = method
        self._limits = limits
        try:
            self.start()
        except RuntimeError:
            self.run()

    def run(self) -> None:
        """Calls the method."""
        try:
            with self._element.calling(self._method):
                getattr(self._element, self._method)()
        except Exception as error:
            self.error = error
        except BaseException as error:  # SystemExit must not end the process in silence
            self.error = RuntimeError(f"its {self._method} raised {error!r}")

    def wait(self, limit_s: float = math.inf) -> None:
        """Waits until the call returns, is cancelled, or reaches its limit; warns once.

        Time is counted in polls, because a suspended process does not hang.
        """
        limits, polls = self._limits, 0
        warned_at = math.ceil(limits.watchdog_s / POLL_S)
        self.await_return(POLL_S)
        while self.is_alive() and not limits.cancelled.is_set() and polls * POLL_S < limit_s:
            polls += 1
            if polls == warned_at:
                limits.post(hang_warning(self._element, hang_of(self._method, limits.watchdog_s)))
            self.await_return(POLL_S)

    def await_return(self, limit_s: float) -> None:
        """Waits for the thread, where there is one."""
        if self.ident is not None:
            self.join(limit_s)

    def interrupt(self) -> None:
        """Makes the element end its waits, and gives the call some time to return."""
        self._element.halt()
        with contextlib.suppress(Exception):
            self._element.interrupt()
        self.await_return(CANCEL_GRACE_S)

    def abandoned(self, limit_s: float) -> HangDetected:
        """The error for a call that has not returned within a limit."""
        return HangDetected(
            f"its {self._method} has not returned within {limit_s:.0f} s; its thread is abandoned"
        )


def start_element(element: Element, started: list[Element], limits: CallLimits) -> None:
    """Starts an element, and adds it to those that have to be stopped.

    Raises:
        ElementFailure: `start` failed, was cancelled (`StartCancelled`), or did not return after that
            (`HangDetected`).
    """
    started.append(element)
    element.stopping.clear()
    element.is_flushing = False
    if not _overrides(element, "start"):
        return
    call = ElementCall(element, "start", limits)
    try:
        call.wait()
    except BaseException:  # Ctrl-C in the calling thread: `start` must not overlap with `stop`
        call.interrupt()
        raise
    if limits.cancelled.is_set():
        call.interrupt()
        if call.is_alive():
            started.remove(element)  # its `stop` must not run beside its `start`
            raise element.failure(call.abandoned(CANCEL_GRACE_S))
        raise element.failure(StartCancelled(f"{element.name}: its start was interrupted"))
    if call.error is not None:
        is_named = isinstance(call.error, ElementFailure)
        raise (call.error if is_named else element.failure(call.error)) from call.error


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
        if _overrides(element, "stop") and not _stop_returns(element, limits):
            stuck.append(element.name)
        element.is_playing = False
        for pad in list(element.pads.values()):
            pad.known_caps = None
    return stuck


def _stop_returns(element: Element, limits: CallLimits) -> bool:
    """Calls `stop`; posts a warning if it fails or does not return."""
    call = ElementCall(element, "stop", limits)
    call.wait(limits.stop_s)
    if limits.cancelled.is_set():
        call.await_return(CANCEL_GRACE_S)
    if call.is_alive():
        limits.post(hang_warning(element, call.abandoned(limits.stop_s)))
        return False
    if call.error is not None:
        text = f"stop failed: {element.failure(call.error)}"
        limits.post(Message(MessageKind.WARNING, element.name, text))
    return True


def _overrides(element: Element, method: str) -> bool:
    return getattr(type(element), method) is not getattr(Element, method) or method in vars(element)


def check_ended(stuck: Iterable[str], limit_s: float) -> None:
    """Raises `StateError` if elements did not return from a call within the limit of a stop."""
    if names := ", ".join(dict.fromkeys(stuck)):
        raise StateError(
            f"{names}: a call has not returned within {limit_s:g} s of the stop; its thread is abandoned"
        )
