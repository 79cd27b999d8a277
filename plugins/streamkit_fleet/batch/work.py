"""What Ray's workers do: plan a file of an archive, run a part of it, put the result in its place."""

from __future__ import annotations

import hashlib
import os
import shutil
import time
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import av
import msgspec

from streamkit import Message, Pipeline, StreamkitError, encode_record
from streamkit.masking import mask_secrets, presentable
from streamkit.output.file import OutputFile, write_whole
from streamkit_fleet.batch.join import join_records

PARTS = ".parts"  # folder of unfinished results
UNFINISHED = "unfinished-"  # begins the name of a folder in which a part is being made


@dataclass(frozen=True, slots=True)
class BatchRecipe:
    """What is done with every file.

    Attributes:
        text: description with `${input}` and `${output}`.
        variables: values of its other variables.
        suffix: of the results, ".jsonl".
        part_s: longest part of a file, s; 0 does not split.
        overlap_s: by how much a part begins before the end of the one before, s.
    """

    text: str
    variables: dict[str, str]
    suffix: str
    part_s: float
    overlap_s: float


@dataclass(frozen=True, slots=True)
class ClipPart:
    """A part of a file, s from its beginning.

    Attributes:
        begin_s: first frame processed, a keyframe; it lies before the end of the part before, so that targets
            seen in both can be matched.
        end_s: end; None is the file's.
    """

    begin_s: float = 0.0
    end_s: float | None = None


@dataclass(frozen=True, slots=True)
class Plan:
    """A file and its parts; `key` is the hash of its content, its path and the recipe."""

    path: str
    key: str
    duration_s: float
    parts: tuple[ClipPart, ...]


def plan_file(path: str, recipe: BatchRecipe) -> Plan:
    """Reads a file once for its hash, and once more for its keyframes if it is to be split.

    Raises:
        OSError: the file cannot be read.
    """
    with Path(path).open("rb") as file:
        content = hashlib.file_digest(file, "sha256")
    content.update(msgspec.json.encode((path, recipe), order="sorted"))
    key = content.hexdigest()
    try:
        with av.open(path) as container:
            duration_s = (container.duration or 0) / av.time_base
        splits = recipe.part_s and duration_s > 1.5 * recipe.part_s
        parts = (
            split(keyframes_s(path), duration_s, recipe.part_s, recipe.overlap_s) if splits else (ClipPart(),)
        )
    except (av.FFmpegError, IndexError):  # the pipeline says why it cannot be read
        return Plan(path, key, 0.0, (ClipPart(),))
    return Plan(path, key, duration_s, parts)


def keyframes_s(path: str) -> list[float]:
    """Times of the keyframes of a file's first video, s from the first frame."""
    with av.open(path) as container:
        stream = container.streams.video[0]
        first, keyframes = None, []
        for packet in container.demux(stream):  # none is kept: a long file would fill the memory
            if packet.pts is None:
                continue
            first = packet.pts if first is None else min(first, packet.pts)
            if packet.is_keyframe:
                keyframes.append(packet.pts)
        return sorted((pts - (first or 0)) * float(stream.time_base or 0) for pts in keyframes)


def split(
    keyframes: Sequence[float], duration_s: float, part_s: float, overlap_s: float
) -> tuple[ClipPart, ...]:
    """Parts of at least `part_s` that begin and end at keyframes, s; one if there are too few keyframes."""
    ends, last_s = list[float](), 0.0
    while (index := bisect_left(keyframes, last_s + part_s)) < len(keyframes):
        last_s = keyframes[index]
        if duration_s - last_s < part_s / 2:  # the rest is no part of its own
            break
        ends.append(last_s)
    begins = [0.0, *(keyframes[max(0, bisect_right(keyframes, end - overlap_s) - 1)] for end in ends)]
    return tuple(map(ClipPart, begins, [*ends, None]))


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
