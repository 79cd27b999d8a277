"""What the page makes of the working time and the drops in a status."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from selenium.webdriver import Chrome

SHARES = """
const [statuses, done] = [...arguments];
import("./load.js").then(({ ElementLoad, dropsOf }) => {
  const load = new ElementLoad();
  done(statuses.map((status) => {
    load.note(status);
    return [load.shares.map(({ name, share }) => [name, share]), dropsOf(status)];
  }));
});
"""


def status(run: int, published_ns: int, **busy_ns: int) -> dict[str, Any]:
    """A status with the working time of elements."""
    elements = [{"name": name, "busy_ns": value, "drops": []} for name, value in busy_ns.items()]
    return {"run": run, "published_ns": published_ns, "elements": elements}


@pytest.mark.timeout(120)
def test_shares_are_those_between_two_statuses_of_one_run(
    browser: Chrome, serve_keys: Callable[..., str], key: str
) -> None:
    """The busiest comes first, none above all of the time; no status counts twice, nor across runs."""
    browser.get(serve_keys(key))
    first, second = status(1, 10**9, a=0, b=10, d=0), status(1, 3 * 10**9, a=10**9, b=10, c=5, d=9 * 10**9)
    found = browser.execute_async_script(SHARES, [first, second, second, status(2, 4 * 10**9, a=1)])
    expected = [["d", 1], ["a", 0.5], ["b", 0]]
    assert [shares for shares, _ in found] == [[], expected, expected, expected]


@pytest.mark.timeout(120)
def test_drops_of_all_places_are_listed_the_most_first(
    browser: Chrome, serve_keys: Callable[..., str], key: str
) -> None:
    """Those of streams and of elements; nothing that dropped nothing, and nothing of older publishers."""
    browser.get(serve_keys(key))
    dropping = {
        "run": 1, "published_ns": 1, "drops": [{"stream": "tracks", "reason": "queue full", "count": 2}],
        "elements": [{"name": "q", "busy_ns": 0, "drops": [
            {"reason": "leaky", "count": 7}, {"reason": "x", "count": 0}
        ]}],
    }  # fmt: skip
    found = browser.execute_async_script(SHARES, [dropping, {"run": 1, "published_ns": 2}])
    assert [drops for _, drops in found] == [
        [
            {"place": "q", "reason": "leaky", "count": 7},
            {"place": "tracks", "reason": "queue full", "count": 2},
        ],
        [],
    ]
