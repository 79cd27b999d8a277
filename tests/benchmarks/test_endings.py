"""Outputs of a run that is killed or stopped can be read, but for the last seconds."""

import importlib.util
import math
import signal
import sys
from pathlib import Path
from types import ModuleType

import pytest

PATH = Path(__file__).parents[2] / "benchmarks" / "endings.py"


@pytest.fixture
def endings(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The benchmark, with runs of 2.5 to 4.5 s."""
    spec = importlib.util.spec_from_file_location("endings", PATH)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "endings", module)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "MOMENTS_S", (2.5, 4.5))
    without_mosaic = {name: sink for name, sink in module.SINKS.items() if "stitch" not in name}
    monkeypatch.setattr(module, "SINKS", without_mosaic)
    return module


@pytest.mark.parametrize("seed", range(20))
def test_a_kill_at_a_random_moment_loses_two_seconds_at_most(endings: ModuleType, seed: int) -> None:
    """After SIGKILL each output can be read, up to the last two seconds."""
    endings.random.seed(seed)
    for name, loss in endings.by_signal(signal.SIGKILL, 1).items():
        assert seconds(loss) <= 2.0, name


def test_a_closed_terminal_loses_no_more_than_waits(endings: ModuleType) -> None:
    """After SIGHUP each output is complete, but for what a busy machine has in a queue, at most a second."""
    for name, loss in endings.by_signal(signal.SIGHUP, 1).items():
        assert seconds(loss) <= 1.0, name


def seconds(loss: str) -> float:
    """The length of a loss in s; infinite where everything is lost."""
    if loss == "nothing":
        return 0.0
    return math.inf if loss.startswith("everything") else float(loss.removesuffix(" s"))
