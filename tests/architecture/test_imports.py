"""Imports run one way; plugins stand on streamkit's public names and on nothing of each other."""

import ast
import importlib.metadata
from collections.abc import Iterator
from pathlib import Path

import pytest

import streamkit
from streamkit.element.registry import GROUP

ROOT = Path(__file__).parents[2]
ENGINE = ROOT / "streamkit"
PLUGINS = ROOT / "plugins"

# What each room of the engine may import of the others; `masking` and `errors` lie below all.
ALLOWED = {
    "masking": set(),
    "settings": set(),
    "geometry": set(),
    "errors": {"masking"},
    "flow": {"masking", "errors", "geometry"},
    "handoff": {"masking", "errors", "flow"},
    "element": {"masking", "errors", "flow", "settings"},
    "elements": {"masking", "errors", "flow", "element", "handoff"},
    "graph": {"masking", "errors", "flow", "element", "handoff"},
    "testing": {"masking", "errors", "flow", "element", "graph"},
    "cli": {"masking", "errors", "flow", "element", "graph"},
}
MODULES = {"masking", "errors", "settings"}  # rooms of one module
# Modules between elements and algorithms: they turn frames, caps and errors into plain data and back.
# A new module does not belong here unless it cannot be written on plain arrays and bytes.
GLUE = {
    "streamkit_media.codecs",
    "streamkit_media.container",
    "streamkit_media.rtsp.connection",
    "streamkit_media.rtsp.endpoint",
    "streamkit_media.rtsp.packetreader",
    "streamkit_media.streams",
    "streamkit_media.doctor.checks",
    "streamkit_media.doctor.command",
    "streamkit_media.doctor.decoding",
    "streamkit_media.doctor.examine",
    "streamkit_media.doctor.watch",
    "streamkit_media.files.playrange",
    "streamkit_media.packets",
    "streamkit_media.decoding.videodecoder",
    "streamkit_stitcher.live_mosaic",
    "streamkit_stitcher.mosaic_pad",
    "streamkit_tracker.explanation.command",
    "streamkit_tracker.explanation.reading",
    "streamkit_tracker.frame_link",
    "streamkit_video.raw_caps",
    "streamkit_wavelet_eigen.experiments.command",
    "streamkit_wavelet_eigen.experiments.run",
    "streamkit_wavelet_eigen.experiments.tracking",
    "streamkit_tracks.record_file",
    "streamkit_zenoh.connection",
    "streamkit_zenoh",
    "streamkit_zenoh.publish.frame_publisher",
    "streamkit_zenoh.publish.publication",
    "streamkit_zenoh.publish.record_publisher",
    "streamkit_zenoh.subscribe",
    "streamkit_zenoh.subscribe_output",
    "streamkit_zenoh.subscriber",
    "streamkit_zenoh.wire.frame_header",
    "streamkit_zenoh.wire.records",
    "streamkit_zenoh.wire.schemas",
}
# Public names that work on plain text and know nothing of the engine.
PLAIN_NAMES = {("streamkit", "Choice"), ("streamkit", "mask_secrets")}
# What plugins share that needs nothing of the engine.
LIBRARIES = {"streamkit_kernels", "streamkit_telemetry_formats"}
PLUGIN_NAMES = {path.name for path in PLUGINS.iterdir() if (path / "__init__.py").exists()}


