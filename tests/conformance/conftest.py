"""GStreamer's own results, one case a line, out of the shared folder."""

import json
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture(scope="session")
def conformance_cases(shared_folder: Path) -> list[dict[str, Any]]:
    """All cases, in the order of the file."""
    lines = (shared_folder / "conformance" / "cases.jsonl").read_text(encoding="utf-8").splitlines()
    return [json.loads(line) for line in lines]
