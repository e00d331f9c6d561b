"""The house rules: a room imports only rooms below it, and of them only what they show; a module is a whole idea."""

import ast
import functools
import importlib
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import pdssjax

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "pdssjax"
STOREYS = """
core integration drive piezo friction actuator simulation metrics study inference sweeps selection design
report files explore cli
""".split()
"""Rooms, lowest first; each imports only rooms before it."""
FAMILIES = (
    *("drive", "piezo", "friction", "simulation.systems"),
    *("inference.losses", "inference.uncertainty.error_models"),
)
"""Folders whose members are known by their file."""
FACELESS = {"cli": set(), "core": {"lazy"}}
"""Modules that other rooms may import although no face shows them."""
HOMES = {
    "diffrax": {
        "integration.solver_names",
        "integration.step_methods.base",
        "integration.step_methods.diffrax_solver",
        "integration.taylor_solver",
    },
    "optimistix": {
        "integration.step_methods.diffrax_solver",
        "inference.solver.levenberg_marquardt",
        "inference.solver.iterations",
        "inference.solver.minimisers",
    },
    "matplotlib": {"report.figures", "core.presentation"},  # the latter the type alone
    "numpyro": {"inference.uncertainty.no_u_turn"},
    "pint": {"core.units"},
    "rich": {"cli.console"},
    "panel": {"explore.widgets"},
    "bokeh": {"explore.widgets"},
    "h5netcdf": set(),
}
"""The modules or folders that may import a heavy dependency."""
WHOLE = """
core integration drive piezo friction actuator simulation metrics study sweeps report inference
""".split()
"""Rooms whose modules each hold a whole idea."""
LEAST_IMPORTERS, LEAST_LINES = 2, 150
"""A module that is no member of a family has so many importers, or so many lines."""
METHODS = {
    "integration.solver_names",
    "integration.step_methods.picard",
    "inference.integrator_check",
    "inference.solver.derivative_check",
    "metrics.chain_convergence",
    "study.resonances",
}
"""Short and asked for once, but methods with a literature of their own: inside another file they would be hidden."""
MOST_LINES, MOST_OF_A_FUNCTION = 500, 80
"""Lines of a file and of a function at most, docstrings included."""
MODULES = sorted(PACKAGE.rglob("*.py"))
SCRIPTS = [p for name in ("pdssjax", "tests", "experiments", "benchmarks") for p in sorted((ROOT / name).rglob("*.py"))]


