"""Monitor: the health of a pipeline, reported to systemd and read by probes."""

from __future__ import annotations

import os
import socket
import time
from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from contextlib import suppress

from streamkit.flow.messages import LostConnections, Message
from streamkit.graph.pipeline import Pipeline
from streamkit.graph.streaming import State
from streamkit.service.supervisor import RESTARTS_VARIABLE

SILENCE_LIMIT_S = 10.0  # without a beat of the main loop, which has one a second or more
AGE_BOUNDS_S = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0)


class Monitor:
    """Watches one run of a pipeline; the loop that waits for its end calls `beat`.

    Attributes:
        pipeline: the pipeline.
        pipeline_restarts: of the whole pipeline, by what supervises it.
        reconnects: connections made again, by element.
        restarts: processes of bins started again, by element.
        samples_ages: whether `beat` samples the age of the newest frame at each sink.
        ages: by sink, the number of samples in each class of `AGE_BOUNDS_S`; the last class is open.
        age_sums_s: by sink, the sum of the samples, s.

    Args:
        pipeline: the pipeline.
        variables: environment with systemd's `NOTIFY_SOCKET` and `WATCHDOG_USEC`, and the number of restarts.
        now_s: the clock.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        variables: Mapping[str, str] = os.environ,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.pipeline = pipeline
        self.pipeline_restarts = int(variables.get(RESTARTS_VARIABLE) or 0)
        self.reconnects: Counter[str] = Counter()
        self.restarts: Counter[str] = Counter()
        self.samples_ages = False
        self.ages: dict[str, list[int]] = {}
        self.age_sums_s: dict[str, float] = defaultdict(float)
        self._now_s = now_s
        self._address = variables.get("NOTIFY_SOCKET", "")
        self._notify_every_s = int(variables.get("WATCHDOG_USEC") or 0) / 2e6  # half, as systemd advises
        self._beat_s: float | None = None
        self._notified_s = 0.0
        self._lost = LostConnections()
        pipeline.bus.watch(self._note)

    # Called by the loop that runs the pipeline.

    def begin(self) -> None:
        """The pipeline plays."""
        self._notify("READY=1")
        self.beat()

    def beat(self) -> None:
        """The loop is alive: samples ages, and answers systemd's watchdog in time."""
        now_s = self._beat_s = self._now_s()
        if self.samples_ages:
            self._sample_ages()
        if self._notify_every_s and now_s - self._notified_s >= self._notify_every_s:
            self._notified_s = now_s
            self._notify("WATCHDOG=1")

    def end(self) -> None:
        """The pipeline is about to stop."""
        self._notify("STOPPING=1")

    # Asked by probes, in their threads.

    def unhealthy_reason(self) -> str:
        """Why the process should be replaced, or ""; a pipeline that starts is healthy."""
        if self.pipeline.error is not None:
            return f"the pipeline has failed: {self.pipeline.error}"
        silence_s = 0.0 if self._beat_s is None else self._now_s() - self._beat_s
        if silence_s > SILENCE_LIMIT_S:
            return f"the main loop has not run for {silence_s:.0f} s"
        return ""

    def not_ready_reason(self) -> str:
        """Why the pipeline is not ready, or "": it plays, is connected, and every sink has frames."""
        if reason := self.unhealthy_reason():
            return reason
        if self.pipeline.state is not State.PLAYING:
            return f"the pipeline is {self.pipeline.state}, not playing"
        for element, state in list(self._lost.states.items()):
            return f"{element} is not connected ({state})"
        for row in self.pipeline.statistics():
            if row.pads and not row.frames_in and all(pad.direction == "sink" for pad in row.pads):
                return f"no frame has reached {row.element}"
        return ""

    def _note(self, message: Message) -> None:
        """Counts what elements report of their connections and processes."""
        if message.fields.get("code") == "process-restart":
            self.restarts[message.source] += 1
        if self._lost.update(message):
            self.reconnects[message.source] += 1

    def _sample_ages(self) -> None:
        for row in self.pipeline.statistics():
            if row.age_ns is not None and not row.frames_out:
                counts = self.ages.setdefault(row.element, [0] * (len(AGE_BOUNDS_S) + 1))
                counts[bisect_left(AGE_BOUNDS_S, row.age_ns / 1e9)] += 1
                self.age_sums_s[row.element] += row.age_ns / 1e9

    def _notify(self, text: str) -> None:
        """Sends a line to systemd's socket; without one, or a listener, nothing happens.

        Source: sd_notify(3).
        """
        if not self._address:
            return
        path = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        with (
            suppress(OSError),
            socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as channel,
        ):
            channel.setblocking(False)
            channel.sendto(text.encode(), path)
