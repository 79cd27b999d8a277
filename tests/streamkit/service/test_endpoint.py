"""MetricsEndpoint: what a scrape and a probe get."""

from __future__ import annotations

import json
import re
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from prometheus_client.openmetrics.parser import text_string_to_metric_families
from prometheus_client.samples import Sample

from streamkit import Pipeline, ResourceError, Transform
from streamkit.service.endpoint import MetricsEndpoint
from streamkit.service.monitor import Monitor

DEPLOY = Path(__file__).parents[3] / "deploy"
OPENMETRICS = {"Accept": "application/openmetrics-text; version=1.0.0"}
TEXT = "fakesrc num-buffers=20 ! queue ! sorter ! valve drop=true name=closed ! fakesink name=out"
METRIC = re.compile(r"\b(?:(?:streamkit|process)_\w+|up\b)")
GROUPED = re.compile(r"(?:by|ignoring) \(([^)]+)\)")
SELECTED = re.compile(r'(\w+)=~?"')


class Sorter(Transform):
    """Finds every second frame lost, and makes two tracks."""

    sink = src = "ANY"

    def transform(self, frame):
        self.results["tracks"] = 2
        self.outcomes["lost" if frame.seq % 2 else "ok"] += 1
        return frame


def get(address: str, path: str) -> tuple[int, str]:
    """Status and text of a page."""
    request = urllib.request.Request(f"http://{address}{path}", headers=OPENMETRICS)
    try:
        with urllib.request.urlopen(request, timeout=20) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


@pytest.fixture
def monitor(register) -> Iterator[Monitor]:
    """Of a pipeline that has come to its end."""
    register(sorter=Sorter)
    with Pipeline.parse(TEXT) as pipeline:
        found = Monitor(pipeline, {})
        yield found


def samples(monitor: Monitor) -> list[Sample]:
    """What a scrape gets after the run, read by the client's own parser."""
    with MetricsEndpoint(monitor, "127.0.0.1:0") as endpoint:
        monitor.pipeline.play()
        monitor.pipeline.wait(20)
        monitor.begin()
        status, text = get(endpoint.address, "/metrics")
    assert status == 200
    return [sample for family in text_string_to_metric_families(text) for sample in family.samples]


def test_a_scrape_has_what_the_statistics_have(monitor: Monitor) -> None:
    """Frames, drops by reason, work, queues, results, outcomes, ages and memory, each under its name."""
    found = {(one.name, *sorted(one.labels.values())): one.value for one in samples(monitor)}
    assert found["streamkit_element_frames_total", "in", "queue0"] == 20
    assert found["streamkit_element_info", "closed", "valve"] == 1
    rows = {row.element: row for row in monitor.pipeline.statistics()}
    for reason, count in rows["closed"].dropped.items():
        assert found["streamkit_element_dropped_frames_total", *sorted(("closed", reason))] == count == 20
    assert found["streamkit_element_busy_seconds_total", "sorter0"] == rows["sorter0"].busy_ns / 1e9 > 0
    assert found["streamkit_queue_frames", "queue0"] == 0
    assert found["streamkit_queue_limit_frames", "queue0"] == rows["queue0"].queue.limit_buffers
    assert found["streamkit_results_total", "sorter0", "tracks"] == 2
    assert found["streamkit_outcomes_total", "lost", "sorter0"] == 10
    assert found[("streamkit_pipeline_healthy",)] == 1
    assert found[("process_resident_memory_bytes",)] > 1e6
    assert (
        found["streamkit_age_seconds_count", "closed"]
        == found["streamkit_age_seconds_bucket", "+Inf", "closed"]
        == 1
    )


def test_probes_answer_with_the_reason(monitor: Monitor) -> None:
    """200 and ok, or 503 and what is missing; another page is not there."""
    with MetricsEndpoint(monitor, "127.0.0.1:0") as endpoint:
        assert get(endpoint.address, "/healthz") == (200, "ok\n")
        assert get(endpoint.address, "/readyz") == (503, "the pipeline is null, not playing\n")
        assert get(endpoint.address, "/other")[0] == 404


def test_an_address_that_cannot_be_used_is_refused(monitor: Monitor) -> None:
    """The error names the address and the rule."""
    with pytest.raises(ResourceError, match=r"HOST:PORT, got '9464'"):
        MetricsEndpoint(monitor, "9464")
    with (
        MetricsEndpoint(monitor, "127.0.0.1:0") as endpoint,
        pytest.raises(ResourceError, match=r"cannot be served at 127.0.0.1:\d+: Address already in use"),
    ):
        MetricsEndpoint(monitor, endpoint.address)


def rules() -> dict[str, str]:
    """The expressions of the alerts and of the dashboard, by name."""
    groups = yaml.safe_load((DEPLOY / "alerts.yml").read_text("utf-8"))["groups"]
    alerts = {rule["alert"]: rule["expr"] for group in groups for rule in group["rules"]}
    panels = json.loads((DEPLOY / "grafana.json").read_text("utf-8"))["panels"]
    return alerts | {panel["title"]: one["expr"] for panel in panels for one in panel["targets"]}


def test_alerts_and_dashboard_are_valid_and_ask_for_what_is_there(monitor: Monitor) -> None:
    """Prometheus' grammar and types accept each expression; a scrape has each of its names and labels."""
    parser = pytest.importorskip("promql_parser")
    monitor.reconnects["src"] = monitor.restarts["bin"] = 1
    found = samples(monitor)
    names = {one.name for one in found} | {"up"}  # by Prometheus itself, as are two labels
    labels = {label for one in found for label in one.labels} | {"instance", "job"}
    for name, expression in rules().items():
        parser.parse(expression)
        assert METRIC.search(expression), name
        assert set(METRIC.findall(expression)) <= names, name
        grouped = [label for group in GROUPED.findall(expression) for label in group.split(", ")]
        assert {*grouped, *SELECTED.findall(expression)} <= labels, name
