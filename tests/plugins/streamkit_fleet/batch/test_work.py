"""What a worker does with a part, without Ray."""

from pathlib import Path

from streamkit_fleet.batch.work import PARTS, BatchRecipe, ClipPart, Plan, finish, run_part


def test_a_part_of_an_interrupted_batch_keeps_its_shortfalls(tmp_path: Path) -> None:
    """The next batch takes the part as it is, says again what is missing in it, and leaves nothing behind."""
    sinks = "t. ! filesink location=${output}  t. ! tracksink location=${input}"
    text = f"videotestsrc num-buffers=2 ! tee name=t  {sinks}"
    recipe = BatchRecipe(text, {}, ".raw", 0, 0)
    plan = Plan(str(tmp_path / "tracks.jsonl"), "key", 1.0, (ClipPart(),))
    first, again = (run_part(plan, 0, recipe, str(tmp_path)) for _ in range(2))
    assert first.shortfalls
    assert again.shortfalls == first.shortfalls
    assert again.cpu_s == 0
    assert finish([again], str(tmp_path / "result.raw")) == ""
    assert (tmp_path / "result.raw").exists()
    assert not list((tmp_path / PARTS).iterdir())


def test_records_name_the_file_that_they_end_in(tmp_path: Path) -> None:
    """As those of `launch` do, and not one of a part, which has another name in each batch."""
    text = "videotestsrc num-buffers=2 ! particletrack window=9,9,9,9 ! tracksink location=${output}"
    recipe = BatchRecipe(text, {}, ".jsonl", 0, 0)
    outcome = run_part(Plan("/day/clip 1.mp4", "key", 1.0, (ClipPart(),)), 0, recipe, str(tmp_path))
    assert '"source":"clip 1.mp4"' in Path(outcome.path).read_text()
