"""Imports point one way: a room imports only rooms above it in this list, and nobody imports the command line."""

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

# Lowest first: values, the model, forward in time, logs without a model, closed forms, what follows from the
# nonlinear model, the fit, the report, the command line. A new room gets a place here; a folder stands for its files.
ROOMS = """
errors quantities quantiles level speeds typical signal outcome telling examples
effects base composition chain model scene
wide native mapped compiled dop853 tableaus drive modes situated crossing resting scales methods stepping bursts
stepper plan machine phases
samples averaging trajectory initial admission
quasistatic_collocation quasistatic_balance quasistatic_phases quasistatic_trajectory quasistatic simulate
heap noise pooling zigzag local_fits waveform slips segment strokes classical suspicions sharpness slip_quality
judgement draft
bracket twofold dual slip_slopes steady ageing amplitude groups jump critical stability limits tested spread
drawn scatter stated pairs calculable choice price selection_numbers comparison form_slopes
sliding glide_steps glide hold cycle orbit course trace branch prospect sensitivity chance remedy outlook_words
outlook advice sureness
axes outline plane crossings flood chart continuation mapping chart_closed chart_spread chart_data
guess harmonics passage loads lanes steadiness onset_places slide_parts following one_way gaps parting
partly_read counted_twice scene_records
reageing block_equations blocks features
unknowns cutting manner window prepare rhythms vibration placing first_onsets
layout start collector rest_parts footing lay_out relaid compression pattern shooting trust
equilibrated reconstruct solve uncertainty hints influence coloured agreement warm bootstrap passes
discretisation levels sequence consistency leaning remembered gate accuracy combinations held asked profile_line
profile_side
attempt inward status_words events joining ranking starts search valleys profile widened shaken ridge_ends grouped
shares
allowed hanging letting_go agreeing fine_enough worth_a_walk examined certainty
fitted held_out taken_over nested weighing screening
selection_words compared_models selection suspects restraints diagnosis preview depth
findings second_look log_outlook creep worth log_document result_notes result identification
report
comparing
batch
cli
""".split()


def runtime_imports(path: Path) -> Iterator[str]:
    """Names of the modules a file imports, anywhere in it, but for those imported only for the type checker."""
    yield from _imports(ast.parse(path.read_text(encoding="utf-8")))


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


def test_identify_imports_point_up_the_list():
    assert wrong_imports(ROOT / "identify", ROOMS) == []


def test_the_list_has_no_room_that_is_gone():
    gone = [r for r in ROOMS if not (ROOT / "identify" / r).is_dir() and not (ROOT / "identify" / f"{r}.py").is_file()]
    assert gone == []


def test_data_io_knows_no_physics():
    for path in (ROOT / "data_io").rglob("*.py"):
        assert not [module for module in runtime_imports(path) if module.split(".")[0] == "identify"], path


def test_data_io_has_no_import_cycle():
    graph = {
        f"data_io.{path.stem}": {".".join(m.split(".")[:2]) for m in runtime_imports(path) if m.startswith("data_io.")}
        for path in (ROOT / "data_io").glob("*.py")
        if path.stem != "__init__"
    }
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(f"data_io imports in a circle: {error.args[1]}")


def test_nobody_imports_the_command_line():
    for path in [*(ROOT / "identify").rglob("*.py"), *(ROOT / "data_io").rglob("*.py")]:
        inside = path.relative_to(ROOT).parts
        if "cli" not in inside and inside != ("identify", "__main__.py"):
            assert not [module for module in runtime_imports(path) if module.startswith("identify.cli")], path


def test_an_import_that_points_down_is_seen(tmp_path):
    (tmp_path / "errors.py").write_text("def f():\n    from identify.scene import Scene\n")
    (tmp_path / "scene.py").write_text("from identify.errors import SceneError\n")
    (tmp_path / "attic.py").write_text("")
    complaints = wrong_imports(tmp_path, ROOMS)
    assert complaints == [
        "attic has no place in the list of rooms",
        "errors imports identify.scene.Scene, which stands below it",
    ]
