"""What the house measures: lines, files and rooms, and the counts by which a reader feels its complexity.

    python experiments/run_house.py            # a line a room, then the sums
    python experiments/run_house.py -v         # and the names behind each count
    python experiments/run_house.py -v studies report

What is counted, from the syntax of each file:

- private functions used once: a function or method `_name` that its file mentions once beside its definition (and no
  other file imports);
- constants: names bound to numbers, or tuples of numbers, at the top of a module;
- `Any`: lines that use the name, imports apart;
- many parameters: functions that take more than seven, `self` and `cls` apart;
- one importer: files that one other file of both packages imports.
"""

from __future__ import annotations

import argparse
import ast
from collections import Counter
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ESTIMATOR = ("estimation", "shooting", "simulation", "logs", "diagnosis", "uneven")
MANY = 7


@dataclass(frozen=True)
class House:
    """Counts of a set of files; each count but that of lines as the places counted, `file:line name`."""

    lines: int
    files: list[str]
    functions: list[str]
    used_once: list[str]
    constants: list[str]
    any_lines: list[str]
    many_parameters: list[str]
    one_importer: list[str]
    doubled_classes: list[str]

    def counts(self) -> dict[str, int]:
        """Each count by its name."""
        found = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: value if isinstance(value, int) else len(value) for name, value in found.items()}


def measured(files: list[Path], root: Path = ROOT, importers: Counter[str] | None = None) -> House:
    """The counts of these files of the packages under `root`; `importers` as `importers_of` counts them."""
    trees = {path: _tree(path) for path in files}
    imported = Counter(name for tree in trees.values() for name in _imported_names(tree))
    found: dict[str, list[str]] = {one.name: [] for one in fields(House) if one.name != "lines"}
    classes: dict[str, list[str]] = {}
    for path, tree in trees.items():
        file = path.relative_to(root).as_posix()
        found["files"].append(file)
        nodes = list(ast.walk(tree))
        uses = Counter(name for node in nodes if (name := _used_name(node)))
        for node in nodes:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                place = f"{file}:{node.lineno} {node.name}"
                found["functions"].append(place)
                private = node.name.startswith("_") and not node.name.endswith("__")
                if private and uses[node.name] + imported[node.name] == 1:
                    found["used_once"].append(place)
                if _parameters(node) > MANY:
                    found["many_parameters"].append(f"{place} ({_parameters(node)})")
        anys = {node.lineno for node in nodes if isinstance(node, ast.Name) and node.id == "Any"}
        found["any_lines"] += [f"{file}:{line}" for line in sorted(anys)]
        for statement in tree.body:
            found["constants"] += [f"{file}:{statement.lineno} {name}" for name in _numbers(statement)]
            if isinstance(statement, ast.ClassDef) and not statement.name.startswith("_"):
                classes.setdefault(statement.name, []).append(f"{file}:{statement.lineno}")
        if importers and importers[file.removesuffix(".py").replace("/", ".")] == 1:
            found["one_importer"].append(file)
    found["doubled_classes"] = [f"{name} {' '.join(at)}" for name, at in classes.items() if len(at) > 1]
    return House(sum(len(path.read_text("utf-8").splitlines()) for path in files), **found)


def importers_of(files: list[Path], root: Path = ROOT) -> Counter[str]:
    """How many of these files import each module of the packages under `root`, by its dotted name."""
    counted: Counter[str] = Counter()
    for path in files:
        modules: set[str] = set()
        for node in ast.walk(_tree(path)):
            if isinstance(node, ast.Import):
                modules |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                modules |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        counted.update(one for one in modules if (root / f"{one.replace('.', '/')}.py").is_file())
    return counted


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


def _imported_names(tree: ast.Module) -> set[str]:
    return {alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names}


def _used_name(node: ast.AST) -> str | None:
    if isinstance(node, ast.Name):
        return node.id
    return node.attr if isinstance(node, ast.Attribute) else None


def _parameters(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    taken = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    return len([one for one in taken if one.arg not in ("self", "cls")])


def _numbers(statement: ast.stmt) -> list[str]:
    """Names that a statement binds to numbers: `A = 1e-3`, `A, B = 2, 3`, `A = (1, 2.5)`, `A: float = 60 * 60`."""
    if not isinstance(statement, ast.Assign | ast.AnnAssign) or statement.value is None:
        return []
    if not _numeric(statement.value):
        return []
    targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
    return [node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)]


def _numeric(value: ast.expr) -> bool:
    if isinstance(value, ast.Constant):
        return type(value.value) in (int, float)
    if isinstance(value, ast.UnaryOp):
        return _numeric(value.operand)
    if isinstance(value, ast.BinOp):
        return _numeric(value.left) and _numeric(value.right)
    return isinstance(value, ast.Tuple) and bool(value.elts) and all(_numeric(part) for part in value.elts)


def rooms() -> dict[str, list[Path]]:
    """Files of each room: the folders of identify, the modules beside them, and data_io."""
    house = ROOT / "identify"
    found = {
        room.stem: sorted(room.rglob("*.py")) if room.is_dir() else [room]
        for room in sorted(house.iterdir())
        if room.suffix == ".py" or (room / "__init__.py").is_file()
    }
    beside = [path for name in ("__init__", "__main__") for path in found.pop(name)]
    return {**found, "(its door)": beside, "data_io": sorted((ROOT / "data_io").rglob("*.py"))}


def main(fast: bool = False, names: bool = False, only: tuple[str, ...] = ()) -> dict[str, House]:
    """Print a line a room, and the sums where `only` names no rooms, and give them back; fast: of two small rooms."""
    every = rooms()
    only = ("base", "scene") if fast else only
    by_room = {room: every[room] for room in only or every}
    counted_in = by_room if fast else every
    importers = importers_of([path for files in counted_in.values() for path in files])
    found = {room: measured(files, importers=importers) for room, files in by_room.items()}
    if not only:
        inside = [path for room, files in by_room.items() if room != "data_io" for path in files]
        estimator = [path for room in ESTIMATOR for path in by_room[room]]
        found["the estimator"] = measured(estimator, importers=importers)
        found["identify"] = measured(inside, importers=importers)
        print(f"rooms of identify: {len(by_room) - 2}\n")  # data_io and the door apart
    columns = [one.name for one in fields(House)]
    print("".join([f"{'':14}", *(f"{name.replace('_', ' '):>{len(name) + 2}}" for name in columns)]))
    for room, house in found.items():
        counts = house.counts()
        print("".join([f"{room:14}", *(f"{counts[name]:>{len(name) + 2},}" for name in columns)]))
    if names:
        for room in by_room:
            for name in columns[3:]:
                places = getattr(found[room], name)
                print(f"\n{room}, {name.replace('_', ' ')}: {len(places)}")
                print("".join(f"  {place}\n" for place in places), end="")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-v", "--names", action="store_true", help="name what is counted")
    parser.add_argument("rooms", nargs="*", help="only these rooms")
    given = parser.parse_args()
    main(names=given.names, only=tuple(given.rooms))
