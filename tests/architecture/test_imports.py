"""Import rules: rooms import one way; plugins use streamkit's public names and nothing of each other."""

import ast
import builtins
import functools
import importlib.metadata
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
    "restart_delay": set(),
    "output": {"settings"},
    "geometry": set(),
    "errors": {"masking"},
    "flow": {"masking", "errors", "geometry"},
    "handoff": {"masking", "errors"},
    "crossing": {"masking", "errors", "flow"},
    "element": {"masking", "errors", "flow", "handoff", "settings", "output"},
    "elements": {"masking", "errors", "flow", "element", "handoff"},
    "graph": {"masking", "errors", "flow", "element", "handoff", "crossing", "output", "restart_delay"},
    "testing": {"masking", "errors", "flow", "element", "graph"},
    "reader": {"masking", "errors", "flow", "element", "graph", "output"},
    "service": {"masking", "errors", "flow", "graph", "handoff", "restart_delay"},
    "__main__": {"cli"},
    "cli": {"masking", "errors", "flow", "element", "graph", "service", "handoff", "output"},
}
MODULES = {"masking", "errors", "settings", "restart_delay", "reader", "__main__"}  # rooms of one module
# Rooms of the engine that are libraries: they know no frame, caps or element, and everybody may use them.
ENGINE_LIBRARIES = (
    "streamkit.geometry",
    "streamkit.handoff",
    "streamkit.output",
    "streamkit.settings",
    "streamkit.errors",
    "streamkit.masking",
)
# What plugins share that needs nothing of the engine.
LIBRARIES = {"streamkit_kernels", "streamkit_telemetry_formats"}
# Plugins that carry frames into and out of the process: all they do is turn frames into bytes and back.
CARRIERS = {"streamkit_fleet", "streamkit_media", "streamkit_tracks", "streamkit_view", "streamkit_zenoh"}
# The page receives what zenohsink publishes, by the same code as any other receiver.
STANDS_ON = {"streamkit_view": {"streamkit_zenoh"}}
COMPUTES = {"cv2", "numba", "pywt", "scipy"}
BASES = {"Combine", "Element", "Sink", "Source", "Split", "Transform"}
# Algorithms that need the engine all the same; a new module does not belong here.
EXCEPTIONS = {
    "streamkit_stitcher.live_mosaic",
    "streamkit_stitcher.mosaic_pad",
}
PLUGIN_NAMES = {path.name for path in PLUGINS.iterdir() if (path / "__init__.py").exists()}


@functools.cache
def imports(path: Path) -> tuple[tuple[str, str, int], ...]:
    """Module, name and line of every import of a file, wherever in it; name is "" for `import module`."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))):
        if isinstance(node, ast.Import):
            found += [(alias.name, "", node.lineno) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import; write the whole name"
            found += [(node.module or "", alias.name, node.lineno) for alias in node.names]
    return tuple(found)


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


def test_every_room_of_the_engine_has_an_import_rule() -> None:
    """Every folder and module of the engine is listed in ALLOWED."""
    rooms = {path.name for path in ENGINE.iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert rooms | MODULES == set(ALLOWED)
    assert {path.name for path in ENGINE.glob("*.py")} == {"__init__.py", *(f"{name}.py" for name in MODULES)}


def test_the_engine_imports_no_plugin() -> None:
    """The engine finds elements through entry points only."""
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


def test_shared_libraries_import_neither_engine_nor_plugins() -> None:
    """Modules shared by plugins work without the engine."""
    ours = {"streamkit"} | PLUGIN_NAMES
    wrong = [
        f"{path.relative_to(ROOT)}:{line}: {module}"
        for library in LIBRARIES
        for path in sorted((PLUGINS / library).rglob("*.py"))
        for module, name, line in imports(path)
        if module.split(".")[0] in ours - {library} and not is_library(module, name)
    ]
    assert not wrong


def test_no_plugin_imports_another() -> None:
    """Plugins exchange results as frame metadata."""
    wrong = [
        f"{path.relative_to(ROOT)}:{line}: {module}"
        for path in plugin_files()
        for module, _, line in imports(path)
        if module.split(".")[0] in PLUGIN_NAMES - LIBRARIES - allowed_for(path.relative_to(PLUGINS).parts[0])
    ]
    assert not wrong


def allowed_for(plugin: str) -> set[str]:
    """The plugin itself, and what it stands on."""
    return {plugin} | STANDS_ON.get(plugin, set())


def is_library(module: str, name: str = "") -> bool:
    """Whether a module or public name needs nothing of the engine; `Choice` is a plain enumeration."""
    home = getattr(getattr(streamkit, name), "__module__", "") if module == "streamkit" and name else module
    return home.startswith(ENGINE_LIBRARIES) or name == "Choice"


@functools.cache
def front_modules() -> set[str]:
    """The modules of elements and commands, which entry points name, and of the elements' base classes."""
    entries = importlib.metadata.distribution("streamkit").entry_points
    named = {
        entry.value.partition(":")[0]
        for group in (GROUP, "streamkit.commands")
        for entry in entries.select(group=group)
    }
    return named | {module_name(path, PLUGINS) for path in plugin_files() if declares_element(path)}


def declares_element(path: Path) -> bool:
    """Whether a class in a file is derived from a base class of elements."""
    classes = [
        node for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.ClassDef)
    ]
    return any(isinstance(base, ast.Name) and base.id in BASES for node in classes for base in node.bases)


def is_algorithm(path: Path) -> bool:
    """Whether a module computes: all but elements and commands; in a carrier, those that import numerics."""
    if module_name(path, PLUGINS) in front_modules():
        return False
    return path.relative_to(PLUGINS).parts[0] not in CARRIERS or any(
        module.split(".")[0] in COMPUTES for module, _, _ in imports(path)
    )


def needed_by(path: Path) -> set[str]:
    """The modules that a file imports, written in either way; libraries of the engine are left out."""
    return {
        needed
        for module, name, _ in imports(path)
        if not is_library(module, name)
        for needed in (module, f"{module}.{name}")
    }


def test_algorithms_do_not_import_the_engine() -> None:
    """An algorithm imports no frame, caps or element, also not indirectly: see `is_algorithm`."""
    needs = {module_name(path, PLUGINS): needed_by(path) for path in plugin_files()}
    bound = {
        name for name, needed in needs.items() if any(part.split(".")[0] == "streamkit" for part in needed)
    }
    while more := {name for name, needed in needs.items() if needed & bound} - bound:
        bound |= more
    assert bound & {module_name(path, PLUGINS) for path in plugin_files() if is_algorithm(path)} == EXCEPTIONS


def test_algorithms_import_no_element() -> None:
    """Elements import algorithms, never the other way round."""
    fronts = front_modules()
    wrong = {
        module_name(path, PLUGINS): needed_by(path) & fronts
        for path in plugin_files()
        if is_algorithm(path) and path.name != "__init__.py"
    }
    assert {name: needed for name, needed in wrong.items() if needed} == {}


def test_public_names_resolve() -> None:
    """Each public name is found, and is the same object every time."""
    assert len(streamkit.__all__) == len(set(streamkit.__all__))
    for name in streamkit.__all__:
        assert getattr(streamkit, name) is getattr(streamkit, name)
    assert set(streamkit.__all__) <= set(dir(streamkit))
    assert not set(streamkit.__all__) & set(dir(builtins)), "import * would replace these"
    with pytest.raises(AttributeError, match="module 'streamkit' has no attribute 'Nothing'"):
        streamkit.Nothing  # noqa: B018
