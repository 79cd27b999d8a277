"""What `streamkit batch` expects of a description."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from streamkit.cli.main import make_app
from streamkit.output.file import Claim
from streamkit_fleet.batch.command import files_and_results, missing_variable, unused_variables


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a=${input} b=${output}", ""),
        ("a=${input:-x.mp4} b=${output:-x.jsonl} c=${other}", ""),
        ("a=${input} b=x.jsonl", "has no ${output}: batch sets ${input} and ${output} for each file"),
        ("a=$input b=${output}", "has no ${input}: .*; write ${input} for $input"),
        ("a=${INPUT} b=${output} c=${gain} d=${k:-1}", "has no ${input}: .*; it has ${INPUT}, ${k}"),
    ],
)
def test_a_variable_that_is_missing_is_named(text: str, expected: str) -> None:
    """With how it may be spelt in the description; a default is no fault."""
    begin, _, end = expected.partition(".*")
    found = missing_variable(text, {"gain": "2"})
    assert found.startswith(begin)
    assert found.endswith(end)
    assert bool(found) is bool(expected)


def test_a_variable_that_is_not_used_is_noted() -> None:
    """As `launch` does: a mistyped name leaves the default in force."""
    text = "a=${input} b=${output} seed=${seed:-0}"
    note = "--set seeed is not used: the description has no ${seeed}; it has input, output, seed"
    assert unused_variables(text, {"seeed": "3", "seed": "4"}) == [note]


def test_a_fault_of_the_description_is_pointed_at(tmp_path: Path) -> None:
    """As `launch` does, in the file's text."""
    file = tmp_path / "fly.pipe"
    file.write_text("filesrc location=${input} ! decod ! tracksink location=${output}\n")
    arguments = ["batch", str(tmp_path / "*.mp4"), "-f", str(file), "--output", str(tmp_path / "out")]
    done = CliRunner().invoke(make_app(), arguments)
    assert done.exit_code == 2
    message, _, marker = done.stderr.splitlines()
    assert message.startswith(f"{file}:1:")
    assert 'no element "decod"; did you mean "decode"?' in message
    assert marker.strip() == "^^^^^"


def test_a_description_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    """With the reason."""
    done = CliRunner().invoke(make_app(), ["batch", "*.mp4", "-f", "nosuch.pipe", "--output", str(tmp_path)])
    assert done.exit_code == 2
    assert done.stderr == "error: cannot read the description nosuch.pipe: No such file or directory\n"


def test_a_folder_of_results_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    """With the option and what to do, and before Ray starts."""
    (tmp_path / "a.mp4").touch()
    (tmp_path / "copy.pipe").write_text("filesrc location=${input} ! filesink location=${output}")
    output = tmp_path / "a.mp4" / "out"
    command = ["batch", str(tmp_path / "*.mp4"), "-f", str(tmp_path / "copy.pipe"), "--output", str(output)]
    result = CliRunner().invoke(make_app(), command)
    assert result.exit_code == 1
    assert f"--output {output}: cannot be written: Not a directory; check that" in result.stderr


def test_a_folder_has_one_batch_at_a_time(tmp_path: Path) -> None:
    """Two would take each other's parts away; the second is refused before Ray starts."""
    (tmp_path / "a.mp4").touch()
    (tmp_path / "copy.pipe").write_text("filesrc location=${input} ! filesink location=${output}")
    command = ["batch", str(tmp_path / "*.mp4"), "-f", str(tmp_path / "copy.pipe"), "--output", str(tmp_path)]
    first = Claim()
    first.take(tmp_path)
    result = CliRunner().invoke(make_app(), command)
    first.release()
    assert result.exit_code == 1
    assert result.stderr == (
        f"error: --output {tmp_path}: another batch writes there; wait for its end, or name another\n"
    )


def test_a_link_that_leads_in_a_circle_gives_each_file_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A link to another folder is followed, also where it is on another disk."""
    archive, disk = tmp_path / "archive", tmp_path / "disk"
    for folder in (archive / "day", disk):
        folder.mkdir(parents=True)
        (folder / "a.mp4").touch()
    (archive / "day" / "up").symlink_to(archive)
    (archive / "disk").symlink_to(disk)
    expected = {str(archive / name): f"{name}.jsonl" for name in ("day/a.mp4", "disk/a.mp4")}
    assert files_and_results(f"{archive}/**/*.mp4", ".jsonl") == expected
    monkeypatch.chdir(archive / "day")
    assert list(files_and_results("../day/*.mp4", ".jsonl").values()) == ["a.mp4.jsonl"]
