"""Calls of elements that may hang: `start` and `stop`, with limits, and the watchdog of all others."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from streamkit.element.base import Element
from streamkit.element.source import Source
from streamkit.errors import ElementFailure, HangDetected, StartCancelled, StateError
from streamkit.flow.messages import Message, MessageKind

if TYPE_CHECKING:
    from streamkit.graph.pipeline import Pipeline
    from streamkit.graph.playback import Playback

POLL_S = 0.1
CANCEL_GRACE_S = 0.5  # time for an interrupted call to return: Ctrl-C ends a start within 1 s
MAX_INTERVAL_S = 1.0  # between two checks


class ElementCall(threading.Thread):
    """A call of `start` or `stop` of an element; it begins when it is made.

    Python 3.12 starts no thread once the main thread has ended: the call is then made by the caller's thread.

    Attributes:
        error: what the call raised.
    """

    def __init__(self, element: Element, method: str, pipeline: Pipeline) -> None:
        super().__init__(name=f"streamkit:{element.name}:{method}")
        self.error: Exception | None = None
        self._element = element
        self._method = method
        self._pipeline = pipeline
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
        """Waits until the call returns, is cancelled, or reaches its limit; warns once, after `watchdog_s`.

        Time is counted in polls, because a suspended process does not hang.
        """
        pipeline, polls = self._pipeline, 0
        warned_at = math.ceil(pipeline.watchdog_s / POLL_S)
        self.await_return(POLL_S)
        while self.is_alive() and not pipeline.cancelled.is_set() and polls * POLL_S < limit_s:
            polls += 1
            if polls == warned_at:
                pipeline.bus.post(hang_warning(self._element, hang_of(self._method, pipeline.watchdog_s)))
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


def start_element(element: Element, started: list[Element], pipeline: Pipeline) -> None:
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
    call = ElementCall(element, "start", pipeline)
    try:
        call.wait()
    except BaseException:  # Ctrl-C in the calling thread: `start` must not overlap with `stop`
        call.interrupt()
        raise
    if pipeline.cancelled.is_set():
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


def stop_elements(elements: list[Element], pipeline: Pipeline, limit_s: float) -> list[str]:
    """Stops started elements in reverse order, sinks last; empties the list.

    A `stop` that does not return within `limit_s` is abandoned.

    Returns:
        Names of the elements whose `stop` did not return.
    """
    stuck = []
    while elements:
        element = elements.pop()
        if _overrides(element, "stop") and not _stop_returns(element, pipeline, limit_s):
            stuck.append(element.name)
        element.is_playing = False
        for pad in list(element.pads.values()):
            pad.known_caps = None
    return stuck


def _stop_returns(element: Element, pipeline: Pipeline, limit_s: float) -> bool:
    """Calls `stop`; posts a warning if it fails or does not return."""
    call = ElementCall(element, "stop", pipeline)
    call.wait(limit_s)
    if pipeline.cancelled.is_set():
        call.await_return(CANCEL_GRACE_S)
    if call.is_alive():
        pipeline.bus.post(hang_warning(element, call.abandoned(limit_s)))
        return False
    if call.error is not None:
        text = f"stop failed: {element.failure(call.error)}"
        pipeline.bus.post(Message(MessageKind.WARNING, element.name, text))
    return True


def _overrides(element: Element, method: str) -> bool:
    return getattr(type(element), method) is not getattr(Element, method) or method in vars(element)


def check_ended(stuck: Iterable[str], limit_s: float) -> None:
    """Raises `StateError` if elements did not return from a call within the limit of a stop."""
    if names := ", ".join(dict.fromkeys(stuck)):
        raise StateError(
            f"{names}: a call has not returned within {limit_s:g} s of the stop; its thread is abandoned"
        )


class Watchdog:
    """A thread that checks every element, and whether the program goes on, while a graph streams.

    Time is counted in checks, not read from a clock, because a suspended process does not hang. It ignores
    sources, which may wait for frames without limit, elements that wait on purpose (`Element.waiting`), and
    elements inside a call of a downstream element. A long call such as `drain` is a warning, an element that
    does not return from a frame fails. Without a limit elements are not checked.

    A program has left its pipeline when both its main thread and the thread that began to stream have ended;
    without `Playback.abandon` the pipeline's threads would keep the interpreter from ending.
    """

    def __init__(self, playback: Playback) -> None:
        self._playback = playback
        self._limit_s = limit_s = playback.pipeline.watchdog_s
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
                self._playback.abandon()
                return
            if self._limit_s > 0:
                self._check()

    def _check(self) -> None:
        checks: dict[Element, tuple[int, int]] = {}
        for element in list(self._playback.pipeline.graph.elements):
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
            self._playback.fail(element.failure(cause, activity[2]))
        else:
            self._playback.pipeline.bus.post(hang_warning(element, cause))


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
