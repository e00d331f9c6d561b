"""The house rules: imports run one way, heavy dependencies have one home, importing changes nothing."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "pdssjax"

READING_ORDER = """
errors quantity rod family units columns tables series
drive hold waveforms oscillator piezo friction effector amplifier stage sensor actuator
expansion crossing stepping tangents integration modes stick_slip unloaded tribometer simulation
parameters records prediction residual metrics estimate study record_features starts guessing display
box_least_squares trust_region derivative_check ending levenberg_marquardt
uncertainty goodness resonances notes fitting start_failure best_point multistart
summary estimation
identified cycles characterise virtual_rig catalogue sweeping ranges
report plot plot_sweep output runtime signals console commands cli
""".split()
"""Modules and families; each may import only from those before it."""

HOMES = {
    "diffrax": {"expansion"},
    "optimistix": {"expansion", "levenberg_marquardt", "fitting"},
    "matplotlib": {"plot", "plot_sweep"},
    "pint": {"units"},
    "rich": {"console"},
}
"""The modules that may import a heavy dependency."""

MODULES = sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")
SCRIPTS = [p for name in ("pdssjax", "tests", "experiments", "benchmarks") for p in sorted((ROOT / name).rglob("*.py"))]


def dotted(path: Path) -> str:
    """The name of a module inside the package, such as "drive.step"; of a family, "drive"."""
    return ".".join(path.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__")


def imported(path: Path) -> set[str]:
    """Every module that a file imports, at its top or within a function, in absolute terms."""
    package = ("pdssjax", *path.relative_to(PACKAGE).parts[:-1])
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            origin = package[: len(package) + 1 - node.level] if node.level else ()
            found.add(".".join((*origin, *([node.module] if node.module else []))))
    return found


def own(path: Path) -> set[str]:
    """The modules of the package that a file imports, by their names inside it."""
    return {name.removeprefix("pdssjax.") for name in imported(path) if name.startswith("pdssjax.")}


def test_the_reading_order_names_every_module():
    assert {dotted(path).split(".")[0] for path in MODULES} == set(READING_ORDER)


@pytest.mark.parametrize("path", MODULES, ids=dotted)
def test_imports_point_upwards(path):
    here = dotted(path).split(".")[0]
    for name in own(path):
        there = name.split(".")[0]
        within_family = there == here and path.parent != PACKAGE
        assert within_family or READING_ORDER.index(there) < READING_ORDER.index(here), f"{here} imports {name}"


@pytest.mark.parametrize("path", MODULES, ids=dotted)
def test_members_of_families_are_known_by_their_interface_only(path):
    for name in own(path):
        assert "." not in name or name.endswith(".base"), f"{dotted(path)} imports the member {name}"


@pytest.mark.parametrize("dependency", HOMES)
def test_heavy_dependencies_stay_at_home(dependency):
    users = {dotted(path) for path in MODULES if dependency in {name.split(".")[0] for name in imported(path)}}
    assert users <= HOMES[dependency]


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_stay_short(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) < 350


def run(program: str) -> str:
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout


def test_importing_loads_no_plots_no_units_and_changes_no_setting_of_jax():
    names = [f"pdssjax.{dotted(path)}" for path in MODULES if not dotted(path).startswith("plot")]
    program = f"""
import importlib, sys
import jax
before = dict(jax.config.values)
for name in {names}:
    importlib.import_module(name)
changed = sorted(key for key, value in jax.config.values.items() if before.get(key, value) != value)
print(changed, sorted({{"matplotlib", "pint", "rich"}} & set(sys.modules)))
"""
    assert run(program).split() == ["[]", "[]"]


def test_the_command_line_is_there_before_jax_is_loaded():
    assert run("import sys, pdssjax.cli; print('jax' in sys.modules)").strip() == "False"
