"""How files are split."""

from dataclasses import replace
from pathlib import Path

from streamkit import Pipeline
from streamkit_fleet.batch.work import BatchRecipe, ClipPart, keyframes_s, plan_file, split

RECIPE = BatchRecipe("filesrc location=${input} ! filesink location=${output}", {}, ".jsonl", 1.0, 0.5)


def test_parts_begin_and_end_at_keyframes() -> None:
    """Each begins at the last keyframe that leaves the overlap before its seam."""
    every_two = [2.0 * number for number in range(10)]
    assert split(every_two, 20.0, 5.0, 3.0) == (
        ClipPart(0.0, 6.0),
        ClipPart(2.0, 12.0),
        ClipPart(8.0, None),
    )


def test_a_short_rest_is_no_part() -> None:
    """A part is at least half as long as was asked for; too few keyframes are one part."""
    assert split([0.0, 5.0, 6.0], 7.0, 5.0, 1.0) == (ClipPart(),)
    assert split([0.0], 20.0, 5.0, 1.0) == (ClipPart(),)
    assert split([], 20.0, 5.0, 1.0) == (ClipPart(),)


def test_a_file_is_planned_by_its_content(tmp_path: Path) -> None:
    """The key changes with content and recipe, not with the order of variables; junk is one part."""
    clip = tmp_path / "clip.mp4"
    Pipeline.parse(
        f"videotestsrc num-buffers=75 ! video/x-raw, width=64, height=48, framerate=25/1 "
        f"! encode live=true gop=25 ! packetsink location={clip}"
    ).run(timeout_s=60)
    assert keyframes_s(str(clip)) == [0.0, 1.0, 2.0]
    plan = plan_file(str(clip), RECIPE)
    assert plan.duration_s == 3.0
    assert plan.parts == (ClipPart(0.0, 1.0), ClipPart(0.0, 2.0), ClipPart(1.0, None))
    assert plan == plan_file(str(clip), RECIPE)
    first, second = ({"a": "1", "b": "2"}, {"b": "2", "a": "1"})
    named = replace(RECIPE, variables=first)
    assert plan_file(str(clip), named) == plan_file(str(clip), replace(RECIPE, variables=second)) != plan
    clip.write_bytes(b"junk")
    junk = plan_file(str(clip), RECIPE)
    assert junk.parts == (ClipPart(),)
    assert junk.key != plan.key
