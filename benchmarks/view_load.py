"""What `streamkit view` costs: CPU of the server per viewer, memory of a page in a browser, bytes by message.

A publisher sends coded video at 4 Mbit/s and 25 records a second. Viewers are websocket clients in a process
of their own that confirm each message, as the page does; the server's CPU time is read from /proc without and
with them. With --page a headless chromium shows a rendered flight with tracks and mosaic, or a camera; its
heap is read after collections, and the memory of all its processes and of the server from /proc; at the end
stands what was dropped where. With --bytes a websocket client counts what a page is sent of a video file,
from the first record to the end, by the kind of message.

Run it:  python benchmarks/view_load.py [--viewers 20] [--seconds 30]
         python benchmarks/view_load.py --page [rtsp://drone/live] --seconds 1200
         python benchmarks/view_load.py --bytes flight.mp4
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import json
import multiprocessing
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from websockets.asyncio.client import connect
from websockets.sync.client import connect as connect_waiting

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
FLY = (
    "dronetestsrc num-buffers=-1 ! video/x-raw, format=I420, width=640, height=360, framerate=12/1 "
    "! identity sync=true ! tee name=flight  flight. ! queue ! encode gop=24 live=true ! z.video "
    "flight. ! queue ! stitch name=ground ! framediff ! waveleteigen ! particletrack "
    "! zenohsink name=z key={key} frame-rate=2 provenance=true  ground.mosaic ! queue ! z.mosaic"
)
READY_S = 5.0
SPARE_S = 60.0  # of video, for slow starts
POLL_S = 15.0


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
def served(shown: str, *publisher: str) -> Iterator[tuple[int, str]]:
    """A server, and a publisher's process if need be; gives the server's process and address of its page."""
    view = subprocess.Popen(
        [STREAMKIT, "view", shown, "--listen", "127.0.0.1:0"], stdout=subprocess.PIPE, text=True
    )
    publishers = [subprocess.Popen([STREAMKIT, "launch", "-q", text], text=True) for text in publisher]
    try:
        assert view.stdout is not None
        yield view.pid, view.stdout.readline().split()[1]
    finally:
        for process in (view, *publishers):
            process.terminate()
            process.wait(20)


def coded_video(seconds: float, folder: Path) -> Path:
    """A video file at 4 Mbit/s."""
    path = folder / "video.mp4"
    Pipeline.parse(FLIGHT.format(frames=int(25 * seconds), path=path)).run(timeout_s=600)
    print(f"video of {path.stat().st_size * 8 / seconds / 1e6:.1f} Mbit/s")
    return path


def measure_viewers(server: int, url: str, count: int, seconds: float) -> None:
    """Prints the CPU time per viewer."""
    place = urlsplit(url).netloc
    spawning = multiprocessing.get_context("spawn")
    received = spawning.Value("q", 0)
    arguments = (f"ws://{place}/feed", f"http://{place}", count, received)
    time.sleep(READY_S)
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


def memory_mb(process: int) -> float:
    """Memory of a process, its share of what it has in common with others."""
    for line in Path(f"/proc/{process}/smaps_rollup").read_text().splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) / 1e3
    return 0.0


def family(process: int) -> list[int]:
    """A process and all that it has started."""
    threads = Path(f"/proc/{process}/task").glob("*/children")
    children = [int(word) for thread in threads for word in thread.read_text().split()]
    return [process, *itertools.chain.from_iterable(map(family, children))]


def message_head(data: str | bytes) -> dict[str, Any]:
    """A message to a page, without the payload of a binary one, which follows its head."""
    if isinstance(data, bytes):
        data = data[4 : 4 + int.from_bytes(data[:4], "little")]
    found: dict[str, Any] = json.loads(data)
    return found


@contextmanager
def headless_browser(*arguments: str) -> Iterator[Any]:
    """Debian's chromium without a window and without a GPU."""
    from selenium import webdriver
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service

    options = Options()
    options.binary_location = shutil.which("chromium") or ""
    for argument in (
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-dev-shm-usage",
        *arguments,
    ):
        options.add_argument(argument)
    browser = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    try:
        yield browser
    finally:
        browser.quit()


