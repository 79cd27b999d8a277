"""Runs the whole protocol: four partitions, each a task, on several processes."""

import os
import signal
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from streamkit.handoff.library_threads import ONE_THREAD
from streamkit_wavelet_eigen.experiments import recognition
from streamkit_wavelet_eigen.experiments.peers import peer_rates
from streamkit_wavelet_eigen.experiments.recognition import BEST, METHODS, MODULAR, PROPOSED, TRADITIONAL
from streamkit_wavelet_eigen.experiments.results import SCHEMA, PartitionResult, Results
from streamkit_wavelet_eigen.experiments.splits import PARTITIONS, read_coil20, read_orl, splits
from streamkit_wavelet_eigen.experiments.tracking import Follow, by_runs, tracking_errors

READING_A_METHODS = (PROPOSED, TRADITIONAL, MODULAR, BEST)


def run_partition(
    key: str, folder: Path, repetitions: int, tracking_runs: int, follow: Follow
) -> PartitionResult:
    """Measures one partition; see `run_all`.

    Raises:
        MissingData: the databases are incomplete.
        ImportError: a peer is not installed.
    """
    database, training = PARTITIONS[key]
    images = read_orl(folder) if database == "orl" else read_coil20(folder)
    parts = list(splits(images, training, repetitions))
    return {
        "training_pictures": len(parts[0].training.labels),
        "test_pictures": len(parts[0].test.labels),
        "recognition": {name: recognition.rates(recipe, parts) for name, recipe in METHODS.items()},
        "peers": peer_rates(parts),
        "selection": recognition.choose(parts, training),
        "reading_a": {name: recognition.reading_a(METHODS[name], parts) for name in READING_A_METHODS},
        "reading_b": recognition.reading_b(parts),
        "reading_c": recognition.reading_c(parts),
        "tracking": by_runs(tracking_errors(parts, follow, tracking_runs)),
    }


def run_all(
    folder: Path,
    follow: Follow,
    *,
    repetitions: int,
    tracking_runs: int,
    workers: int,
    report: Callable[[str], None],
) -> Results:
    """Measures all partitions; the results do not depend on the number of workers.

    Args:
        folder: holds the databases.
        follow: the tracker, a function that child processes can import.
        repetitions: random splits of each partition.
        tracking_runs: sequences for tables 2 and 4.
        workers: processes.
        report: called with the key of each finished partition.
    """
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    found: dict[str, PartitionResult] = {}
    # Ctrl-C ends the processes at once, too; else each would go on with the next partition.
    end_at_once = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    with ProcessPoolExecutor(workers, get_context("spawn"), end_at_once) as pool:
        tasks = {
            pool.submit(run_partition, key, folder, repetitions, tracking_runs, follow): key
            for key in PARTITIONS
        }
        try:
            for task in as_completed(tasks):
                found[tasks[task]] = task.result()
                report(tasks[task])
        finally:
            pool.shutdown(cancel_futures=True)
    return {
        "schema": SCHEMA,
        "repetitions": repetitions,
        "tracking_runs": tracking_runs,
        "partitions": {key: found[key] for key in PARTITIONS},
    }
