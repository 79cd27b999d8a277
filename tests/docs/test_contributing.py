"""What CONTRIBUTING says holds: targets and folders exist, and commit hooks check what CI checks."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
HOOKS = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
PAGES = ("CONTRIBUTING.md", "SECURITY.md", "README.md", "docs/release-checklist.md")


def recipe(target: str) -> list[str]:
    """The commands of a target of the Makefile."""
    found = re.search(rf"^{target}:.*\n((?:\t.*\n)+)", MAKEFILE, re.MULTILINE)
    assert found is not None, target
    return [line.strip().removeprefix("@").replace("$(BIN)", ".venv/bin") for line in found[1].splitlines()]


def test_commit_hooks_run_what_ci_runs() -> None:
    """Each command of `make lint` is a hook of a commit, each target of .ci/run except one of a push."""
    entries = set(re.findall(r"^ +entry: (.+)$", HOOKS, re.MULTILINE))
    assert set(recipe("lint")) <= entries
    targets = set(
        re.findall(r"^make (\w+)$", (ROOT / ".ci" / "run").read_text(encoding="utf-8"), re.MULTILINE)
    )
    assert {f"make {target}" for target in targets - {"lint"}} <= entries


def test_commit_hooks_download_nothing() -> None:
    """They are local and use the project's environment."""
    assert re.findall(r"^ *- repo: (\w+)$", HOOKS, re.MULTILINE) == ["local"]
    languages = re.findall(r"^ +language: (\w+)$", HOOKS, re.MULTILINE)
    assert languages
    assert set(languages) == {"system"}


@pytest.mark.parametrize("page", PAGES)
def test_targets_and_links_exist(page: str) -> None:
    """Every `make` target that a page names is in the Makefile, every relative link leads to a file."""
    text = (ROOT / page).read_text(encoding="utf-8")
    for target in re.findall(r"(?:^|`)make (\w+)(?= {2,}|`|$)", text, re.MULTILINE):
        assert recipe(target), target
    for link in re.findall(r"\]\((?!https?:)([^)#]+)", text):
        assert ((ROOT / page).parent / link).exists(), link


def test_folders_of_the_table_exist() -> None:
    """The map of the repository names what is there, and every package of the engine and every plugin."""
    table = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## Where things are")[2]
    for row in re.findall(r"^\| (`.+) \|$", table.partition("## Test")[0], re.MULTILINE):
        for name in re.findall(r"`([^`]+)`", row):
            candidates = [*ROOT.glob(name), *(ROOT / "streamkit").glob(name)]
            assert candidates, name
    for package in (ROOT / "streamkit").iterdir():
        if package.is_dir() and package.name != "__pycache__":
            assert re.search(rf"`(streamkit/)?{package.name}`", table), package.name


def test_there_is_one_address_of_the_repository() -> None:
    """The site and the package name the same one."""
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]
    configuration = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert re.findall(r"^  repository: (\S+)$", configuration, re.MULTILINE) == [urls["Repository"]]
