"""Prometheus metrics of a pipeline, made from its statistics when they are asked for."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import accumulate

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    Metric,
)

from streamkit.flow.statistics import ElementStatistics
from streamkit.service.monitor import AGE_BOUNDS_S, Monitor

ELEMENT = ("element", "factory")
RESULTS = "Things an element has made, such as confirmed tracks or files."
OUTCOMES = "Frames by what an element has found of each, such as the status of its registration."


class PipelineCollector:
    """Gives Prometheus the counters of a pipeline; costs nothing between two scrapes."""

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor

    def collect(self) -> Iterator[Metric]:
        """The metrics, in OpenMetrics' names and units."""
        rows = self._monitor.pipeline.statistics()
        yield _gauge("pipeline_healthy", "1 if /healthz says so.", not self._monitor.unhealthy_reason())
        yield _gauge("pipeline_ready", "1 if /readyz says so.", not self._monitor.not_ready_reason())
        restarts = CounterMetricFamily("streamkit_pipeline_restarts", "Restarts by a supervisor.")
        restarts.add_metric((), self._monitor.pipeline_restarts)
        yield restarts
        yield from _elements(rows)
        yield from _queues(rows)
        for name, text, counts in (
            ("reconnects", "Connections made again after they were lost.", self._monitor.reconnects),
            ("process_restarts", "Processes of bins started again.", self._monitor.restarts),
        ):
            family = CounterMetricFamily(f"streamkit_{name}", text, labels=("element",))
            for element, count in list(counts.items()):
                family.add_metric((element,), count)
            yield family
        yield self._ages()

    def _ages(self) -> Metric:
        family = HistogramMetricFamily(
            "streamkit_age",
            "Age of the newest frame at a sink, sampled five times a second.",
            labels=("element",),
            unit="seconds",
        )
        bounds = [*map(str, AGE_BOUNDS_S), "+Inf"]
        for element, counts in list(self._monitor.ages.items()):
            buckets = list(zip(bounds, map(float, accumulate(counts)), strict=True))
            family.add_metric((element,), buckets, self._monitor.age_sums_s[element])
        return family


def _gauge(name: str, text: str, value: float) -> Metric:
    return GaugeMetricFamily(f"streamkit_{name}", text, float(value))


def _elements(rows: list[ElementStatistics]) -> Iterator[Metric]:
    """What every element counts."""
    info = InfoMetricFamily("streamkit_element", "Elements of the pipeline.", labels=ELEMENT)
    frames = CounterMetricFamily(
        "streamkit_element_frames", "Frames in and out of an element.", labels=("element", "direction")
    )
    dropped = CounterMetricFamily(
        "streamkit_element_dropped_frames", "Frames not passed on.", labels=("element", "reason")
    )
    busy = CounterMetricFamily("streamkit_element_busy", "Working time.", labels=("element",), unit="seconds")
    messages = CounterMetricFamily(
        "streamkit_element_messages", "Errors and warnings posted.", labels=("element", "kind")
    )
    results = CounterMetricFamily("streamkit_results", RESULTS, labels=("element", "result"))
    outcomes = CounterMetricFamily("streamkit_outcomes", OUTCOMES, labels=("element", "outcome"))
    for row in rows:
        name = row.element
        info.add_metric((name, row.factory), {})
        frames.add_metric((name, "in"), row.frames_in)
        frames.add_metric((name, "out"), row.frames_out)
        busy.add_metric((name,), row.busy_ns / 1e9)
        messages.add_metric((name, "error"), row.errors)
        messages.add_metric((name, "warning"), row.warnings)
        for family, counts in ((dropped, row.dropped), (results, row.results), (outcomes, row.outcomes)):
            for label, count in counts.items():
                family.add_metric((name, label), count)
    yield from (info, frames, dropped, busy, messages, results, outcomes)


def _queues(rows: list[ElementStatistics]) -> Iterator[Metric]:
    """The levels of elements that hold frames."""
    frames = GaugeMetricFamily("streamkit_queue_frames", "Frames held.", labels=("element",))
    limit = GaugeMetricFamily(
        "streamkit_queue_limit_frames", "Frames that fill it; 0: none.", labels=("element",)
    )
    size = GaugeMetricFamily("streamkit_queue", "Memory held.", labels=("element",), unit="bytes")
    span = GaugeMetricFamily("streamkit_queue", "Time held.", labels=("element",), unit="seconds")
    for row in rows:
        if row.queue is not None:
            frames.add_metric((row.element,), row.queue.buffers)
            limit.add_metric((row.element,), row.queue.limit_buffers)
            size.add_metric((row.element,), row.queue.bytes)
            span.add_metric((row.element,), row.queue.time_ns / 1e9)
    yield from (frames, limit, size, span)