def dotted(path: Path) -> str:
    """The name of a module inside the package, such as "drive.step"; of a room, "drive"."""
    return ".".join(path.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__").removesuffix("__init__")


@functools.cache
def tree(path: Path) -> ast.Module:
    """The parsed source of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


@functools.cache
def imported(path: Path) -> list[tuple[str, list[str]]]:
    """What a file imports, at its top or within a function, in absolute terms: (module, names)."""
    package = path.relative_to(ROOT).parts[:-1]
    found = []
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            found += [(alias.name, []) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            origin = package[: len(package) + 1 - node.level] if node.level else ()
            module = ".".join((*origin, *([node.module] if node.module else [])))
            found.append((module, [alias.name for alias in node.names]))
    return found


def inside(path: Path) -> list[tuple[str, list[str]]]:
    """What a file imports of the package, by names inside it; the package itself is ""."""
    ours = [(module, names) for module, names in imported(path) if module.split(".")[0] == "pdssjax"]
    return [(module.removeprefix("pdssjax").lstrip("."), names) for module, names in ours]


def shown(room: str) -> set[str]:
    """What the face of a room re-exports."""
    return set(getattr(importlib.import_module(f"pdssjax.{room}"), "__all__", []))


def is_member(module: str) -> bool:
    """Whether a module, by its name inside the package, is a member of a family or its base."""
    family, _, name = module.rpartition(".")
    return family in FAMILIES and not name.startswith("_")


IN_ROOMS = [path for path in MODULES if dotted(path) not in ("", "__main__")]


def test_the_storeys_name_every_room():
    assert {dotted(path).split(".")[0] for path in IN_ROOMS} == set(STOREYS)


def test_a_room_imports_only_rooms_below_it():
    for path in IN_ROOMS:
        here = dotted(path).split(".")[0]
        for module, _ in inside(path):
            there = module.split(".")[0]
            if not module:
                assert here == "cli", f"{dotted(path)} imports pdssjax itself"
            else:
                assert there == here or STOREYS.index(there) < STOREYS.index(here), f"{dotted(path)} imports {module}"


def test_other_rooms_are_known_by_their_face_or_their_base():
    for path in IN_ROOMS:
        here = dotted(path).split(".")[0]
        for module, names in inside(path):
            there, *below = module.split(".")
            if not module or there == here or below == ["base"] or set(below) & FACELESS.get(there, set()):
                continue
            if is_member(module):
                continue
            face = ".".join([there, *below])
            assert not below or there == "report", f"{dotted(path)} imports {module}"
            assert set(names) <= shown(face), f"{dotted(path)} imports {sorted(set(names) - shown(face))} of {face}"


def test_faces_show_the_same_to_python_and_to_type_checkers():
    for path in (path for path in MODULES if path.name == "__init__.py"):
        told = [
            alias.name
            for node in tree(path).body
            if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
            for statement in node.body
            if isinstance(statement, ast.ImportFrom)
            for alias in statement.names
        ]
        module = importlib.import_module(f"pdssjax.{dotted(path)}".rstrip("."))
        assert sorted(told) == sorted(getattr(module, "__all__", [])), path
        for name in told:
            assert getattr(module, name) is not None


def test_no_module_has_the_name_of_what_its_package_exports():
    """Importing a module puts it into its package under its name, in place of a function of that name."""
    for room in ["", *STOREYS]:
        names = getattr(importlib.import_module(f"pdssjax.{room}".rstrip(".")), "__all__", [])
        modules = {path.stem for path in (PACKAGE / room).iterdir() if path.is_dir() or path.suffix == ".py"}
        assert not set(names) & modules


def test_modules_do_not_import_each_other_in_a_circle():
    needs = {dotted(path): set() for path in MODULES}
    for path in MODULES:
        if path.name != "__init__.py":
            for module, names in inside(path):
                wholes = {f"{module}.{name}".lstrip(".") for name in names}
                needs[dotted(path)] |= {
                    m
                    for m in {module, *wholes}
                    if m in needs and (PACKAGE / m.replace(".", "/")).with_suffix(".py").exists()
                }
    left = in_a_circle(needs)
    assert not left, f"in a circle, or above one: {sorted(left)}"


def in_a_circle(needs: dict[str, set[str]]) -> set[str]:
    """The modules that import each other in a circle, and those above one; `needs` tells what each imports."""
    left = dict(needs)
    while ready := [module for module, below in left.items() if not below & set(left)]:
        for module in ready:
            del left[module]
    return set(left)


def test_folders_of_a_room_do_not_import_each_other_in_a_circle():
    """A folder counts as a whole, but for the base of a family, which stands below what uses its members."""
    part = lambda module: module if module.endswith(".base") else ".".join(module.split(".")[:2])
    for room in STOREYS:
        needs: dict[str, set[str]] = {part(dotted(p)): set() for p in MODULES if dotted(p).startswith(f"{room}.")}
        for path in MODULES:
            here = part(dotted(path))
            if here in needs:
                needs[here] |= {part(module) for module, _ in inside(path)} & set(needs) - {here}
        left = in_a_circle(needs)
        assert not left, f"in a circle, or above one: {sorted(left)}"


def test_a_circle_is_found():
    assert in_a_circle({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": set()}) == {"a", "b", "c"}


def fragments(lines: dict[str, int], importers: dict[str, set[str]]) -> set[str]:
    """The modules that are neither imported by several others nor long."""
    few = {module for module in lines if len(importers.get(module, set()) - {module}) < LEAST_IMPORTERS}
    return {module for module in few if lines[module] < LEAST_LINES}


def importers_of_modules() -> dict[str, set[str]]:
    """By module, what imports it, itself or a name of it from a face."""
    homes = {
        dotted(path): {name: module for module, names in inside(path) for name in names}
        for path in MODULES
        if path.name == "__init__.py"
    }
    found: dict[str, set[str]] = {}
    for path in MODULES:
        here = dotted(path)
        for module, names in inside(path):
            if path.name == "__init__.py" and module.split(".")[0] == here.split(".")[0]:
                continue  # a face shows its own room, and uses nothing of it
            for name in names:
                found.setdefault(homes.get(module, {}).get(name, module), set()).add(here)
                found.setdefault(f"{module}.{name}".lstrip("."), set()).add(here)  # where the name is a module
    return found


def test_a_module_is_a_whole_idea():
    lines = {
        dotted(path): len(path.read_text(encoding="utf-8").splitlines())
        for path in MODULES
        if dotted(path).split(".")[0] in WHOLE
        and path.name != "__init__.py"
        and not is_member(dotted(path))
        and path.parent.name != "measurement"
    }
    importers = importers_of_modules()
    # Of one room and of another, which knows it by its face alone.
    assert {"study.comparison", "sweeps.sweeping"} <= importers["study.record"]
    assert not fragments(lines, importers) - METHODS


def test_a_fragment_is_found():
    lines = {"asked_once": 149, "asked_twice": 10, "long": 150, "never": 1}
    importers = {"asked_once": {"a", "asked_once"}, "asked_twice": {"a", "b"}, "long": {"a"}}
    assert fragments(lines, importers) == {"asked_once", "never"}


def of_folder(name: str) -> dict[str, Path]:
    """The modules of a folder beside the package, by name; a package by the folder's."""
    paths = sorted((ROOT / name).rglob("*.py"))
    return {".".join(p.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): p for p in paths}


@pytest.mark.parametrize("folder", ["benchmarks", "experiments"])
def test_scripts_do_not_import_each_other_in_a_circle(folder):
    modules = of_folder(folder)
    needs: dict[str, set[str]] = {}
    for name, path in modules.items():
        found = imported(path)
        needs[name] = {
            m for module, names in found for m in (module, *(f"{module}.{n}" for n in names)) if m in modules
        }
    left = in_a_circle(needs)
    assert not left, f"in a circle, or above one: {sorted(left)}"


@pytest.mark.parametrize("folder", ["benchmarks", "experiments"])
def test_scripts_know_the_package_by_its_faces_and_its_members(folder):
    for name, path in of_folder(folder).items():
        for module, names in inside(path):
            room, *below = module.split(".")
            if not module:
                known = set(pdssjax.__all__)
            elif is_member(module):
                known = set(names)
            else:
                assert not below, f"{name} imports pdssjax.{module}"
                known = shown(room)
            assert set(names) <= known, f"{name} imports {sorted(set(names) - known)} of pdssjax.{module}"


def test_tests_take_from_a_face_what_it_shows():
    for path in sorted((ROOT / "tests").rglob("*.py")):
        for module, names in inside(path):
            room, *below = module.split(".")
            if below and not is_member(module):
                assert not set(names) <= shown(room), f"{path.name} imports {names} of {module}, which {room} shows"


def test_what_the_package_shows_is_imported_from_itself():
    """The same object, not only its name: a measurement is called Effector, too."""
    for path in (path for path in SCRIPTS if PACKAGE not in path.parents):
        for module, names in inside(path):
            for name in set(names) & set(pdssjax.__all__) if module else ():
                found = getattr(importlib.import_module(f"pdssjax.{module}"), name)
                assert found is not getattr(pdssjax, name), f"{path.name} imports {name} from {module}"


def test_heavy_dependencies_stay_at_home():
    for dependency in HOMES:
        users = {dotted(path) for path in MODULES if dependency in {m.split(".")[0] for m, _ in imported(path)}}
        homes = HOMES[dependency]
        assert not {u for u in users if not any(u == home or u.startswith(f"{home}.") for home in homes)}, dependency


BY_PANEL = {"bokeh", "tornado"}
"""What the page takes from its libraries' own."""


def test_what_is_imported_is_declared_and_what_is_needed_is_imported():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    first_word = lambda dependency: re.match(r"[\w-]+", dependency)[0]
    needed = {first_word(dependency) for dependency in project["dependencies"]}
    optional = {first_word(name) for names in project["optional-dependencies"].values() for name in names}
    names = {module.split(".")[0] for path in MODULES for module, _ in imported(path)}
    libraries = names - sys.stdlib_module_names - {"pdssjax"}
    assert libraries <= needed | optional | BY_PANEL
    assert needed <= libraries


def test_files_and_functions_stay_short():
    for path in SCRIPTS:
        assert len(path.read_text(encoding="utf-8").splitlines()) < MOST_LINES, path
        for node in ast.walk(tree(path)) if PACKAGE in path.parents else ():
            if isinstance(node, ast.FunctionDef):
                assert node.end_lineno - node.lineno < MOST_OF_A_FUNCTION, f"{node.name} is too long"


def run(program: str) -> str:
    """What a `program` prints that starts in the root of the repository."""
    found = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert not found.returncode, found.stderr
    return found.stdout


def test_importing_loads_no_plots_no_units_and_changes_no_setting_of_jax():
    """And the root of the repository is all that experiments and benchmarks need to start, in the same process."""
    scripts = [
        f"{p.parent.name}.{p.stem}" for name in ("experiments", "benchmarks") for p in (ROOT / name).glob("[!_]*.py")
    ]
    assert len(scripts) > 20
    modules = [f"pdssjax.{dotted(path)}".rstrip(".") for path in MODULES if dotted(path) != "__main__"]
    names = [name for name in modules if not name.startswith("pdssjax.report.figures")]
    program = f"""
import importlib, sys
import jax
before = dict(jax.config.values)
for name in {names}:
    importlib.import_module(name)
changed = sorted(key for key, value in jax.config.values.items() if before.get(key, value) != value)
print(changed, sorted({{"matplotlib", "pint", "rich", "scipy.optimize", "scipy.stats"}} & set(sys.modules)))
for name in {scripts}:
    importlib.import_module(name)
"""
    assert run(program).split() == ["[]", "[]"]


@pytest.mark.parametrize("module", ["pdssjax", "pdssjax.cli.main"])
def test_the_package_and_the_command_line_are_there_before_jax_is_loaded(module):
    assert run(f"import sys, {module}; print('jax' in sys.modules)").strip() == "False"


def test_completion_shows_the_public_names():
    assert set(pdssjax.__all__) <= set(dir(pdssjax))
    assert {"load_study", "identify", "simulate", "sweep", "characterise", "Actuator", "Accuracy"} <= set(dir(pdssjax))
