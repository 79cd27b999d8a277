"""Hands the files of an archive to Ray's workers, and keeps the summary."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

import msgspec
import ray
from ray.exceptions import RayError

from streamkit.masking import mask_secrets, presentable
from streamkit.output.file import write_whole
from streamkit_fleet.batch.plan import BatchRecipe, Plan, plan_file
from streamkit_fleet.batch.work import PARTS, Outcome, finish, run_part
from streamkit_fleet.cluster import cluster_cores

SUMMARY = "batch.json"
AHEAD = 3  # tasks submitted for each core: workers never wait, and a long archive is no long queue
SAVE_EVERY_S = 1.0
POLL_S = 0.2


class FileResult(msgspec.Struct, kw_only=True, omit_defaults=True):
    """What has become of a file: an entry of the summary.

    Attributes:
        key: hash of the file's content and of what was done with it.
        status: done or failed.
        reason: of the failure.
        result: path in the output folder.
        parts: number of parts it was split into.
        duration_s: of the video, s.
        cpu_s: spent in this batch, s.
    """

    key: str
    status: Literal["done", "failed"]
    reason: str = ""
    result: str = ""
    parts: int = 1
    duration_s: float = 0.0
    cpu_s: float = 0.0


class BatchSummary(msgspec.Struct, kw_only=True):
    """The summary of a batch: `batch.json`; `files` are by path."""

    schema: Literal["streamkit.batch/1"] = "streamkit.batch/1"
    files: dict[str, FileResult]


def read_summary(folder: Path) -> BatchSummary:
    """The summary of earlier batches; empty if there is none, or one that cannot be read."""
    try:
        return msgspec.json.decode((folder / SUMMARY).read_bytes(), type=BatchSummary)
    except (OSError, msgspec.DecodeError):
        return BatchSummary(files={})


@dataclass
class Job:
    """A file at work."""

    plan: Plan
    outcomes: list[Outcome | None] = field(default_factory=list)

    @property
    def reason(self) -> str:
        """Why a part has failed, or ""."""
        return next((one.reason for one in self.outcomes if one is not None and one.reason), "")


class BatchDriver:
    """Runs the files of an archive; those that an earlier batch has done or given up are left out.

    Args:
        files: result in the output folder by path of the input.
        recipe: what is done with each.
        folder: for results, unfinished parts and the summary.
        retries: how often a part is run again whose worker has died.
        retry_failed: whether files that failed in an earlier batch are tried again.
        report: called when a file is done, failed or left out.
    """

    def __init__(
        self,
        files: Mapping[str, str],
        recipe: BatchRecipe,
        folder: Path,
        *,
        retries: int,
        retry_failed: bool,
        report: Callable[[str, FileResult, bool], None],
    ) -> None:
        self._files, self._recipe, self._folder = files, recipe, folder
        self._retry_failed, self._report = retry_failed, report
        self.summary = read_summary(folder)
        self._waiting = list(files)[::-1]
        self._handlers: dict[Any, Callable[[Any, str], None]] = {}
        self._saved_s = 0.0
        self._limit = AHEAD * max(1, int(cluster_cores()))
        task: Any = ray.remote(num_cpus=1, max_retries=retries)
        self._plan_task, self._part_task, self._finish_task = task(plan_file), task(run_part), task(finish)
        self._parts_waiting: list[Callable[[], None]] = []

    def run(self) -> None:
        """Works until every file is done, failed or left out."""
        try:
            while self._handlers or self._waiting or self._parts_waiting:
                self._submit()
                ready, _ = ray.wait(list(self._handlers), timeout=POLL_S)
                for ref in ready:
                    handler = self._handlers.pop(ref)
                    try:
                        value, reason = ray.get(ref), ""
                    except RayError as error:
                        value, reason = None, _reason(error)
                    handler(value, reason)
        finally:
            self._save()
            with suppress(OSError):  # parts of failed files stay for the next batch
                (self._folder / PARTS).rmdir()

    def _submit(self) -> None:
        """Keeps the workers supplied: parts of files begun first, then the next files."""
        while len(self._handlers) < self._limit:
            if self._parts_waiting:
                self._parts_waiting.pop(0)()
            elif self._waiting:
                path = self._waiting.pop()
                ref = self._plan_task.remote(path, self._recipe)
                self._handlers[ref] = partial(self._planned, path)
            else:
                return

    def _planned(self, path: str, plan: Plan | None, reason: str) -> None:
        if plan is None:
            self._end(path, FileResult(key="", status="failed", reason=reason))
            return
        known = self.summary.files.get(path)
        if known is not None and known.key == plan.key:
            has_failed = known.status == "failed"
            if not self._retry_failed if has_failed else (self._folder / known.result).exists():
                self._report(path, known, True)
                return
        job = Job(plan, [None] * len(plan.parts))
        self._parts_waiting += [partial(self._start_part, job, number) for number in range(len(plan.parts))]

    def _start_part(self, job: Job, number: int) -> None:
        ref = self._part_task.remote(job.plan, number, self._recipe, str(self._folder))
        self._handlers[ref] = partial(self._part_ended, job, number)

    def _part_ended(self, job: Job, number: int, outcome: Outcome | None, reason: str) -> None:
        job.outcomes[number] = outcome or Outcome("", reason)
        if None in job.outcomes:
            return
        if job.reason:
            self._end_job(job, job.reason)
            return
        result = str(self._folder / self._files[job.plan.path])
        ref = self._finish_task.remote(job.outcomes, result)
        self._handlers[ref] = lambda failure, reason: self._end_job(job, reason or failure)

    def _end_job(self, job: Job, reason: str) -> None:
        plan = job.plan
        self._end(
            plan.path,
            FileResult(
                key=plan.key,
                status="failed" if reason else "done",
                reason=presentable(mask_secrets(reason)),
                result="" if reason else self._files[plan.path],
                parts=len(plan.parts),
                duration_s=round(plan.duration_s, 3),
                cpu_s=round(sum(one.cpu_s for one in job.outcomes if one is not None), 3),
            ),
        )

    def _end(self, path: str, result: FileResult) -> None:
        self.summary.files[path] = result
        if time.monotonic() - self._saved_s > SAVE_EVERY_S:
            self._save()
        self._report(path, result, False)

    def _save(self) -> None:
        """Writes the summary in place of the one before."""
        self._saved_s = time.monotonic()
        text = msgspec.json.format(msgspec.json.encode(self.summary), indent=1) + b"\n"
        write_whole(self._folder / SUMMARY, text)


def _reason(error: RayError) -> str:
    """The cause of a task's failure, in one line."""
    cause = getattr(error, "cause", None) or error
    lines = str(cause).strip().splitlines() or [type(cause).__name__]
    return f"{type(cause).__name__}: {lines[0]}"
