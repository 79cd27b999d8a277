"""What the pages of docs/ tell to type works; pages with a test of their own are left to it."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"```(\w+)\n(.*?)```", re.DOTALL)
BINARY = Path(sys.executable).with_name("streamkit")
OWN_TEST = {"elements.md", "tutorial-first-element.md", "tutorial-feature-space.md"}
PAGES = sorted(
    page.relative_to(DOCS)
    for page in DOCS.rglob("*.md")
    if page.name not in OWN_TEST and re.search(r"```(sh|python)\n", page.read_text(encoding="utf-8"))
)


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_a_page_can_be_followed(page: Path, tmp_path: Path) -> None:
    """Its commands, in order and in one folder, end with code 0; its programs run."""
    for language, body in BLOCK.findall((DOCS / page).read_text(encoding="utf-8")):
        lines = body.replace("\\\n", " ").splitlines() if language == "sh" else []
        commands = [[str(BINARY), *shlex.split(line)[1:]] for line in lines if line.startswith("streamkit ")]
        if language == "python":
            commands.append([sys.executable, "-c", body])
        for command in commands:
            done = subprocess.run(
                command, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
            )
            assert done.returncode == 0, f"{shlex.join(command)}\n{done.stderr}"


def test_every_example_of_an_element_can_be_built() -> None:
    """The launch lines of docs/elements.md are the examples of the elements."""
    from streamkit.graph.build import build

    text = (DOCS / "elements.md").read_text(encoding="utf-8")
    lines = re.findall(r'^streamkit launch "(.*)"$', text, re.MULTILINE)
    assert len(lines) > 20
    for line in lines:
        assert build(line, {}).elements, line


def test_the_statistics_page_names_every_field() -> None:
    """The tables are those of the types."""
    from streamkit.graph import statistics

    text = (DOCS / "statistics.md").read_text(encoding="utf-8")
    for kind in ("RunStatistics", "ElementStatistics", "QueueLevels", "PadStatistics"):
        for field in getattr(statistics, kind).__struct_fields__:
            assert f"`{field}`" in text, f"{kind}.{field}"


def test_pages_with_a_test_of_their_own_are_there() -> None:
    """None is left out of both."""
    tests = {path.name for path in Path(__file__).parent.glob("test_*.py")}
    for name in OWN_TEST - {"elements.md"}:
        if (DOCS / name).exists():
            assert f"test_{name.removesuffix('.md').replace('-', '_')}.py" in tests
