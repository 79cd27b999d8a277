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
    """The benchmark, with short runs."""
    spec = importlib.util.spec_from_file_location("endings", PATH)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "endings", module)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module.random, "uniform", lambda *_: 2.5)
    without_mosaic = {name: sink for name, sink in module.SINKS.items() if "stitch" not in name}
    monkeypatch.setattr(module, "SINKS", without_mosaic)
    return module


@pytest.mark.parametrize(("number", "most_s"), [(signal.SIGKILL, 2.0), (signal.SIGHUP, 0.0)])
def test_what_is_left(endings: ModuleType, number: signal.Signals, most_s: float) -> None:
    """After a kill all but two seconds, after a closed terminal everything."""
    for name, loss in endings.by_signal(number, 1).items():
        assert loss == "nothing" or float(loss.removesuffix(" s")) <= most_s, name
