"""A source that may have to wait long for its next frame, and ends all the same when it is asked to."""

from __future__ import annotations

import threading
from typing import Any

from streamkit import Source


class EndableSource(Source):
    """Base of sources whose waits end with the stream: they watch `over` rather than `stopping`.

    Attributes:
        over: set once the stream is to end, or the pipeline stops.
    """

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.over = threading.Event()
        super().__init__(name, **properties)

    def prepare_run(self) -> None:
        """Forgets an earlier run's end."""
        super().prepare_run()
        self.over.clear()

    def finish(self) -> None:
        """Ends the stream now, also where its next frame is far off or may never come."""
        self.over.set()
        super().finish()

    def halt(self) -> None:
        """Leaves every wait: the pipeline is stopping."""
        self.over.set()
        super().halt()
