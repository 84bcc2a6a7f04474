"""The arrows between rooms point one way, and importing wheelhop changes nothing global."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "src" / "wheelhop"

ALLOWED = {
    "filtering": set(),
    "vehicle": set(),
    "io": {"vehicle"},
    "estimators": {"filtering", "vehicle"},
    "evaluation": {"filtering", "vehicle", "estimators"},
    "identification": {"filtering", "vehicle", "estimators", "evaluation", "io"},
    "montecarlo": {"filtering", "vehicle", "estimators", "evaluation", "io"},
    "plots": {"filtering", "vehicle", "estimators", "evaluation", "identification", "montecarlo"},
}
ALLOWED["studies"] = {*ALLOWED, "plots", "io"}
ALLOWED["cli"] = {*ALLOWED, "studies"}

ROOMS = sorted(p.name for p in PACKAGE.iterdir() if p.is_dir() and p.name != "__pycache__")


def imported_rooms(file):
    """Rooms of wheelhop that a file imports, wherever in the file."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text())):
        names = []
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            names = [node.module] + [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        for name in names:
            parts = name.split(".")
            if parts[0] == "wheelhop" and len(parts) > 1 and parts[1] in ALLOWED:
                found.add(parts[1])
    return found


def test_every_room_is_known():
    assert set(ROOMS) <= set(ALLOWED)


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_imports_only_the_rooms_before_it(room):
    for file in (PACKAGE / room).rglob("*.py"):
        strangers = imported_rooms(file) - ALLOWED[room] - {room}
        assert not strangers, f"{file.relative_to(PACKAGE)} imports {strangers}"


def test_filtering_imports_nothing_else_of_wheelhop():
    for file in (PACKAGE / "filtering").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module.startswith("wheelhop"):
                assert node.module.startswith(("wheelhop.filtering", "wheelhop.staging")), file


def test_importing_everything_sets_no_jax_flag_and_starts_no_backend():
    code = """
import importlib, pkgutil, jax
before = dict(jax.config.values)
import wheelhop
for module in pkgutil.walk_packages(wheelhop.__path__, "wheelhop."):
    if module.name != "wheelhop.__main__":
        importlib.import_module(module.name)
changed = {k for k, v in jax.config.values.items() if before.get(k) != v}
assert not changed, changed
from jax._src import xla_bridge
assert not xla_bridge._backends, "an import ran a computation"
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
