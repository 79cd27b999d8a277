"""Feeds and archives on Ray, beside the same work in plain processes.

python benchmarks/fleet.py actors [--feeds 2]    frames a CPU second: actors, and as many `launch` processes
python benchmarks/fleet.py batch [--clips 40]    wall time: a batch on two cores, and two plain processes
python benchmarks/fleet.py kills [--kills 50]    a feed's process killed: until it is ready again; memory
python benchmarks/fleet.py node                  a node of two killed under four feeds
python benchmarks/fleet.py scale [--feeds 40] [--sharing 1]    feeds of a frame a second: start to end
python benchmarks/fleet.py seams [--flights 3]   tracks of a file in parts, and of the same file whole
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
import ray
from msgspec import structs
from ray.cluster_utils import Cluster

from streamkit import Pipeline, RecordFile
from streamkit.geometry.boxes import box_iou
from streamkit_fleet import control
from streamkit_fleet.batch.driver import BatchDriver
from streamkit_fleet.batch.work import BatchRecipe, ClipPart, Plan, finish, keyframes_s, run_part, split
from streamkit_fleet.feeds import FeedSpec
from streamkit_fleet.local_ray import connected

ROOT = Path(__file__).parents[1]
SMALL = "videoscale ! video/x-raw, width=64, height=48"
WORK = f"videotestsrc pattern=ball ! video/x-raw, width=640, height=480 ! {SMALL} ! fakesink"
FAKE = "fakesrc is-live=true ! identity sleep-time=200000 ! fakesink name=${name}"
SLOW = FAKE.replace("200000", "1000000")  # a frame a second
COPY = f"filesrc location=${{input}} ! decode ! {SMALL} ! filesink location=${{output}}"
TRACK = (ROOT / "pipelines" / "file-to-tracks.pipe").read_text("utf-8")
WINDOW_S = 10.0
ROUNDS = 3
SEAM_FRAMES = 400
LIMIT_S = 300.0


def wait_until(is_so: Callable[[], bool]) -> float:
    """Waits; returns how long, s."""
    began_s = time.monotonic()
    while not is_so():
        if time.monotonic() - began_s > LIMIT_S:
            raise SystemExit(f"not so after {LIMIT_S:g} s: {control.statuses()}")
        time.sleep(0.02)
    return time.monotonic() - began_s


def all_ready(count: int, limit_s: float = 5.0) -> bool:
    """Whether so many feeds are ready."""
    return sum(status.ready for status in control.statuses(limit_s)) == count


def scrape(address: str) -> tuple[float, float]:
    """Frames at the sink and CPU seconds of a process."""
    with urllib.request.urlopen(f"http://{address}/metrics", timeout=30) as answer:
        text = answer.read().decode()
    frames = re.search(r'frames_total\{direction="in",element="fakesink0"\} (\S+)', text)
    cpu_s = re.search(r"^process_cpu_seconds_total (\S+)", text, re.MULTILINE)
    assert frames is not None
    assert cpu_s is not None
    return float(frames[1]), float(cpu_s[1])


def rate(addresses: list[str]) -> float:
    """Frames a CPU second, of all together, over the window."""
    before = [scrape(address) for address in addresses]
    time.sleep(WINDOW_S)
    after = [scrape(address) for address in addresses]
    frames, cpu_s = (sum(b[i] - a[i] for a, b in zip(before, after, strict=True)) for i in (0, 1))
    return frames / cpu_s


def compare_actors(feeds: int) -> None:
    """Both run at the same time, so that they share the load of the machine."""
    ports = range(9700, 9700 + feeds)
    addresses = [f"127.0.0.1:{port}" for port in ports]
    launch = [sys.executable, "-c", "from streamkit.cli.main import main; main()", "launch", "-q"]
    with connected(None, cores=feeds):
        control.apply({f"f{n}": FeedSpec(text=WORK, cores=1.0) for n in range(feeds)})
        wait_until(lambda: all_ready(feeds))
        actors = [status.metrics for status in control.statuses(10.0)]
        processes = [subprocess.Popen([*launch, "--metrics", address, WORK]) for address in addresses]
        try:
            time.sleep(5.0)
            found = [(rate(actors), rate(addresses)) for _ in range(ROUNDS)]
        finally:
            for process in processes:
                process.terminate()
                process.wait(30)
        control.stop(control.running())
    for actor, plain in found:
        print(f"actors {actor:8.1f}  launch {plain:8.1f} frames/CPU s  ratio {actor / plain:.3f}")
    print(f"median ratio {median(actor / plain for actor, plain in found):.3f}")


def compare_batch(clips: int) -> None:
    """A batch, and two processes with half of the files each, one after the other."""
    with tempfile.TemporaryDirectory() as name, connected(None, cores=2):
        folder = Path(name)
        clip = folder / "clip.mp4"
        text = "videotestsrc num-buffers=1000 ! video/x-raw, width=640, height=480 ! encode"
        Pipeline.parse(f"{text} ! packetsink location={clip}").run()
        paths = [str(shutil.copy(clip, folder / f"{n}.mp4")) for n in range(clips)]
        recipe = BatchRecipe(COPY, {}, ".gray", 0.0, 0.0)
        loop = "import sys; from streamkit import Pipeline\nfor p in sys.argv[2:]:\n"
        loop += "    Pipeline.parse(sys.argv[1], {'input': p, 'output': p + '.peer'}).run()"
        for number in range(ROUNDS):
            began_s = time.monotonic()
            halves = [
                subprocess.Popen([sys.executable, "-c", loop, COPY, *paths[start::2]]) for start in (0, 1)
            ]
            for half in halves:
                assert half.wait() == 0
            plain_s = time.monotonic() - began_s
            out = folder / f"out{number}"
            out.mkdir()
            began_s = time.monotonic()
            driver = BatchDriver(
                {path: f"{Path(path).name}.gray" for path in paths}, recipe, out,
                retries=3, retry_failed=False, report=lambda *_: None, count_parts=lambda *_: None,
            )  # fmt: skip
            driver.run()
            batch_s = time.monotonic() - began_s
            same = all(
                (out / f"{Path(path).name}.gray").read_bytes() == Path(f"{path}.peer").read_bytes()
                for path in paths
            )
            shutil.rmtree(out)
            print(f"batch {batch_s:.1f} s, plain {plain_s:.1f} s: {plain_s / batch_s:.2f}, equal: {same}")


def kill_often(kills: int) -> None:
    """SIGKILL again and again; each time until the feed is ready in a new process."""
    with connected(None, cores=1):
        control.apply({"f": FeedSpec(text=FAKE, set={"name": "out"}, cores=0.1)})
        wait_until(lambda: all_ready(1))
        took_s, memory_mb = [], []
        for _ in range(kills):
            (status,) = control.statuses(10.0)
            os.kill(status.pid, signal.SIGKILL)
            took_s.append(
                wait_until(
                    lambda old=status.pid: any(s.ready and s.pid != old for s in control.statuses(0.5))
                )
            )
            node = ray._private.worker._global_node
            assert node is not None, "connected"
            raylet = node.all_processes["raylet"][0].process.pid
            pages = int(Path(f"/proc/{raylet}/statm").read_text().split()[1])
            memory_mb.append(pages * os.sysconf("SC_PAGE_SIZE") / 1e6)
        control.stop(control.running())
    print(f"{kills} kills: ready again after {median(took_s):.2f} s (median), {max(took_s):.2f} s (most)")
    print(f"raylet: {memory_mb[0]:.0f} MB after the first, {memory_mb[-1]:.0f} MB after the last")


def kill_node() -> None:
    """Four feeds on two nodes; the node that holds two dies, and another has room."""
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 2, "include_dashboard": False})
    try:
        second = cluster.add_node(num_cpus=2, resources={"far": 1})
        with connected(cluster.address):
            feed = FeedSpec(text=FAKE, set={"name": "out"}, cores=0.4)
            far = structs.replace(feed, tags=["far"])
            control.apply({"f0": feed, "f1": feed, "f2": far, "f3": far})
            wait_until(lambda: all_ready(4))
            cluster.add_node(num_cpus=2, resources={"far": 1})
            lost = [status.name for status in control.statuses(10.0) if status.node == second.node_id]
            began_s = time.monotonic()
            cluster.remove_node(second, allow_graceful=False)
            wait_until(lambda: not any(n["Alive"] for n in ray.nodes() if n["NodeID"] == second.node_id))
            noticed_s = time.monotonic() - began_s
            wait_until(lambda: all_ready(4, 0.5))
            after_s = time.monotonic() - began_s - noticed_s
            print(f"{lost}: noticed after {noticed_s:.2f} s, all ready {after_s:.2f} s later")
            control.stop(control.running())
    finally:
        cluster.shutdown()


def scale(feeds: int, sharing: int) -> None:
    """Fake feeds of a frame per second, so many in each process; those of every second process change."""
    with connected(None, cores=2):
        fake = FeedSpec(text=SLOW, set={"name": "a"}, cores=0.001, metrics="")
        table = {f"f{n}": structs.replace(fake, process=f"p{n // sharing}") for n in range(feeds)}
        began_s = time.monotonic()
        control.apply(table)
        wait_all_ready(feeds)
        print(f"{feeds} feeds, {sharing} in a process: ready after {time.monotonic() - began_s:.1f} s")
        print(f"memory of the processes: {proportional_mb({s.pid for s in control.statuses()}):.0f} MB")
        began_s = time.monotonic()
        answered = sum(status.ready for status in control.statuses())
        print(f"status: {time.monotonic() - began_s:.2f} s, {answered} ready")
        changed = {
            name: structs.replace(feed, set={"name": "b"})
            for number, (name, feed) in enumerate(table.items())
            if number // sharing % 2 == 0
        }
        before = {status.name: status.pid for status in control.statuses()}
        began_s = time.monotonic()
        control.apply(table | changed)
        wait_all_ready(feeds)
        took_s = time.monotonic() - began_s
        new = {status.name for status in control.statuses() if status.pid != before[status.name]}
        print(f"apply: {len(new)} replaced in {took_s:.1f} s, only those changed: {new == changed.keys()}")
        began_s = time.monotonic()
        control.stop(control.running())
        wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in before.values()))
        print(f"end: {time.monotonic() - began_s:.1f} s, {len(control.running())} left")


def wait_all_ready(count: int) -> None:
    """As `fleet up` waits."""
    late = control.wait_ready(LIMIT_S)
    if late or not all_ready(count):
        raise SystemExit(f"{len(late)} feeds are not ready after {LIMIT_S:g} s: {late[:3]}")


def proportional_mb(pids: set[int]) -> float:
    """Memory of processes, of shared pages their part, MB."""
    texts = (Path(f"/proc/{pid}/smaps_rollup").read_text() for pid in pids)
    return sum(int(re.findall(r"^Pss:\s+(\d+)", text, re.MULTILINE)[0]) for text in texts) / 1e3


def compare_seams(flights: int) -> None:
    """Ids of the joined parts against those of one run, on both sides of each seam."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for seed in range(1, flights + 1):
            clip = folder / f"{seed}.mp4"
            source = f"dronetestsrc num-buffers={SEAM_FRAMES} seed={seed}"
            Pipeline.parse(f"{source} ! encode gop=25 ! packetsink location={clip}").run()
            recipe = BatchRecipe(TRACK, {}, ".jsonl", 7.0, 4.0)
            parts = split(keyframes_s(str(clip)), SEAM_FRAMES / 25, recipe.part_s, recipe.overlap_s)
            whole = Plan(str(clip), f"whole{seed}", 0.0, (ClipPart(),))
            pieces = Plan(str(clip), f"parts{seed}", 0.0, parts)
            for plan in (whole, pieces):
                outcomes = [run_part(plan, n, recipe, name) for n in range(len(plan.parts))]
                assert not any(one.reason for one in outcomes), outcomes
                assert not finish(outcomes, str(folder / f"{plan.key}.jsonl"))
            print(f"seed {seed}, {len(parts)} parts: {_agreement(folder, seed, parts)}")