def imports(path: Path) -> Iterator[tuple[str, str, int]]:
    """Module, name and line of every import of a file, wherever in it; name is "" for `import module`."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, "", node.lineno
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import; write the whole name"
            for alias in node.names:
                yield node.module or "", alias.name, node.lineno


def element_modules() -> set[str]:
    """The modules that entry points name."""
    entries = importlib.metadata.distribution("streamkit").entry_points.select(group=GROUP)
    return {entry.value.partition(":")[0] for entry in entries}


def module_name(path: Path, root: Path) -> str:
    """The dotted name of a file."""
    return ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")


def plugin_files() -> list[Path]:
    """All modules of all plugins."""
    return sorted(path for name in PLUGIN_NAMES for path in (PLUGINS / name).rglob("*.py"))


@pytest.mark.parametrize("room", sorted(ALLOWED))
def test_engine_imports_run_one_way(room: str) -> None:
    """Imports run cli -> graph -> element -> flow; elements stand on element, testing on graph."""
    files = [ENGINE / f"{room}.py"] if room in MODULES else sorted((ENGINE / room).rglob("*.py"))
    assert files
    wrong = []
    for path in files:
        for module, name, line in imports(path):
            parts = module.split(".")
            if parts[0] != "streamkit":
                continue
            target = parts[1] if len(parts) > 1 else name
            if target != room and target not in ALLOWED[room]:
                wrong.append(f"{path.relative_to(ROOT)}:{line}: {module} {name}")
    assert not wrong


def test_every_room_of_the_engine_is_checked() -> None:
    """A new room gets its rule here first."""
    rooms = {path.name for path in ENGINE.iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert rooms | MODULES == set(ALLOWED)
    assert {path.name for path in ENGINE.glob("*.py")} == {"__init__.py", *(f"{name}.py" for name in MODULES)}


def test_the_engine_imports_no_plugin() -> None:
    """Elements come through entry points only."""
    wrong = [
        f"{path.relative_to(ROOT)}:{line}: {module}"
        for path in sorted(ENGINE.rglob("*.py"))
        for module, _, line in imports(path)
        if module.split(".")[0] in PLUGIN_NAMES
    ]
    assert not wrong


def test_plugins_use_public_names_only() -> None:
    """`from streamkit import X` with X in `streamkit.__all__`, or the libraries that need no engine."""
    wrong = [
        f"{path.relative_to(ROOT)}:{line}: {module} {name}".rstrip()
        for path in plugin_files()
        for module, name, line in imports(path)
        if module.split(".")[0] == "streamkit"
        and not (module == "streamkit" and name in streamkit.__all__)
        and not is_library(module)
    ]
    assert not wrong


def test_libraries_need_neither_engine_nor_plugins() -> None:
    """Algorithms stand on them as on any other library."""
    ours = {"streamkit"} | PLUGIN_NAMES
    wrong = [
        f"{path.relative_to(ROOT)}:{line}: {module}"
        for library in LIBRARIES
        for path in sorted((PLUGINS / library).rglob("*.py"))
        for module, _, line in imports(path)
        if module.split(".")[0] in ours - {library}
    ]
    assert not wrong


def test_no_plugin_imports_another() -> None:
    """What one finds out the other gets as metadata of a frame."""
    wrong = [
        f"{path.relative_to(ROOT)}:{line}: {module}"
        for path in plugin_files()
        for module, _, line in imports(path)
        if module.split(".")[0] in PLUGIN_NAMES - LIBRARIES - {path.relative_to(PLUGINS).parts[0]}
    ]
    assert not wrong


def is_library(module: str) -> bool:
    """Whether a module of ours needs nothing of the engine: geometry, hand-over between threads, settings."""
    return module.startswith(("streamkit.geometry", "streamkit.handoff", "streamkit.settings"))


def is_element(path: Path) -> bool:
    """Whether a file holds an element: an entry point names it, or it is called element.py."""
    return path.name == "element.py" or module_name(path, PLUGINS) in element_modules()


def needed_by(path: Path) -> set[str]:
    """The modules that a file imports, written in either way."""
    return {
        needed
        for module, name, _ in imports(path)
        if (module, name) not in PLAIN_NAMES
        for needed in (module, f"{module}.{name}")
    }


def test_algorithms_know_nothing_of_the_engine() -> None:
    """What is neither an element nor listed as glue needs no streamkit, not even through a neighbour."""
    needs = {module_name(path, PLUGINS): needed_by(path) for path in plugin_files() if not is_element(path)}
    bound = {
        name
        for name, needed in needs.items()
        if any(part.split(".")[0] == "streamkit" and not is_library(part) for part in needed)
    }
    while more := {name for name, needed in needs.items() if needed & bound} - bound:
        bound |= more
    assert bound == GLUE


def test_algorithms_import_no_element() -> None:
    """Elements stand on algorithms and never the other way round."""
    elements = {module_name(path, PLUGINS) for path in plugin_files() if is_element(path)}
    wrong = {
        module_name(path, PLUGINS): needed_by(path) & elements
        for path in plugin_files()
        if not is_element(path) and path.name != "__init__.py"
    }
    assert {name: needed for name, needed in wrong.items() if needed} == {}


def test_public_names_lead_where_they_say() -> None:
    """Each is found, belongs to the engine, and is the same object every time."""
    assert len(streamkit.__all__) == len(set(streamkit.__all__))
    for name in streamkit.__all__:
        assert getattr(streamkit, name) is getattr(streamkit, name)
    assert set(streamkit.__all__) <= set(dir(streamkit))
    with pytest.raises(AttributeError, match="module 'streamkit' has no attribute 'Nothing'"):
        streamkit.Nothing  # noqa: B018
