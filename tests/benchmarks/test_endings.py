"""Outputs of a run that is killed or stopped can be read, but for the last seconds."""

import importlib.util
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


@pytest.mark.parametrize("seed", range(2))
def test_a_kill_at_a_random_moment_loses_two_seconds_at_most(endings: ModuleType, seed: int) -> None:
    """After SIGKILL each output can be read, up to the last two seconds."""
    endings.random.seed(seed)
    for name, loss in endings.by_signal(signal.SIGKILL, 1).items():
        assert endings.lost_seconds(loss) <= 2.0, name


def test_a_closed_terminal_loses_nothing(endings: ModuleType) -> None:
    """After SIGHUP with -e each output has every frame that the source has given."""
    assert set(endings.by_signal(signal.SIGHUP, 1, "-e").values()) == {"nothing"}
