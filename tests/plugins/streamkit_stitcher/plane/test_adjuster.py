"""The background adjustment."""

import threading
from typing import Any

from streamkit_stitcher.bundle_adjustment.adjustment import AdjustmentSettings
from streamkit_stitcher.plane.adjuster import NOTHING, BackgroundAdjuster

WORKER = "adjuster"


class Held(BackgroundAdjuster):
    """Its jobs last until the gate opens."""

    def __init__(self) -> None:
        super().__init__()
        self.gate = threading.Event()

    def _run(self, *job: Any) -> Any:
        self.gate.wait(30)
        return NOTHING


def test_a_retired_worker_has_ended_when_closed() -> None:
    """Closing waits for the last adjustment, and no thread is left."""
    adjuster = Held()
    adjuster.submit(None, AdjustmentSettings(), lambda: ())
    opener = threading.Timer(0.2, adjuster.gate.set)
    opener.start()
    adjuster.close()
    opener.join(5)
    assert not [thread for thread in threading.enumerate() if thread.name.startswith(WORKER)]
