"""A drone whose server goes away again and again: the pipeline goes on, nothing leaks, tracks come."""

from __future__ import annotations

import gc
import importlib.util
import os
import sys
import threading
import time
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import pytest

from streamkit import Frame, FrameFlags, Pipeline, Tracks
from tests.slowness import patience

RESTARTS = 20
TRACKING = "stitch ! framediff ! waveleteigen ! particletrack seed=0"


@pytest.fixture(scope="module")
def fake() -> ModuleType:
    """The decoder tests' own RTSP server."""
    folder = Path(__file__).parents[1] / "plugins" / "streamkit_media" / "rtsp"
    name = "streamkit_media_fake_server"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, folder / "fake_server.py")
        assert spec is not None
        assert spec.loader is not None
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


def resident_mb() -> float:
    """Memory of this process."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def descriptors() -> int:
    """Open files of this process."""
    return len(os.listdir("/proc/self/fd"))


def test_a_server_restarted_twenty_times(fake: ModuleType) -> None:
    """20 restarts are 20 epochs; the pipeline never ends, times ascend, and tracks come after the last."""
    server = fake.FakeServer(fake.access_units((160, 120), count=30))
    server.open()
    source = f"rtspsrc name=r location={server.url} timeout-s=2 retry-delay-s=0.05 max-retry-delay-s=0.1"
    text = f"{source} ! decode ! {TRACKING} ! appsink name=out max-buffers=0"
    seen: list[Frame] = []
    figures: list[tuple[float, int, int]] = []
    try:
        with Pipeline.parse(text) as pipeline:
            pipeline.play()
            for restart in range(RESTARTS + 1):
                frame = pipeline["out"].pull(20)
                while frame.epoch < restart or len([f for f in seen if f.epoch == restart]) < 2:
                    seen.append(frame)
                    frame = pipeline["out"].pull(20)
                seen.append(frame)
                gc.collect()
                figures.append((resident_mb(), descriptors(), threading.active_count()))
                if restart < RESTARTS:
                    server.close()
                    server.open()
            assert pipeline.error is None
            assert not pipeline.ended.is_set()
    finally:
        server.close()
    assert sorted({frame.epoch for frame in seen}) == list(range(RESTARTS + 1))
    assert all(a.pts < b.pts for a, b in pairwise(seen))
    assert all(b.flags & FrameFlags.DISCONTINUITY for a, b in pairwise(seen) if a.epoch != b.epoch)
    assert all(frame.get(Tracks) is not None for frame in seen)
    memory, files, threads = zip(*figures[5:], strict=True)
    assert max(memory) - memory[0] < 30
    assert max(files) <= files[0] + 4
    assert max(threads) <= threads[0] + 2


def test_a_silent_server_does_not_hold_up_the_stop(fake: ModuleType) -> None:
    """A pipeline that is connecting for a minute stops at once, and leaves no thread."""
    with fake.FakeServer(fake.access_units(count=2), fake.Behaviour.DESCRIBE_ONLY) as server:
        before = threading.active_count()
        with Pipeline.parse(f"rtspsrc location={server.url} timeout-s=60 ! decode ! fakesink") as pipeline:
            pipeline.play()
            pipeline.ended.wait(0.5)
            began = time.monotonic()
        assert time.monotonic() - began < patience(2)
        assert threading.active_count() <= before + 1  # the server's own client thread may still be there
