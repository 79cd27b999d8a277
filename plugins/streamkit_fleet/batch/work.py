"""What Ray's workers do: plan a file, run a part of it, join its parts."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from streamkit import Message, Pipeline, StreamkitError, encode_record
from streamkit.masking import mask_secrets, presentable
from streamkit.output.file import OutputFile, write_whole
from streamkit_fleet.batch.join import join_records
from streamkit_fleet.batch.plan import BatchRecipe, ClipPart, Plan

PARTS = ".parts"  # folder of unfinished results
UNFINISHED = "unfinished-"  # begins the name of a folder in which a part is being made


@dataclass(frozen=True, slots=True)
class Outcome:
    """What has become of a part: its result, or the reason why there is none; and what it says is missing."""

    path: str
    reason: str = ""
    cpu_s: float = 0.0
    shortfalls: tuple[str, ...] = ()


def run_part(plan: Plan, number: int, recipe: BatchRecipe, folder: str) -> Outcome:
    """Runs the pipeline over a part, unless an earlier batch has done so; its result appears when whole."""
    target = Path(folder) / PARTS / f"{plan.key}-{number}{recipe.suffix}"
    if target.exists():
        return Outcome(str(target), shortfalls=_read_shortfalls(target))
    # Records name the file that they are written to: it has the name of the result.
    unfinished = (
        target.parent / f"{UNFINISHED}{os.getpid()}-{target.stem}" / f"{Path(plan.path).name}{recipe.suffix}"
    )
    began_s = time.process_time()
    messages: list[Message] = []
    try:
        unfinished.parent.mkdir(parents=True)
        with _pipeline(plan, plan.parts[number], recipe, unfinished) as pipeline:
            pipeline.bus.watch(messages.append)
            pipeline.run()
        found = tuple(
            presentable(mask_secrets(f"{message.source}: {message.text}"))
            for message in messages
            if message.is_shortfall
        )
        if found:  # before the result: an interrupted batch leaves no part without them
            write_whole(_shortfalls_file(target), msgspec.json.encode(found))
        unfinished.replace(target)
    except (StreamkitError, OSError) as error:
        return Outcome("", str(error), time.process_time() - began_s)
    finally:
        shutil.rmtree(unfinished.parent, ignore_errors=True)
    return Outcome(str(target), cpu_s=time.process_time() - began_s, shortfalls=found)


def _shortfalls_file(part: Path) -> Path:
    """Beside the result of a part, for a later batch that joins it."""
    return part.with_name(f"{part.name}.shortfalls")


def _read_shortfalls(part: Path) -> tuple[str, ...]:
    try:
        return msgspec.json.decode(_shortfalls_file(part).read_bytes(), type=tuple[str, ...])
    except FileNotFoundError:
        return ()


def _pipeline(plan: Plan, part: ClipPart, recipe: BatchRecipe, output: Path) -> Pipeline:
    variables = {**recipe.variables, "input": plan.path, "output": str(output)}
    pipeline = Pipeline.parse(recipe.text, variables)
    if part != ClipPart():
        for element in pipeline.graph.elements:
            if element.factory == "filesrc":
                element.set_property("start_s", part.begin_s)
                element.set_property("stop_s", part.end_s)
    return pipeline


def finish(outcomes: Sequence[Outcome], result: str) -> str:
    """Puts the result of a file in its place; returns the reason if that fails."""
    paths = [Path(outcome.path) for outcome in outcomes]
    target = Path(result)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if len(paths) == 1:
            paths[0].replace(target)
        else:
            _join(paths, target)
        for path in paths:
            path.unlink(missing_ok=True)
            _shortfalls_file(path).unlink(missing_ok=True)
    except (StreamkitError, OSError) as error:
        return str(error)
    return ""


def _join(paths: Sequence[Path], target: Path) -> None:
    file = OutputFile(target, is_whole=True)
    try:
        for record in join_records(paths):
            file.write(encode_record(record) + b"\n")
        file.finish()
    finally:
        file.discard()
