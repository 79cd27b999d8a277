"""Every command on the pages of docs/ works; pages with a test of their own are left to it."""

import ast
import importlib
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import pytest
from typer.testing import CliRunner

from streamkit.cli.main import make_app
from streamkit.graph.build import build

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"```(\w+)\n(.*?)```", re.DOTALL)
OWN_TEST = {"fleet.md", "tutorial-first-element.md", "tutorial-several-pads.md", "tutorial-feature-space.md"}
WIDE = {"COLUMNS": "200"}  # no option is cut short in the help
FOLLOWED = ("statistics.md", "guide/python.md", "guide/opencv.md")
GENERATED = DOCS / "elements"
LOOKED_AT = sorted(
    page.relative_to(DOCS)
    for page in DOCS.rglob("*.md")
    if page.parent != GENERATED
    and page.relative_to(DOCS).as_posix() not in OWN_TEST.union(FOLLOWED)
    and re.search(r"```(sh|python)\n", page.read_text(encoding="utf-8"))
)


def blocks(page: Path | str) -> list[tuple[str, str]]:
    """Language and text of each listing of a page."""
    return BLOCK.findall((DOCS / page).read_text(encoding="utf-8"))


def commands(text: str) -> list[list[str]]:
    """The calls of streamkit in a listing for the shell."""
    lines = text.replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True) for line in lines if line.startswith("streamkit ")]


@pytest.mark.usefixtures("forget_registered")
@pytest.mark.parametrize("page", FOLLOWED)
def test_a_page_can_be_followed(
    page: str,
    tmp_path: Path,
    call: Callable[[list[str], Path], CompletedProcess[str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its commands, in order and in one folder, end with code 0; its programs run."""
    monkeypatch.chdir(tmp_path)
    for language, body in blocks(page):
        for words in commands(body) if language == "sh" else []:
            result = call(words[1:], tmp_path)
            assert result.returncode == 0, f"{shlex.join(words)}\n{result.stderr}"
        if language == "python":
            exec(compile(body, page, "exec"), {"__name__": "__main__"})


def test_programs_for_opencv_are_type_checked() -> None:
    """They are the files of docs/examples/opencv, which `make lint` checks."""
    programs = {body for language, body in blocks("guide/opencv.md") if language == "python"}
    files = (DOCS / "examples" / "opencv").glob("*.py")
    assert programs == {path.read_text(encoding="utf-8") for path in files}


@pytest.mark.parametrize("page", LOOKED_AT, ids=str)
def test_what_needs_a_peer_can_be_typed(page: Path) -> None:
    """Where cameras, peers or data are needed: descriptions can be built, options and names are there."""
    for language, body in blocks(page):
        if language == "python":
            demand_imports(body)
        for words in commands(body) if language == "sh" else []:
            done = CliRunner().invoke(make_app(), [*words[1:2], "--help"], env=WIDE)
            assert done.exit_code == 0, f"{shlex.join(words)}\n{done.output}"
            for option in (word.partition("=")[0] for word in words[2:] if re.match(r"--?[a-z]", word)):
                assert option in done.stdout, f"{shlex.join(words)}: {option}"
            if words[1] in ("launch", "graph") and not {"-f", "--file"}.intersection(words):
                texts = [word for word in words[2:] if "!" in word]
                assert all(build(text, {}).elements for text in texts), shlex.join(words)


def demand_imports(program: str) -> None:
    """Fails where a program is no Python, or imports what is not there."""
    for node in ast.walk(ast.parse(program)):
        if isinstance(node, ast.ImportFrom):
            module = importlib.import_module(node.module or "")
            assert all(hasattr(module, alias.name) for alias in node.names), ast.unparse(node)


def test_every_example_of_an_element_can_be_built() -> None:
    """The launch lines of docs/elements/ are the examples of the elements."""
    text = "\n".join(page.read_text(encoding="utf-8") for page in GENERATED.glob("*.md"))
    lines = re.findall(r'^streamkit launch "(.*)"$', text, re.MULTILINE)
    assert len(lines) > 20
    for line in lines:
        assert build(line, {}).elements, line


def test_the_statistics_page_names_every_field() -> None:
    """The tables are those of the types."""
    from streamkit.flow import statistics

    text = (DOCS / "statistics.md").read_text(encoding="utf-8")
    for kind in ("RunStatistics", "ElementStatistics", "ProcessStatistics", "QueueLevels", "PadStatistics"):
        for field in getattr(statistics, kind).__struct_fields__:
            assert f"`{field}`" in text, f"{kind}.{field}"


def test_pages_with_a_test_of_their_own_are_there() -> None:
    """None is left out of both."""
    tests = {path.name for path in Path(__file__).parent.glob("test_*.py")}
    for name in OWN_TEST:
        if (DOCS / name).exists():
            assert f"test_{name.removesuffix('.md').replace('-', '_')}.py" in tests
