"""Through a router: every record is delivered or counted, and a lost publisher is known within 3 s."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "zenoh_delivery.py"


@pytest.fixture(scope="module")
def delivery() -> ModuleType:
    """The benchmark, which has 100 000 records and ten restarts in its long form."""
    spec = importlib.util.spec_from_file_location("zenoh_delivery", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("patience_s", [0.0, 30.0])
def test_three_subscribers_account_for_every_record(delivery: ModuleType, patience_s: float) -> None:
    """At full speed received and lost add up; with patience nothing is lost."""
    found = delivery.full_speed(3000, patience_s)
    published = found["published"]
    assert published["count"] == 3000
    for one in found["subscribers"]:
        assert one["received"] + one["lost"] == 3000
        assert one["lost"] == published["dropped"]
        assert (one["bad"], one["overwritten"], one["in_order"]) == (0, 0, True)
    assert (published["dropped"] == 0) is (patience_s > 0)


def test_a_router_may_die_and_so_may_the_publisher(delivery: ModuleType) -> None:
    """Records continue when the router is back; losses are exact; lost processes are known in time."""
    found = delivery.failures(2, 100, 400.0)
    assert max(found["noticed_s"]) < 3.0
    assert max(found["publisher_dead_s"]) < 3.0
    for one in found["subscribers"]:
        assert one["missing"] == one["lost"] > 0
        assert one["received"] > 100
        assert one["in_order"]
