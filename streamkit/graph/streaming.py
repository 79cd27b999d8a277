"""Streaming threads, one per source and queue."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from typing import Protocol, runtime_checkable

from streamkit.element.base import Element
from streamkit.errors import ElementFailure, NotNegotiated, StreamkitError
from streamkit.flow.events import EOS, EndOfStream, FlowStop, Flushing, NotLinked


@runtime_checkable
class Streaming(Protocol):
    """An element with its own thread."""

    name: str

    def stream(self) -> None:
        """Body of the thread; returns after EOS, raises if streaming ends otherwise."""

    def prepare_run(self) -> None:
        """Resets the state of an earlier run."""


class StreamingThread:
    """The thread of one element."""

    def __init__(
        self, element: Streaming, failed: Callable[[Exception], None], ended: Callable[[], None]
    ) -> None:
        """Makes a thread that is not started yet.

        Args:
            element: streams in the thread.
            failed: called with the error that ended streaming.
            ended: called last in any case.
        """
        self.element = element
        self.has_ended = False
        self._failed = failed
        self._ended = ended
        self._thread = threading.Thread(target=self._run, name=f"streamkit:{element.name}")

    def start(self) -> None:
        """Starts streaming."""
        self._thread.start()

    def join(self, deadline: float) -> bool:
        """Waits until the deadline (`time.monotonic()`); whether the thread has ended."""
        self._thread.join(max(0.0, deadline - time.monotonic()))
        return not self._thread.is_alive()

    @property
    def is_current(self) -> bool:
        """Whether this is the calling thread."""
        return threading.current_thread() is self._thread

    def _run(self) -> None:
        try:
            self._stream()
        finally:
            self.has_ended = True
            self._ended()

    def _stream(self) -> None:
        element = self.element
        assert isinstance(element, Element)
        try:
            element.stream()
        except (Flushing, EndOfStream):
            return
        except NotLinked as stop:
            cause = NotNegotiated(f"pad {stop} is not linked; link it to a sink")
            self._fail(ElementFailure(element.name, element.factory, cause))
        except FlowStop:
            return
        except (ElementFailure, NotNegotiated) as error:
            self._fail(error)
        except BaseException as cause:  # also SystemExit: an unreported end leaves the graph waiting
            self._fail(element.failure(cause))

    def _fail(self, error: Exception) -> None:
        """Reports the error, then sends EOS, so that other branches finish."""
        self._failed(error)
        element = self.element
        assert isinstance(element, Element)
        for pad in list(element.src_pads()):
            with contextlib.suppress(FlowStop, StreamkitError):
                pad.send_event(EOS)
