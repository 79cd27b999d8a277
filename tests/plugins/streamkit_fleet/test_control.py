"""Feeds on a cluster of two nodes: placed, replaced, restarted, moved, ended."""

from __future__ import annotations

import os
import re
import signal
import threading
import time
import urllib.request
import uuid
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from streamkit import ResourceError
from streamkit_fleet import control
from streamkit_fleet.feed import FeedStatus
from streamkit_fleet.feeds import FeedSpec
from streamkit_fleet.local_ray import connected
from streamkit_zenoh import TrackSubscriber
from tests.slowness import patience

pytestmark = pytest.mark.long
SMALL = {"object_store_memory": 80_000_000, "include_dashboard": False}
LIVE = "videotestsrc is-live=true ! video/x-raw, width=32, height=32 ! fakesink name=${name}"
SECRET = "never-shown"


@dataclass
class Nodes:
    """The cluster; `second` is the node with the tag site-b."""

    cluster: Any
    second: Any


@pytest.fixture(scope="module")
def nodes() -> Iterator[Nodes]:
    """A head and a second node."""
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FEED_SECRET", SECRET)
        patch.setenv("RAY_worker_niceness", "0")
        patch.setenv("RAY_health_check_period_ms", "500")
        patch.setenv("RAY_health_check_failure_threshold", "3")
        cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, **SMALL})
        try:
            second = cluster.add_node(num_cpus=1, resources={"site-b": 1}, object_store_memory=80_000_000)
            with connected(cluster.address):
                yield Nodes(cluster, second)
        finally:
            cluster.shutdown()


def feed(name: str, **settings: Any) -> FeedSpec:
    """A live feed of a few pixels."""
    return FeedSpec(text=LIVE, set={"name": name}, cores=0.2, **settings)


def wait_for(is_so: Callable[[dict[str, FeedStatus]], bool]) -> dict[str, FeedStatus]:
    """The feeds' status, once it is as expected."""
    deadline_s = time.monotonic() + patience(50)
    while True:
        found = {status.name: status for status in control.statuses(limit_s=5.0)}
        if is_so(found):
            return found
        assert time.monotonic() < deadline_s, found
        time.sleep(0.1)


def all_ready(found: dict[str, FeedStatus]) -> bool:
    """Whether every feed plays."""
    return bool(found) and all(status.ready for status in found.values())


@pytest.mark.timeout(240)
def test_the_life_of_a_fleet(nodes: Nodes) -> None:
    """Started, changed, killed, moved and ended, each without harm to the others."""
    second = nodes.second.node_id
    table = {
        "gate": feed("gate", secrets={"pass": "env:FEED_SECRET"}),
        "roof": feed("roof", tags=["site-b"]),
        "yard": feed("yard"),
    }
    assert control.apply(table) == dict.fromkeys(table, "started")
    before = wait_for(all_ready)
    assert before["roof"].node == second
    with urllib.request.urlopen(f"http://{before['gate'].metrics}/readyz", timeout=patience(10)) as answer:
        assert answer.read() == b"ok\n"
    assert SECRET not in repr(before)
    assert SECRET not in repr(control.logs("gate"))

    table = {"gate": table["gate"], "roof": table["roof"], "door": feed("door")}
    changed = {**table, "roof": feed("roof")}
    done = {"gate": "unchanged", "roof": "replaced", "yard": "stopped", "door": "started"}
    assert control.apply(changed) == done
    after = wait_for(lambda found: all_ready(found) and set(found) == set(table))
    assert after["gate"].pid == before["gate"].pid

    os.kill(after["gate"].pid, signal.SIGKILL)
    again = wait_for(lambda found: all_ready(found) and found["gate"].pid != after["gate"].pid)
    assert again["door"].pid == after["door"].pid
    assert (again["gate"].restarts, again["door"].restarts) == (1, 0)

    here = again["gate"].node
    assert "gate" in control.drain(here[:12], changed)
    assert here not in {status.node for status in wait_for(all_ready).values()}

    with pytest.raises(ResourceError, match="no single node begins with 'zz'"):
        control.drain("zz", changed)
    with pytest.raises(ResourceError, match="no feed 'attic' runs; there are door, gate, roof"):
        control.logs("attic")
    control.stop(control.running())
    wait_for(lambda found: not found)


@pytest.mark.timeout(240)
def test_feeds_share_a_process(nodes: Nodes) -> None:
    """They are placed, replaced and started again together; others go on, and each has its own status."""
    table = {name: feed(name, process="light") for name in ("gate", "roof")} | {"yard": feed("yard")}
    control.apply(table)
    first = wait_for(lambda found: all_ready(found) and len(found) == 3)
    assert first["gate"].pid == first["roof"].pid != first["yard"].pid

    os.kill(first["gate"].pid, signal.SIGKILL)
    second = wait_for(
        lambda found: all_ready(found) and len(found) == 3 and found["roof"].pid != first["roof"].pid
    )
    assert (second["gate"].restarts, second["roof"].restarts, second["yard"].restarts) == (1, 1, 0)

    del table["roof"]
    assert control.apply(table) == {"gate": "replaced", "roof": "stopped", "yard": "unchanged"}
    third = wait_for(lambda found: all_ready(found) and len(found) == 2)
    assert third["yard"].pid == first["yard"].pid
    control.stop(control.running())


