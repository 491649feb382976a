"""Imports point one way: a room imports only rooms above it in this list, and nobody imports the command line."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

# Lowest first: common ground, the model, what is done with it forward in time and with logs, what follows from it, the
# fit, its result, many fits, the page, the command line.
# A room is a folder, or one of the few modules beside the folders. A new one gets a place here and in docs/rooms.md.
ROOMS = """
base examples
effects model scene
simulation logs prediction
shooting estimation uneven diagnosis bench
report identification
studies
app
cli
""".split()

FOLDERS = [room for room in ROOMS if (ROOT / "identify" / room).is_dir()]


@cache
def runtime_imports(path: Path) -> tuple[str, ...]:
    """Names of the modules a file imports, anywhere in it, but for those imported only for the type checker."""
    return tuple(_imports(ast.parse(path.read_text(encoding="utf-8"))))


def _imports(node: ast.AST) -> Iterator[str]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
            continue
        if isinstance(child, ast.Import):
            yield from (alias.name for alias in child.names)
        elif isinstance(child, ast.ImportFrom):
            assert child.level == 0, f"a relative import in line {child.lineno}: write the full name"
            yield from (f"{child.module}.{alias.name}" for alias in child.names)
        else:
            yield from _imports(child)


def room_of(module: str) -> str | None:
    """identify.scene.values.Rig -> scene; None outside identify or for its door."""
    parts = module.split(".")
    return parts[1] if parts[0] == "identify" and len(parts) > 1 else None


def wrong_imports(package: Path, rooms: list[str]) -> list[str]:
    """Every import that points down the list, in words."""
    complaints = []
    for path in sorted(package.rglob("*.py")):
        inside = path.relative_to(package).with_suffix("").parts
        if inside[0] in ("__init__", "__main__"):
            continue
        room = inside[0]
        if room not in rooms:
            complaints.append(f"{room} has no place in the list of rooms")
            continue
        for module in runtime_imports(path):
            other = room_of(module)
            if other is not None and (other not in rooms or rooms.index(other) > rooms.index(room)):
                complaints.append(f"{'/'.join(inside)} imports {module}, which stands below it")
    return complaints


def circle(folder: Path, package: str) -> list[str] | None:
    """Modules of one folder that import each other in a circle; None where there is none."""
    depth = package.count(".") + 2
    graph = {
        f"{package}.{path.stem}": {
            ".".join(module.split(".")[:depth]) for module in runtime_imports(path) if module.startswith(f"{package}.")
        }
        for path in folder.glob("*.py")
        if path.stem != "__init__"
    }
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as error:
        return list(error.args[1])
    return None


def test_identify_imports_point_up_the_list():
    assert wrong_imports(ROOT / "identify", ROOMS) == []


@pytest.mark.parametrize("room", FOLDERS)
def test_no_folder_imports_in_a_circle(room):
    assert circle(ROOT / "identify" / room, f"identify.{room}") is None


def test_the_map_of_the_rooms_says_what_each_room_says_of_itself():
    page = (ROOT / "docs" / "rooms.md").read_text(encoding="utf-8")
    shown = dict(re.findall(r"^\|.*\| `([a-z_./]+)` \| (.+) \|$", page, re.MULTILINE))
    assert list(shown) == [f"{room}{'/' if room in FOLDERS else '.py'}" for room in ROOMS]
    for name, sentence in shown.items():
        path = ROOT / "identify" / (f"{name}__init__.py" if name.endswith("/") else name)
        said = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
        assert said is not None and said.splitlines()[0] == sentence, name


def test_data_io_knows_no_physics():
    for path in (ROOT / "data_io").rglob("*.py"):
        assert not [module for module in runtime_imports(path) if module.split(".")[0] == "identify"], path


def test_data_io_has_no_import_cycle():
    assert circle(ROOT / "data_io", "data_io") is None


def doubled_classes(*folders: Path) -> set[str]:
    """Names of public classes that stand in more than one file: one noun, one meaning."""
    files = [path for folder in folders for path in folder.rglob("*.py")]
    names = [name for path in files for name in set(re.findall(r"^class ([A-Z]\w*)", path.read_text("utf-8"), re.M))]
    return {name for name in names if names.count(name) > 1}


def test_every_class_name_means_one_thing(tmp_path):
    assert doubled_classes(ROOT / "identify", ROOT / "data_io") == set()
    for name in ("hen.py", "yard.py"):
        (tmp_path / name).write_text("class Egg:\n    pass\n\n\nclass _Shell:\n    pass\n")
    assert doubled_classes(tmp_path) == {"Egg"}


def test_an_import_that_points_down_is_seen(tmp_path):
    (tmp_path / "effects.py").write_text("def f():\n    from identify.scene import Scene\n")
    (tmp_path / "scene.py").write_text("from identify.base.errors import SceneError\n")
    (tmp_path / "attic").mkdir()
    (tmp_path / "attic" / "trunk.py").write_text("")
    complaints = wrong_imports(tmp_path, ROOMS)
    assert complaints == [
        "attic has no place in the list of rooms",
        "effects imports identify.scene.Scene, which stands below it",
    ]