def _agreement(folder: Path, seed: int, parts: tuple[ClipPart, ...]) -> str:
    """Targets seen on both sides of a seam in one run: how many keep their id in the joined records."""
    tables = []
    for kind in ("whole", "parts"):
        records = RecordFile(folder / f"{kind}{seed}.jsonl")
        boxes = {one.pts_ns: {t.id: t.bbox for t in one.tracks} for _, one in records}
        tables.append(boxes)
    kept = seen = 0
    for before in parts[:-1]:  # the seam is the end of the earlier part
        times = sorted(tables[0])
        first = next(i for i, pts in enumerate(times) if (pts or 0) >= (before.end_s or 0) * 1e9)
        sides = [_same(tables[0][times[i]], tables[1].get(times[i], {})) for i in (first - 1, first + 25)]
        both = sides[0].keys() & sides[1].keys()
        seen += len(both)
        kept += sum(sides[0][key] == sides[1][key] for key in both)
    frames = f"{len(tables[1])} of {len(tables[0])} frames"
    return f"{kept} of {seen} targets keep their id across a seam; {frames}"


def _same(one: dict[int, tuple[float, ...]], other: dict[int, tuple[float, ...]]) -> dict[int, int]:
    """Ids of the second by those of the first, where the boxes overlap by half."""
    if not one or not other:
        return {}
    shares = box_iou(np.array(list(one.values())), np.array(list(other.values())))
    return {
        key: list(other)[int(row.argmax())] for key, row in zip(one, shares, strict=True) if row.max() >= 0.5
    }


def main() -> None:
    """Runs one of the comparisons."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("actors", "batch", "kills", "node", "scale", "seams"))
    parser.add_argument("--feeds", type=int, default=0)
    parser.add_argument("--sharing", type=int, default=1)
    parser.add_argument("--clips", type=int, default=40)
    parser.add_argument("--flights", type=int, default=3)
    parser.add_argument("--kills", type=int, default=50)
    options = parser.parse_args()
    runs: dict[str, Callable[[], None]] = {
        "actors": lambda: compare_actors(options.feeds or 2),
        "batch": lambda: compare_batch(options.clips),
        "kills": lambda: kill_often(options.kills),
        "node": kill_node,
        "scale": lambda: scale(options.feeds or 40, options.sharing),
        "seams": lambda: compare_seams(options.flights),
    }
    # As `fleet up` sets it; else processes beside it go first.
    os.environ.setdefault("RAY_worker_niceness", "0")
    runs[options.what]()


if __name__ == "__main__":
    main()