def measure_page(server: int, url: str, seconds: float) -> None:
    """Prints the memory of the page and of the server over time, and what grows per hour."""
    rows = []
    with headless_browser() as browser:
        browser.get(url)
        began = time.monotonic()
        while time.monotonic() - began < seconds:
            time.sleep(POLL_S)
            browser.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
            used = browser.execute_cdp_cmd("Runtime.getHeapUsage", {})["usedSize"] / 1e6
            nodes = browser.execute_cdp_cmd("Memory.getDOMCounters", {})["nodes"]
            rate, skipped, tiles = browser.execute_script(
                "const { page, mosaic } = streamkit;"
                "return [page.rate, page.skipped, mosaic.shown?.taken.size ?? 0]"
            )
            whole = sum(map(memory_mb, family(browser.service.process.pid)))
            rows.append((time.monotonic() - began, used, nodes, whole, memory_mb(server)))
            print(
                "{:5.0f} s  heap {:.2f} MB  {} nodes  browser {:.0f} MB  server {:.0f} MB".format(*rows[-1]),
                f" {tiles} tiles  {rate:.1f} frames/s  {skipped} skipped",
                flush=True,
            )
        status = browser.execute_script("return streamkit.page.states[0].status") or {}
        of_elements = [{one["name"]: one["drops"]} for one in status.get("elements", ()) if one["drops"]]
        print("dropped:", [*status.get("drops", ()), *of_elements])
    table = np.array(rows)[len(rows) // 4 :]
    for name, column in (("heap", 1), ("browser", 3), ("server", 4)):
        slope = np.polyfit(table[:, 0], table[:, column], 1)[0]
        print(f"{name}: {3600 * slope:+.2f} MB an hour, without the first quarter")


def measure_bytes(url: str) -> None:
    """Prints what a page is sent, from the first record to the end of the stream."""
    place = urlsplit(url).netloc
    sent: Counter[str] = Counter()
    began_s, state = None, ""
    with connect_waiting(
        f"ws://{place}/feed",
        origin=f"http://{place}",
        compression=None,
        max_size=None,  # type: ignore[arg-type]
    ) as page:
        page.send(json.dumps({"stills": False}))  # as a page that decodes the video
        for taken in itertools.count(1):
            data = page.recv(60)
            page.send(json.dumps({"taken": taken}))
            message = message_head(data)
            sent[message["type"]] += len(data)
            if message["type"] == "tracks":
                began_s = began_s or time.monotonic()
            if message["type"] == "state" and (state := message["body"]["state"]) in ("ended", "lost"):
                break
    seconds = time.monotonic() - (began_s or time.monotonic())
    print(f"{state} after {seconds:.1f} s")
    for kind, size in sent.most_common():
        print(f"  {kind:8} {size / 1e3:8.1f} kB  {size / 1e3 / max(seconds, 1):6.1f} kB/s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--viewers", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--page", nargs="?", const="", metavar="URL")
    parser.add_argument("--bytes", metavar="FILE")
    chosen = parser.parse_args()
    if chosen.bytes:
        with served(chosen.bytes) as (_, address):
            measure_bytes(address)
    elif chosen.page is not None:
        with served(*((chosen.page,) if chosen.page else (KEY, FLY.format(key=KEY)))) as (pid, address):
            measure_page(pid, address, chosen.seconds)
    else:
        with tempfile.TemporaryDirectory() as name:
            path = coded_video(2 * chosen.seconds + SPARE_S, Path(name))
            with served(KEY, PUBLISH.format(key=KEY, path=path)) as (pid, address):
                measure_viewers(pid, address, chosen.viewers, chosen.seconds)
