"""Only what a pipeline uses is imported."""

import json
import subprocess
import sys
from pathlib import Path

PLUGINS = Path(__file__).parents[2] / "plugins"
HEAVY = {"cv2", "av", "zenoh", "scipy", "pywt", "numpy", "rich", "lark.tools"}
PLUGIN_NAMES = {path.name for path in PLUGINS.iterdir() if (path / "__init__.py").exists()}


def imported_by(code: str) -> set[str]:
    """The modules that a fresh interpreter has after running code."""
    tail = "\nimport json, sys\nsys.stderr.write(json.dumps(sorted(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", code + tail], capture_output=True, text=True, timeout=60, check=True
    )
    return set(json.loads(done.stderr))


def test_importing_streamkit_imports_nothing_else() -> None:
    """Each public name is imported when it is first used."""
    modules = imported_by("import streamkit")
    assert not modules & (HEAVY | PLUGIN_NAMES)
    assert "streamkit.graph.pipeline" not in modules


def test_a_pipeline_of_core_elements_imports_no_plugin() -> None:
    """Parsing and running it needs neither OpenCV nor FFmpeg nor zenoh nor NumPy."""
    modules = imported_by(
        "from streamkit import Pipeline\n"
        "Pipeline.parse('fakesrc num-buffers=1 ! queue ! fakesink').run(timeout_s=10)"
    )
    assert "streamkit.elements.queue" in modules
    assert not modules & (HEAVY | PLUGIN_NAMES)
    assert "streamkit.elements.tee" not in modules


def test_listing_elements_imports_none() -> None:
    """`streamkit inspect` reads entry points."""
    modules = imported_by(
        "import sys\n"
        "from streamkit.cli.main import main\n"
        "sys.argv = ['streamkit', 'inspect']\n"
        "try:\n"
        "    main()\n"
        "except SystemExit as ended:\n"
        "    assert not ended.code, ended.code\n"
    )
    assert "streamkit.element.registry" in modules
    assert not modules & ((HEAVY - {"rich"}) | PLUGIN_NAMES)
    assert not any(name.startswith("streamkit.elements") for name in modules)
