"""Hands the files of an archive to Ray's workers, and keeps the summary."""

from __future__ import annotations

import asyncio
import os
import shutil
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

import msgspec
import ray
from ray.exceptions import RayError

from streamkit.masking import mask_secrets, presentable
from streamkit.output.file import write_whole
from streamkit_fleet.batch.work import (
    PARTS,
    UNFINISHED,
    BatchRecipe,
    Outcome,
    Plan,
    finish,
    plan_file,
    run_part,
)
from streamkit_fleet.local_ray import cluster_cores

SUMMARY = "batch.json"
AHEAD = 3  # files at work for each core: workers never wait, and a long archive is no long queue
SAVE_EVERY_S = 1.0


class FileResult(msgspec.Struct, kw_only=True, omit_defaults=True):
    """What has become of a file: an entry of the summary.

    Attributes:
        key: hash of the file's content and of what was done with it.
        status: done or failed.
        reason: of the failure.
        shortfalls: warnings that something is missing, such as the end of a file that is cut short.
        result: path in the output folder.
        parts: number of parts it was split into.
        duration_s: of the video, s.
        cpu_s: spent in this batch, s.
    """

    key: str
    status: Literal["done", "failed"]
    reason: str = ""
    shortfalls: list[str] = msgspec.field(default_factory=list)
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


class BatchDriver:
    """Runs the files of an archive; those that an earlier batch has done or given up are left out.

    Args:
        files: result in the output folder by path of the input.
        recipe: what is done with each.
        folder: for results, unfinished parts and the summary.
        retries: how often a part is run again whose worker has died.
        retry_failed: whether files that failed in an earlier batch are tried again.
        report: called with path, result and whether an earlier batch has made it.
        count_parts: called with the numbers of further parts to do, and done.
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
        count_parts: Callable[[int, int], None],
    ) -> None:
        self._files, self._recipe, self._folder = files, recipe, folder
        self._retry_failed, self._report, self._count_parts = retry_failed, report, count_parts
        self.summary = read_summary(folder)
        self._waiting = iter(files)
        self._saved_s = 0.0
        task: Any = ray.remote(num_cpus=1, max_retries=retries)
        self._plan_task, self._part_task, self._finish_task = task(plan_file), task(run_part), task(finish)

    def run(self) -> None:
        """Works until every file is done, failed or left out."""
        for left in (self._folder / PARTS).glob(f"{UNFINISHED}*"):  # by workers that were killed
            shutil.rmtree(left, ignore_errors=True)
        try:
            asyncio.run(self._run())
        finally:
            self._save()
            with suppress(OSError):  # parts of failed files stay for the next batch
                (self._folder / PARTS).rmdir()

    async def _run(self) -> None:
        at_once = AHEAD * max(1, int(cluster_cores()))
        await asyncio.gather(*(self._run_waiting() for _ in range(at_once)))

    async def _run_waiting(self) -> None:
        for path in self._waiting:
            await self._run_file(path)

    async def _run_file(self, path: str) -> None:
        """Plans a file, runs its parts, and joins them."""
        try:
            plan: Plan = await self._plan_task.remote(path, self._recipe)
        except RayError as error:
            self._end(path, FileResult(key="", status="failed", reason=_reason(error)))
            return
        known = self.summary.files.get(path)
        if known is not None and known.key == plan.key and self._is_settled(known):
            self._report(path, known, True)
            return
        self._count_parts(len(plan.parts), 0)
        outcomes = await asyncio.gather(*(self._run_part(plan, number) for number in range(len(plan.parts))))
        reason = next((one.reason for one in outcomes if one.reason), "")
        if not reason:
            try:
                reason = await self._finish_task.remote(outcomes, str(self._folder / self._files[path]))
            except RayError as error:
                reason = _reason(error)
        result = FileResult(
            key=plan.key,
            status="failed" if reason else "done",
            reason=presentable(mask_secrets(reason)),
            shortfalls=list(dict.fromkeys(text for one in outcomes for text in one.shortfalls)),
            result="" if reason else self._files[path],
            parts=len(plan.parts),
            duration_s=round(plan.duration_s, 3),
            cpu_s=round(sum(one.cpu_s for one in outcomes), 3),
        )
        self._end(path, result)

    def _is_settled(self, known: FileResult) -> bool:
        """Whether an earlier batch has made the result, or given the file up."""
        if known.status == "failed":
            return not self._retry_failed
        return (self._folder / known.result).exists()

    async def _run_part(self, plan: Plan, number: int) -> Outcome:
        try:
            outcome: Outcome = await self._part_task.remote(plan, number, self._recipe, str(self._folder))
        except RayError as error:
            outcome = Outcome("", _reason(error))
        self._count_parts(0, 1)
        return outcome

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
    if isinstance(cause, OSError) and cause.strerror:
        is_link = isinstance(cause, FileNotFoundError) and os.path.islink(cause.filename)
        remedy = "; is the disk mounted that it links to?" if is_link else ""
        return f"cannot be read: {cause.strerror}{remedy}"
    lines = str(cause).strip().splitlines() or [type(cause).__name__]
    return f"{type(cause).__name__}: {lines[0]}"
