"""StreamingThread: a thread that pushes the frames of a source or queue, and reports how it ends."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from typing import Protocol, runtime_checkable

from streamkit.element.base import Element
from streamkit.errors import ElementFailure, NotNegotiated, StreamkitError
from streamkit.flow.events import EOS, FlowStop, NotLinked


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
        failed: called with the error that ended streaming.
        ended: called last in any case.
    """

    def __init__(
        self,
        element: Element,
        stream: Callable[[], None],
        failed: Callable[[Exception], None],
        ended: Callable[[], None],
    ) -> None:
        super().__init__(name=f"streamkit:{element.name}")
        self.element = element
        self.has_ended = False
        self._stream = stream
        self._failed = failed
        self._ended = ended

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
            self._ended()

    def _fail(self, error: Exception) -> None:
        self._failed(error)
        for pad in list(self.element.src_pads()):
            with contextlib.suppress(FlowStop, StreamkitError):
                pad.send_event(EOS)