@pytest.mark.timeout(240)
def test_a_silent_process_is_replaced_only_if_its_feeds_changed(
    nodes: Nodes, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A machine without time for an answer is no reason to interrupt its feeds."""
    monkeypatch.setattr(control, "APPLY_LIMIT_S", patience(1))
    table = {name: feed(name, process="light") for name in ("gate", "roof")}
    control.apply(table)
    pid = wait_for(all_ready)["gate"].pid
    os.kill(pid, signal.SIGSTOP)
    assert control.apply(table) == {"gate": "unchanged", "roof": "unchanged"}
    os.kill(pid, signal.SIGCONT)
    assert wait_for(all_ready)["gate"].pid == pid
    control.stop(control.running())


@pytest.mark.timeout(240)
def test_a_dead_node_loses_no_feed(nodes: Nodes) -> None:
    """Ray notices, and starts its feeds where there is room; one that needs that node waits and says so."""
    third = nodes.cluster.add_node(num_cpus=1, resources={"site-c": 1}, object_store_memory=80_000_000)
    control.apply({"gate": feed("gate", tags=["site-c"]), "roof": feed("roof")})
    before = wait_for(all_ready)
    assert before["gate"].node == third.node_id
    fresh = nodes.cluster.add_node(num_cpus=1, resources={"site-c": 1}, object_store_memory=80_000_000)
    nodes.cluster.remove_node(third, allow_graceful=False)
    after = wait_for(lambda found: all_ready(found) and found["gate"].node == fresh.node_id)
    assert after["roof"].pid == before["roof"].pid
    control.stop(["feed:gate", "feed:roof"])
    assert control.statuses() == []


@pytest.mark.timeout(240)
def test_a_subscriber_sees_each_run_whole(nodes: Nodes) -> None:
    """A feed's process dies, then its node: each start is a later run, and every gap in a run is counted."""
    for _ in range(2):
        nodes.cluster.add_node(num_cpus=1, resources={"site-d": 1}, object_store_memory=80_000_000)
    publish = LIVE.replace("fakesink name=${name}", "zenohsink key=${name}")
    key = f"test/{uuid.uuid4().hex}"
    seen: dict[int, list[int]] = defaultdict(list)  # numbers of the frames, by run
    with TrackSubscriber(key, ring=100_000, ask_last=False) as subscriber:

        def listen() -> None:
            for update in subscriber.updates():
                if update.record is not None:
                    seen[update.run].append(update.record.seq)

        thread = threading.Thread(target=listen, daemon=True)
        thread.start()
        spec = FeedSpec(text=publish, set={"name": key}, cores=0.2, tags=["site-d"])
        control.apply({"gate": spec})
        first = wait_for(lambda found: all_ready(found) and len(seen) == 1)["gate"]
        os.kill(first.pid, signal.SIGKILL)
        second = wait_for(lambda found: all_ready(found) and len(seen) == 2)["gate"]
        host = next(node for node in nodes.cluster.list_all_nodes() if node.node_id == second.node)
        nodes.cluster.remove_node(host, allow_graceful=False)
        wait_for(lambda found: all_ready(found) and len(seen) == 3)
        control.stop(["feed:gate"])
        counts = subscriber.counts
    thread.join(patience(10))
    assert list(seen) == sorted(seen)
    assert counts.restarts == 2
    gaps = sum(numbers[-1] - numbers[0] + 1 - len(numbers) for numbers in seen.values())
    # Lost are also those before the first one that came, from when the publisher knew the subscriber.
    assert gaps <= counts.lost <= gaps + sum(numbers[0] for numbers in seen.values())
    assert all(numbers == sorted(numbers) for numbers in seen.values())


@pytest.mark.timeout(240)
def test_a_feed_without_room_is_refused_with_the_numbers(nodes: Nodes) -> None:
    """The measured cost decides; the feed stays stopped, says why, and is tried again by the next apply."""
    small = feed("small", frame_rate=0.001, nice=3)
    control.apply({"small": small})
    big = feed("big", frame_rate=1e6)
    table = {"small": small, "big": big}
    assert control.apply(table) == {"small": "unchanged", "big": "started"}
    wait_for(lambda found: all_ready(found) and len(found) == 2)
    refused = control.admit({"big": big}, patience(20))
    said = r"no room: for 1e\+06 frames/s it needs [\d.e+]+ of 1 cores, .* there [\d.e-]+; set"
    assert re.match(said, refused["big"])
    found = wait_for(lambda found: found["big"].state == "refused")
    assert found["big"].reason == refused["big"]
    assert found["small"].ready
    assert os.getpriority(os.PRIO_PROCESS, found["small"].pid) == min(os.nice(0) + 3, 19)
    table["big"] = feed("big", frame_rate=0.001)
    assert control.apply(table)["big"] == "replaced"
    wait_for(all_ready)
    assert control.admit({"big": table["big"]}, patience(20)) == {}
    control.stop(control.running())


@pytest.mark.timeout(240)
def test_a_pipeline_that_fails_is_started_again_and_a_missing_secret_is_said(nodes: Nodes) -> None:
    """The reason names the last failure, also while the pipeline starts again; the log keeps it.

    Neither harms another feed of the process.
    """
    bad = "fakesrc ! identity error-after=5 name=bad ! fakesink"
    broken = FeedSpec(text=bad, cores=0.2, metrics="", process="shared")
    locked = feed("locked", process="shared", secrets={"pass": "env:NOT_SET_ANYWHERE"})
    control.apply({"broken": broken, "locked": locked, "gate": feed("gate", process="shared")})
    found = wait_for(
        lambda found: (
            len(found) == 3
            and found["gate"].ready
            and bool(found["broken"].restarts and found["broken"].reason)
        )
    )
    assert control.logs("gate") == []
    assert "bad" in found["broken"].reason
    assert any("error-after=5" in line for line in control.logs("broken"))
    assert (found["locked"].state, found["locked"].ready) == ("failed", False)
    assert "the secret env:NOT_SET_ANYWHERE is not there" in found["locked"].reason
    control.stop(control.running())
