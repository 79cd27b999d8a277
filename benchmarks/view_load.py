"""What `streamkit view` costs: CPU of the server per viewer, and memory of one page in a browser.

A publisher sends coded video at 4 Mbit/s and 25 records a second. Viewers are websocket clients in a process
of their own that confirm each message, as the page does; the server's CPU time is read from /proc without and
with them. With --page a headless chromium shows the same feed, and its heap is read after collections.

Run it:  python benchmarks/view_load.py [--viewers 20] [--seconds 30] [--page]
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from websockets.asyncio.client import connect

from streamkit import Pipeline

KEY = f"bench/view/{os.getpid()}"
STREAMKIT = str(Path(sys.executable).with_name("streamkit"))
FLIGHT = (
    "videotestsrc num-buffers={frames} pattern=snow ! video/x-raw, width=320, height=240, framerate=25/1 "
    "! encode bitrate=4000 gop=25 ! packetsink location={path}"
)
PUBLISH = (
    "videotestsrc is-live=true ! video/x-raw, width=320, height=240, framerate=25/1 "
    "! zenohsink name=z key={key}  filesrc location={path} ! identity sync=true ! z.video"
)
READY_S = 5.0
SPARE_S = 60.0  # of video, for slow starts
LOOK_EVERY_S = 15.0


async def watch(url: str, origin: str, received: Any) -> None:
    """One viewer, until the process ends; adds the bytes that it receives."""
    taken = 0
    async with connect(url, origin=origin, compression=None, max_size=None) as page:  # type: ignore[arg-type]
        while True:
            message = await page.recv()
            received.value += len(message)
            taken += 1
            await page.send(json.dumps({"taken": taken}))


def view_many(url: str, origin: str, count: int, received: Any) -> None:
    """A process with many viewers; ended from outside."""

    async def run() -> None:
        await asyncio.gather(*(watch(url, origin, received) for _ in range(count)))

    asyncio.run(run())


def cpu_s(process: int) -> float:
    """CPU time of a process so far."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def share(process: int, seconds: float) -> float:
    """CPU time per second, of one core."""
    before, began = cpu_s(process), time.monotonic()
    time.sleep(seconds)
    return (cpu_s(process) - before) / (time.monotonic() - began)


@contextmanager
def served(seconds: float, folder: Path) -> Iterator[tuple[int, str]]:
    """A publisher and a server; gives the server's process and the address of its page."""
    path = folder / "video.mp4"
    Pipeline.parse(FLIGHT.format(frames=int(25 * seconds), path=path)).run(timeout_s=600)
    print(f"video of {path.stat().st_size * 8 / seconds / 1e6:.1f} Mbit/s")
    view = subprocess.Popen(
        [STREAMKIT, "view", KEY, "--listen", "127.0.0.1:0"], stdout=subprocess.PIPE, text=True
    )
    assert view.stdout is not None
    url = view.stdout.readline().split()[1]
    publisher = subprocess.Popen([STREAMKIT, "launch", "-q", PUBLISH.format(key=KEY, path=path)])
    try:
        time.sleep(READY_S)
        yield view.pid, url
    finally:
        for process in (view, publisher):
            process.terminate()
            process.wait(20)


def measure_viewers(server: int, url: str, count: int, seconds: float) -> None:
    """Prints the CPU time per viewer."""
    place = urlsplit(url).netloc
    spawning = multiprocessing.get_context("spawn")
    received = spawning.Value("q", 0)
    arguments = (f"ws://{place}/feed", f"http://{place}", count, received)
    viewers = spawning.Process(target=view_many, args=arguments)
    alone = share(server, seconds)
    viewers.start()
    while not received.value:
        time.sleep(0.1)
    time.sleep(READY_S)
    before = received.value
    together = share(server, seconds)
    rate = (received.value - before) * 8 / seconds / count / 1e6
    viewers.terminate()
    viewers.join(10)
    print(f"server: {100 * alone:.1f} % of a core without viewers, {100 * together:.1f} % with {count}")
    print(
        f"server: {100 * (together - alone) / count:.2f} % of a core per viewer, who gets {rate:.1f} Mbit/s"
    )


def measure_page(url: str, seconds: float) -> None:
    """Prints the page's heap over time."""
    from selenium import webdriver
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service

    options = Options()
    options.binary_location = shutil.which("chromium") or ""
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
        options.add_argument(argument)
    browser = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    try:
        browser.get(url)
        began = time.monotonic()
        while time.monotonic() - began < seconds:
            time.sleep(LOOK_EVERY_S)
            browser.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
            used = browser.execute_cdp_cmd("Runtime.getHeapUsage", {})["usedSize"]
            rate, skipped = browser.execute_script("return [streamkit.page.rate, streamkit.page.skipped]")
            past_s = time.monotonic() - began
            print(f"page: {past_s:4.0f} s  heap {used / 1e6:.2f} MB  {rate:.1f} frames/s  {skipped} skipped")
    finally:
        browser.quit()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--viewers", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--page", action="store_true")
    chosen = parser.parse_args()
    length_s = chosen.seconds * (1 if chosen.page else 2) + SPARE_S
    with tempfile.TemporaryDirectory() as name, served(length_s, Path(name)) as (pid, address):
        if chosen.page:
            measure_page(address, chosen.seconds)
        else:
            measure_viewers(pid, address, chosen.viewers, chosen.seconds)
