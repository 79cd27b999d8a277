"""Feed: runs a pipeline in a thread, and again with back-off when it fails; measures what it costs."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Mapping

import msgspec
from typing_extensions import override

from streamkit import Display, MetricsEndpoint, Monitor, Pipeline, RestartDelay, Run, StreamkitError
from streamkit.masking import mask_secrets, presentable
from streamkit_fleet.feeds import FeedSpec

LOG_LINES = 1000
BEAT_S = 1.0  # a process may hold many feeds, whose displays draw nothing
STOP_LIMIT_S = 35.0  # the end of the stream has 30 s, as by `--watchdog-s`, and the stop 5
WINDOW_FRAMES = 50  # two seconds of a usual camera
WINDOW_S, MIN_FRAMES = 2.0, 5  # of one with fewer frames


class FeedStatus(msgspec.Struct, frozen=True, kw_only=True):
    """State and counters of a feed.

    Attributes:
        state: starting, playing, waiting (to start again), ended, failed, refused (no room); restarting if it
            does not answer.
        ready: whether it plays and delivers; `reason` says what is missing.
        cores: that it needs to hold its frame rate, as measured; 0 before.
        restarts: of the pipeline in this process, and one more if Ray has started the process again.
        frames, dropped: since the pipeline last started.
        metrics: HOST:PORT, or "".
        process: its name, as `by_process` gives it.
    """

    name: str
    state: str
    ready: bool = False
    reason: str = ""
    cores: float = 0.0
    restarts: int = 0
    frames: int = 0
    dropped: int = 0
    metrics: str = ""
    process: str = ""
    node: str = ""
    pid: int = 0


class FeedLog(Display):
    """Keeps the newest lines; they also go to stderr, which Ray keeps in a file."""

    form = "json"
    kept: deque[str]

    @override
    def print_line(self, line: str) -> None:
        self.kept.append(f"{time.strftime('%Y-%m-%dT%H:%M:%SZ', time.gmtime())} {presentable(line)}")
        super().print_line(line)


class Feed:
    """A pipeline as `launch -e --metrics` runs it.

    Args:
        name: of the feed.
        spec: its entry in the table.
        restarts: of its process.
        sharing: number of feeds in the process, which count as equal parts of its processor time.
    """

    def __init__(self, name: str, spec: FeedSpec, *, restarts: int, sharing: int) -> None:
        self._name, self._spec = name, spec
        self._restarts, self._sharing = restarts, sharing
        self._state, self._reason = "starting", ""
        self._lines: deque[str] = deque(maxlen=LOG_LINES)
        self._stopping = threading.Event()
        self._monitor: Monitor | None = None
        self._run: Run | None = None
        self._cost: CostMeter | None = None
        self._metrics = ""
        self._thread = threading.Thread(target=self._serve, name=f"streamkit:feed:{name}", daemon=True)
        self._thread.start()

    def status(self) -> FeedStatus:
        """Its state and counters now."""
        reason = self._reason
        rows = [] if self._monitor is None else self._monitor.pipeline.statistics()
        if self._state == "playing" and self._monitor is not None:
            reason = self._monitor.not_ready_reason()
            if reason and self._reason:
                reason += f"; last failure: {self._reason}"
            if self._cost is not None:
                self._cost.update()
        return FeedStatus(
            name=self._name,
            state=self._state,
            ready=self._state == "playing" and not reason,
            reason=reason,
            cores=0.0 if self._cost is None else self._cost.cores,
            restarts=self._restarts,
            frames=max((row.frames_in for row in rows), default=0),
            dropped=sum(row.total_dropped for row in rows),
            metrics=self._metrics,
        )

    def logs(self) -> list[str]:
        """Its newest lines."""
        return list(self._lines)

    def stop(self) -> None:
        """Ends the stream, so that files are completed; `join` waits for it."""
        self._stopping.set()
        if self._run is not None:
            self._run.interrupt()

    def join(self, limit_s: float) -> None:
        """Waits until the stream has ended."""
        self._thread.join(limit_s)

    def refuse(self, reason: str) -> None:
        """Ends the stream for want of room; the feed stays to say so."""
        self.stop()
        self.join(STOP_LIMIT_S)
        self._state, self._reason = "refused", reason

    # The thread.

    def _serve(self) -> None:
        """Runs the pipeline until it ends, is stopped, or cannot be built."""
        delay = RestartDelay()
        while not self._stopping.is_set():
            began_s = time.monotonic()
            try:
                code = self._play()
            except StreamkitError as error:
                self._state, self._reason = "failed", presentable(mask_secrets(str(error)))
                self._lines.append(self._reason)
                return
            if code == 0:
                break
            self._state, self._reason = "waiting", self._lines[-1] if self._lines else ""
            self._restarts += 1
            self._stopping.wait(delay.after(time.monotonic() - began_s))
        self._state, self._reason = "ended", ""

    def _play(self) -> int:
        """Runs it once, as `launch` does; returns the exit code.

        Raises:
            StreamkitError: it cannot be built, or its metrics cannot be served.
        """
        pipeline = Pipeline.parse(self._spec.text, self._spec.variables())
        self._monitor = monitor = Monitor(pipeline, {})
        monitor.pipeline_restarts = self._restarts
        self._cost = CostMeter(pipeline, self._spec.frame_rate, self._sharing)
        log = FeedLog(pipeline)
        log.kept = self._lines
        self._run = run = Run(
            pipeline,
            log,
            eos_on_shutdown=True,
            verbose=False,
            quiet=False,
            monitor=monitor,
            beat_s=BEAT_S,
        )
        self._state = "playing"
        if not self._spec.metrics:
            return run.run()
        with MetricsEndpoint(monitor, self._spec.metrics) as endpoint:
            self._metrics = endpoint.address
            try:
                return run.run()
            finally:
                self._metrics = ""


class CostMeter:
    """Measures the cores that a playing pipeline needs to hold a frame rate.

    Args:
        pipeline: the pipeline.
        frame_rate: to hold, 1/s.
        sharing: number of pipelines in the process, which count as equal parts of its processor time.

    Attributes:
        cores: processor time per frame of the last whole window, times the frame rate; 0 before the second,
            as the frames of the first one fill caches and queues.
    """

    def __init__(self, pipeline: Pipeline, frame_rate: float, sharing: int = 1) -> None:
        self._pipeline, self._frame_rate, self._sharing = pipeline, frame_rate, sharing
        self._frames, self._began_s, self._cpu_ns = 0, time.monotonic(), 0  # where the window begins
        self.cores = 0.0

    def update(self) -> None:
        """Ends the window if it is long enough.

        Frames that queues dropped do not count: without room for all, the rest costs what all would.
        """
        rows = self._pipeline.statistics()
        frames = max((row.frames_in for row in rows), default=0)
        frames -= sum(row.total_dropped for row in rows if row.queue is not None)
        new, now_s = frames - self._frames, time.monotonic()
        if new < WINDOW_FRAMES and (new < MIN_FRAMES or now_s - self._began_s < WINDOW_S):
            return
        cpu_ns = sum(row.cpu_ns for row in self._pipeline.process_statistics())
        if self._frames:
            self.cores = (cpu_ns - self._cpu_ns) / 1e9 / self._sharing / new * self._frame_rate
        self._frames, self._began_s, self._cpu_ns = frames, now_s, cpu_ns


def excess(needs: Mapping[str, float], room: float, new: Mapping[str, FeedSpec]) -> dict[str, str]:
    """The new feeds of a machine that it cannot hold, with the reason.

    Those with the highest nice go first, of equal ones the last. `needs` are the cores that each feed on the
    machine needs, `room` those that it has.
    """
    refused = {}
    total = sum(needs.values())
    for name, feed in sorted(new.items(), key=lambda item: item[1].nice)[::-1]:
        if total <= room:
            break
        total -= needs[name]
        refused[name] = (
            f"no room: for {feed.frame_rate:g} frames/s it needs {needs[name]:.3g} of {room:g} cores, and "
            f"the other feeds there {total:.3g}; set its cores to {needs[name]:.3g}, or a lower frame_rate"
        )
    return refused
