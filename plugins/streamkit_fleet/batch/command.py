"""`streamkit batch`: runs a pipeline over an archive, on all cores or on a cluster."""

from __future__ import annotations

import contextlib
import errno
import glob
import re
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Self

import typer

from streamkit import (
    DescriptionError,
    Pipeline,
    StreamkitError,
    exit_with_error,
    fail_description,
    read_description,
    unused_variables,
    variable_names,
    write_remedy,
)
from streamkit.masking import presentable
from streamkit.output.file import Claim

if TYPE_CHECKING:
    from streamkit_fleet.batch.driver import FileResult
    from streamkit_fleet.batch.work import BatchRecipe

SET_BY_BATCH = ("input", "output")
RECORDS = ".jsonl"  # the results whose parts can be joined


def batch(
    pattern: Annotated[str, typer.Argument(help="Files, for example 'archive/**/*.mp4'; quote it.")],
    file: Annotated[Path, typer.Option("-f", "--file", help="A description with ${input} and ${output}.")],
    output: Annotated[Path, typer.Option(help="Folder for the results and batch.json.")],
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="A value for ${NAME}.")
    ] = None,
    suffix: Annotated[str, typer.Option(help="Of the results; only .jsonl can be made in parts.")] = RECORDS,
    part_s: Annotated[
        float, typer.Option(min=0.0, help="Length of the parts of long files, s; 0 does not split.")
    ] = 300.0,
    overlap_s: Annotated[
        float, typer.Option(min=0.1, help="By how much a part begins before its seam, s.")
    ] = 10.0,
    address: Annotated[
        str | None,
        typer.Option(help="HOST:PORT of a Ray cluster that shares the folders; auto: this machine's."),
    ] = None,
    cores: Annotated[int | None, typer.Option(min=1, help="Cores of this machine to use.")] = None,
    retries: Annotated[int, typer.Option(min=0, help="Of a part whose worker has died.")] = 3,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Try files again that failed in an earlier batch.")
    ] = False,
) -> None:
    """Runs a pipeline over every file that matches, in parallel; a further batch does what is left.

    Exit code 0 if every file is done, 1 if some failed: batch.json has their reasons; 2 for wrong usage.
    """
    recipe = _recipe(file, settings or [], suffix, part_s, overlap_s)
    files = files_and_results(pattern, suffix)
    if not files:
        exit_with_error(f"no file matches {pattern!r}", 2)
    from streamkit_fleet.local_ray import connected

    folder_claim = _claim_folder(output)
    try:
        with connected(address, cores=cores), BatchProgress(len(files)) as progress:
            from streamkit_fleet.batch.driver import BatchDriver

            with contextlib.suppress(ValueError):  # not the main thread of a program
                signal.signal(signal.SIGTERM, signal.default_int_handler)  # Ray's own prints the stack
            driver = BatchDriver(
                files, recipe, output.absolute(), retries=retries, retry_failed=retry_failed,
                report=progress.report, count_parts=progress.count_parts,
            )  # fmt: skip
            driver.run()
    except (OSError, StreamkitError) as error:
        exit_with_error(str(error))
    except KeyboardInterrupt:
        exit_with_error("interrupted; the same command does what is left", 130)
    finally:
        folder_claim.release()
    again = "; --retry-failed tries the others again" if progress.failed else ""
    typer.echo(f"{len(files) - progress.failed} of {len(files)} files are done: {output}{again}", err=True)
    raise typer.Exit(int(progress.failed > 0))


def _claim_folder(folder: Path) -> Claim:
    """Makes the folder for results, which one batch at a time may write to; exits where it may not."""
    found = Claim()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        found.take(folder)
    except OSError as error:
        if error.errno == errno.EBUSY:
            exit_with_error(
                f"--output {folder}: another batch writes there; wait for its end, or name another"
            )
        exit_with_error(f"--output {folder}: cannot be written: {error.strerror}{write_remedy(error)}")
    return found


class BatchProgress:
    """Bars for files and parts, and a line for each failure and warning; `failed` files so far."""

    def __init__(self, files: int) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
        self._bars = Progress(*columns, console=Console(stderr=True, soft_wrap=True))
        self._files = self._bars.add_task("files", total=files)
        self._parts = self._bars.add_task("parts", total=0)
        self._planned = self.failed = 0

    def count_parts(self, planned: int, done: int) -> None:
        """Counts further parts to do, and done."""
        self._planned += planned
        self._bars.update(self._parts, total=self._planned, advance=done)

    def report(self, path: str, result: FileResult, is_known: bool) -> None:
        """A file is done or has failed; `is_known` where an earlier batch has seen it."""
        self._bars.advance(self._files)
        if result.status == "failed":
            self.failed += 1
            self._print(f"failed{', as before' if is_known else ''}: {path}: {result.reason}")
        for text in result.shortfalls:
            self._print(f"warning: {path}: {text}")

    def _print(self, line: str) -> None:
        self._bars.console.print(presentable(line), markup=False, highlight=False)

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bars.stop()


def _recipe(file: Path, settings: list[str], suffix: str, part_s: float, overlap_s: float) -> BatchRecipe:
    """What is done with each file; exits with code 2 if the description is invalid."""
    from streamkit_fleet.batch.work import BatchRecipe

    source = read_description(None, file, settings)
    text, variables = source.text, source.variables
    if missing := missing_variable(text, variables):
        exit_with_error(f"{file} {missing}", 2)
    try:
        Pipeline.parse(text, {**variables, "input": "input", "output": f"output{suffix}"})
    except DescriptionError as error:
        fail_description(error, source)
    for note in unused_variables(text, variables):
        typer.echo(f"note: {note}", err=True)
    return BatchRecipe(text, variables, suffix, part_s if suffix == RECORDS else 0.0, overlap_s)


def missing_variable(text: str, given: Mapping[str, str]) -> str:
    """Which of `${input}` and `${output}` a description lacks, and what it may have instead; "" if none."""
    found = variable_names(text)
    missing = [name for name in SET_BY_BATCH if name not in found]
    if not missing:
        return ""
    others = [f"${{{name}}}" for name in found if name not in given and name not in SET_BY_BATCH]
    hint = f"; it has {', '.join(others)}" if others else ""
    if re.search(rf"\${missing[0]}\b", text):
        hint = f"; write ${{{missing[0]}}} for ${missing[0]}"
    return f"has no ${{{missing[0]}}}: batch sets ${{input}} and ${{output}} for each file{hint}"


def files_and_results(pattern: str, suffix: str) -> dict[str, str]:
    """The path of the result in the output folder, by the absolute path of each file that matches.

    A link to a file that is gone, as on a disk that is not mounted, is none to leave out in silence. One to a
    folder above it leads to the same files again and again: each is read once.
    """
    fixed = Path(pattern)
    while glob.has_magic(str(fixed)):
        fixed = fixed.parent
    base = fixed if fixed.is_dir() else fixed.parent
    there = map(Path, glob.glob(pattern, recursive=True))
    found = sorted(path for path in there if path.is_file() or not path.exists())
    once = (path for path in found if not _meets_folder_twice(path, base))
    return {str(path.absolute()): f"{path.relative_to(base)}{suffix}" for path in once}


def _meets_folder_twice(path: Path, base: Path) -> bool:
    folders = [folder.resolve() for folder in path.parents if folder.is_relative_to(base)]
    return len(set(folders)) < len(folders)
