"""The states of a pipeline, the threads that push frames, and the end of a run."""

from __future__ import annotations

import contextlib
import enum
import threading
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from streamkit.element.base import Element
from streamkit.element.sink import Sink
from streamkit.errors import ElementFailure, NotNegotiated, ResourceError, StreamkitError
from streamkit.flow.events import EOS, FlowStop, NotLinked
from streamkit.flow.messages import Message, MessageKind
from streamkit.graph.bus import Bus

if TYPE_CHECKING:
    from streamkit.graph.playback import Playback


class State(enum.StrEnum):
    """State of a pipeline."""

    NULL = "null"
    READY = "ready"
    PAUSED = "paused"
    PLAYING = "playing"

    @property
    def is_streaming(self) -> bool:
        """Whether the threads run: paused or playing."""
        return self in (State.PAUSED, State.PLAYING)


class StateChange(enum.StrEnum):
    """Result of a state change; ASYNC: sinks await their first frame; NO_PREROLL: the pipeline is live."""

    SUCCESS = "success"
    ASYNC = "async"
    NO_PREROLL = "no-preroll"


class StreamEnd:
    """Posts the end of a run once: EOS when every sink has ended, or the first error.

    Attributes:
        error: the first failure, or None.
        ended: set at EOS, failure and stop.
    """

    def __init__(self, bus: Bus) -> None:
        self.error: Exception | None = None
        self.ended = threading.Event()
        self._bus = bus
        self._changed = threading.Condition()
        self._open: set[Element] = set()
        self._not_prerolled: set[Element] = set()

    @property
    def is_prerolled(self) -> bool:
        """Whether every sink of a paused graph holds a frame."""
        return not self._not_prerolled

    def expect_end(self, sinks: Iterable[Sink]) -> None:
        """Adds sinks that have to end before the run does."""
        with self._changed:
            self._open.update(sinks)

    def expect_preroll(self, sinks: Iterable[Sink]) -> None:
        """Adds sinks of a paused graph that have to preroll: open ones, unless their `async` is off."""
        with self._changed:
            expected = {sink for sink in sinks if sink.wait_for_preroll}
            self._not_prerolled |= expected & self._open

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
            is_last = self._not_prerolled == {sink}
            self._not_prerolled.discard(sink)
            self._changed.notify_all()
        if is_last:
            self._bus.post(Message(MessageKind.ELEMENT, "", "prerolled", {"name": "async-done"}))

    def wait_prerolled(self, timeout_s: float) -> bool:
        """Waits until every sink holds its first frame; raises the error of a failed run."""
        with self._changed:
            self._changed.wait_for(lambda: self.is_prerolled or self.error is not None, timeout_s)
            if self.error is not None and not self.is_prerolled:
                raise self.error
            return self.is_prerolled

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


@runtime_checkable
class Streaming(Protocol):
    """An element with its own thread."""

    def stream(self) -> None:
        """Body of the thread; returns after EOS, raises if streaming ends otherwise."""


class StreamingThread(threading.Thread):
    """A thread that streams into an element or out of it.

    Args:
        element: named in errors; EOS follows them downstream of it.
        stream: body of the thread.
        playback: the run, which gets an error that ends streaming, and hears of the end in any case.
    """

    def __init__(self, element: Element, stream: Callable[[], None], playback: Playback) -> None:
        super().__init__(name=f"streamkit:{element.name}")
        self.element = element
        self.has_ended = False
        self._stream = stream
        self._playback = playback

    def run(self) -> None:
        """Streams; after an error reports it and sends EOS, so that other branches finish."""
        element = self.element
        try:
            self._stream()
        except NotLinked as stop:
            cause = NotNegotiated(f"pad {stop} is not linked; link it to a sink")
            self._fail(element.failure(cause))
        except FlowStop:
            pass
        except (ElementFailure, NotNegotiated) as error:
            self._fail(error)
        except BaseException as cause:  # also SystemExit: an unreported end leaves the graph waiting
            self._fail(element.failure(cause))
        finally:
            self.has_ended = True
            self._playback.thread_ended()

    def _fail(self, error: Exception) -> None:
        self._playback.fail(error)
        for pad in list(self.element.src_pads()):
            with contextlib.suppress(FlowStop, StreamkitError):
                pad.send_event(EOS)
