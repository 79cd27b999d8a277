"""What one browser costs a live pipeline: 1080p25 over RTSP, followed, published, shown by `streamkit view`.

The pipeline of `streamkit view rtsp://...` plays alone for a while, then with a page in a headless chromium
without a GPU. For both times stand the age of the records at a subscriber (capture by RTCP) and the frames
without a record; for the page its frame rate, and the processor time by process, in the browser by thread; at
the end what was dropped where in the whole run, start and the browser's start included.

The browser has the rights of an ordinary user's: root's raises its threads above the pipeline's priority.

Run it:  python benchmarks/view_live.py [--seconds 60] [--video flight.mp4]
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import re
import signal
import statistics
import subprocess
import tempfile
import threading
import time
from collections import Counter
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import pipeline
from view_load import STREAMKIT, family, headless_browser

CAMERA = Path(__file__).parents[1] / "plugins" / "streamkit_view" / "pipelines" / "camera.pipe"
KEY = f"bench/view_live/{os.getpid()}"
SETTLE_S = 10.0  # first keyframes, first RTCP report
START_LIMIT_S = 300.0  # machine code may be compiled first
WINDOW = "--window-size=1280,800"
Times = Counter[tuple[str, str]]


class Records:
    """The records of the pipeline as they come, read in a thread."""

    def __init__(self, listener: subprocess.Popen[str]) -> None:
        self._rows: list[tuple[int, float | None]] = []
        self._listener = listener
        threading.Thread(target=self._read, name="records").start()

    def _read(self) -> None:
        assert self._listener.stdout is not None
        for line in self._listener.stdout:
            seq, age_ms, _ = json.loads(line)
            self._rows.append((seq, age_ms))

    def describe(self, first: int) -> str:
        """Ages and gaps from the record at an index on."""
        rows = self._rows[first:]
        ages = sorted(age for _, age in rows if age is not None)
        if len(ages) < 2:
            return f"{len(rows)} records, {len(ages)} with an age"
        span = rows[-1][0] - rows[0][0] + 1
        high = ages[min(len(ages) - 1, round(0.99 * len(ages)))]
        missing = f"{span - len(rows)} of {span} frames without a record"
        return f"age median {statistics.median(ages):.1f} ms, 99 % {high:.1f} ms; {missing}"

    @property
    def count(self) -> int:
        """How many have come."""
        return len(self._rows)


def give_up_priorities() -> None:
    """Processes started from now on cannot raise their priority, as those of users other than root."""
    pr_capbset_drop, cap_sys_nice = 24, 23
    ctypes.CDLL(None).prctl(pr_capbset_drop, cap_sys_nice, 0, 0, 0)


def kind_of(process: int) -> str:
    """What a process of chromium does; of another the name of its program."""
    command = Path(f"/proc/{process}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
    kinds = re.findall(r" --(?:type|utility-sub-type)=(\S+)", command)
    return kinds[-1] if kinds else Path(command.split(" ")[0]).name


def thread_times(root: int) -> Times:
    """Processor time so far by kind of process and name of thread, s."""
    found: Times = Counter()
    for process in family(root):
        for thread in Path(f"/proc/{process}/task").iterdir():
            with suppress(OSError):  # it may end meanwhile
                name, _, rest = (thread / "stat").read_text().partition("(")[2].rpartition(")")
                ticks = sum(int(field) for field in rest.split()[11:13])
                found[kind_of(process), name.rstrip("0123456789/")] += ticks / os.sysconf("SC_CLK_TCK")
    return found


def describe_times(spent: Times, seconds: float, frames: float) -> str:
    """Share of a core, and ms per frame shown: in all, by process, and of the busiest threads."""
    processes: Counter[str] = Counter()
    for (kind, _), used in spent.items():
        processes[kind] += used
    whole = sum(spent.values())
    by_process = [f"{kind} {1e3 * used / frames:.1f}" for kind, used in processes.most_common(4)]
    by_thread = [f"{kind}/{name} {1e3 * used / frames:.1f}" for (kind, name), used in spent.most_common(8)]
    return (
        f"{100 * whole / seconds:5.1f} % of a core, {1e3 * whole / frames:5.1f} ms a frame: "
        f"{', '.join(by_process)}; threads: {', '.join(by_thread)}"
    )


def watch(records: Records, publisher: int, seconds: float) -> None:
    """Shows the pipeline in a browser, and prints what that costs."""
    shown = [STREAMKIT, "view", KEY, "--listen", "127.0.0.1:0"]
    with (
        subprocess.Popen(shown, stdout=subprocess.PIPE, text=True) as view,
        headless_browser(WINDOW) as browser,
    ):
        assert view.stdout is not None
        browser.get(view.stdout.readline().split()[1])
        time.sleep(SETTLE_S)
        roots = {"pipeline": publisher, "view": view.pid, "browser": browser.service.process.pid}
        first, began_s, before = (
            records.count,
            time.monotonic(),
            {at: thread_times(pid) for at, pid in roots.items()},
        )
        rates = []
        while (took_s := time.monotonic() - began_s) < seconds:
            time.sleep(1.0)
            rates.append(browser.execute_script("return streamkit.page.rate"))
        frames = statistics.mean(rates) * took_s
        spent = {at: thread_times(pid) - before[at] for at, pid in roots.items()}
        print(f"with a page:     {records.describe(first)}")
        skipped = browser.execute_script("return streamkit.page.skipped")
        delay_ms = browser.execute_script("return streamkit.medianDelay()")
        rate = f"{frames / took_s:.1f} frames/s, {skipped} skipped in all"
        print(f"page:            {rate}; record published to frame shown median {delay_ms:.1f} ms")
        for at, times in spent.items():
            print(f"{at + ':':<16} {describe_times(times, took_s, max(frames, 1))}", flush=True)
        view.terminate()


def main(video: Path | None, seconds: float) -> None:
    """Measures without and with a page."""
    give_up_priorities()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        made = pipeline.there_and_back(video, folder)
        server = stack.enter_context(pipeline.process(pipeline.__file__, "serve", str(made)))
        records = Records(stack.enter_context(pipeline.process(pipeline.__file__, "listen", KEY)))
        assert server.stdout is not None
        values = {"source": "rtspsrc location", "location": server.stdout.readline().strip(), "key": KEY}
        settings = [f"--set={name}={value}" for name, value in values.items()]
        launch = [STREAMKIT, "launch", "-e", "--stats=json", "-f", str(CAMERA), *settings]
        with subprocess.Popen(launch, stdout=subprocess.PIPE, text=True) as publisher:
            deadline_s = time.monotonic() + START_LIMIT_S
            while not records.count and publisher.poll() is None and time.monotonic() < deadline_s:
                time.sleep(0.2)
            time.sleep(SETTLE_S)
            first, before = records.count, thread_times(publisher.pid)
            time.sleep(seconds)
            spent = sum((thread_times(publisher.pid) - before).values())
            print(f"without a page:  {records.describe(first)}")
            print(f"pipeline alone:  {100 * spent / seconds:5.1f} % of a core", flush=True)
            watch(records, publisher.pid, seconds)
            publisher.send_signal(signal.SIGINT)
            run: dict[str, Any] = json.loads(publisher.communicate(timeout=30)[0])
    print(f"dropped in the whole run: {pipeline.drops(run)}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--video", type=Path)
    chosen = parser.parse_args()
    main(chosen.video, chosen.seconds)
