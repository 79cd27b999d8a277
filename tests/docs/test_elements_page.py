"""docs/elements/ says what the elements declare."""

import importlib.util
from pathlib import Path

GENERATE = Path(__file__).parents[2] / "docs" / "generate.py"


def test_element_pages_are_up_to_date() -> None:
    """The pages are what docs/generate.py makes of the declarations today; run it after a change."""
    spec = importlib.util.spec_from_file_location("docs_generate", GENERATE)
    assert spec is not None
    assert spec.loader is not None
    generate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generate)
    pages = {path.name: path.read_text(encoding="utf-8") for path in generate.TARGET.glob("*.md")}
    assert pages == generate.documents()
