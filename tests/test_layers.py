"""Which module may import which: only those of its own layer or below, and never in a circle.

Imports are read from the source. Those under `if TYPE_CHECKING` are never executed, those under
`if __name__ == "__main__"` are of the command that a module also is; both are left out. Those
inside functions count, but for the few that are listed.
"""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
#: The lowest first. A package stands for all that is in it, unless that is named itself.
LAYERS = (
    # Nothing of the world.
    (
        "iout_marl.deprecated",
        "iout_marl.errors",
        "iout_marl.extras",
        "iout_marl.files",
        "iout_marl.inline",
        "iout_marl.machine",
        "iout_marl.outside",
        "iout_marl.registration",
        "iout_marl.signals",
        "iout_marl.startup",
        "iout_marl.terminal",
        "iout_marl.whole",
        "iout_marl.words",
    ),
    ("iout_marl.physics",),
    ("iout_marl.arrays",),
    ("iout_marl.registry", "iout_marl.scenario"),
    ("iout_marl.core",),
    ("iout_marl.parts",),
    ("iout_marl.metrics",),
    ("iout_marl.world",),
    ("iout_marl.tracing",),
    ("iout_marl.compiled",),
    # Pictures of a slot, which environments hand out.
    ("iout_marl.render",),
    ("iout_marl.envs", "iout_marl.iout_v0"),
    (
        "iout_marl.bounds",
        "iout_marl.breakdown",
        "iout_marl.trajectory",
        "iout_marl.evaluation",
        "iout_marl.mission",
        "iout_marl.outlook",
        "iout_marl.policies",
        "iout_marl.replay",
        "iout_marl.testing",
    ),
    # The names that the package offers.
    ("iout_marl",),
    ("trainers",),
    ("iout_marl.report", "iout_marl.study"),
    # A client of the library, which registers a report.
    ("iout_marl.paper",),
    ("iout_marl.__main__", "iout_marl.cli"),
)
#: Modules that are named by how they begin: `cli_bound` belongs to `cli`.
PREFIXES = {"iout_marl.cli_": "iout_marl.cli"}
#: Imports inside functions that lead upwards: a policy by its name may be a trained one, and
#: parts of a training are tested in one.
LATE = {
    ("iout_marl.testing.training", "trainers"),
    ("iout_marl.policies.loading", "trainers"),
    ("iout_marl.policies.loading", "trainers.runs.loading"),
    ("iout_marl.policies.named", "trainers.pretrained"),
}


def modules():
    """The source of every module, by its dotted name."""
    found = {}
    for package in ("iout_marl", "trainers"):
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            found[name] = path.read_text(encoding="utf-8")
    return found


def imports(source, known):
    """What of `known` a source imports: (module, whether at module level)."""
    found = set()

    def take(name, is_first):
        while name and name not in known:
            name = name.rpartition(".")[0]
        if name:
            found.add((name, is_first))

    def look(node, is_first):
        if isinstance(node, ast.If) and re.search("TYPE_CHECKING|__name__", ast.unparse(node.test)):
            for child in node.orelse:
                look(child, is_first)
            return
        if isinstance(node, ast.Import):
            for alias in node.names:
                take(alias.name, is_first)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports are not used here"
            for alias in node.names:
                take(f"{node.module}.{alias.name}", is_first)
        is_first = is_first and not isinstance(
            node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda
        )
        for child in ast.iter_child_nodes(node):
            look(child, is_first)

    look(ast.parse(source), True)
    return found


def layer(module):
    """The layer of a module, counted from 0."""
    for start, whole in PREFIXES.items():
        if module.startswith(start):
            module = whole
    name = module
    while True:
        for number, names in enumerate(LAYERS):
            # The package itself is one of the layers: what is in it names its own.
            if name in names and (name != "iout_marl" or module == name):
                return number
        assert "." in name, f"{module} has no layer"
        name = name.rpartition(".")[0]


def upward(graph):
    """Imports of a higher layer."""
    return {
        (module, other)
        for module, found in graph.items()
        for other, _ in found
        if layer(other) > layer(module)
    }


def circles(graph):
    """Modules that import themselves by way of others at module level, and what needs them."""
    first = {module: {o for o, is_first in found if is_first} for module, found in graph.items()}
    while leaves := [module for module, others in first.items() if not others & first.keys()]:
        for module in leaves:
            del first[module]
    return set(first)


@pytest.fixture(scope="module")
def graph():
    sources = modules()
    return {name: imports(source, sources) - {(name, True)} for name, source in sources.items()}


@pytest.mark.slow
def test_no_module_imports_a_higher_layer(graph):
    assert upward(graph) - LATE == set()


def test_late_imports_are_late(graph):
    """And still there: the list names no more than it must."""
    late = {(m, other) for m, found in graph.items() for other, is_first in found if not is_first}
    assert late >= LATE


def test_no_module_imports_itself_by_way_of_others(graph):
    assert circles(graph) == set()


def test_the_trainer_is_imported_only_where_it_is_needed(graph):
    """It takes torch along."""
    for module, found in graph.items():
        if not module.startswith("trainers"):
            first = {other.partition(".")[0] for other, is_first in found if is_first}
            assert "trainers" not in first, module


def test_the_paper_is_a_client_of_the_library(graph):
    """Nothing but the registry of reports knows of it, by its name."""
    for module, found in graph.items():
        if not module.startswith("iout_marl.paper"):
            assert not any(other.startswith("iout_marl.paper") for other, _ in found), module
    naming = {name for name, source in modules().items() if '"iout_marl.paper"' in source}
    assert naming == {"iout_marl.report.registry"}


def functions(source):
    """The functions of a module, without the underscore of those that are its own."""
    found = ast.parse(source).body
    return {node.name.lstrip("_") for node in found if isinstance(node, ast.FunctionDef)}


@pytest.mark.slow
def test_words_of_messages_and_tables_are_made_in_one_place():
    sources = modules()
    makers = {
        name: module
        for module in ("iout_marl.words", "iout_marl.errors")
        for name in functions(sources[module])
    }
    for module, source in sources.items():
        for name in functions(source) & makers.keys():
            assert makers[name] == module, f"{module} has a {name} of its own"


def test_every_layer_is_one():
    for names in LAYERS:
        for name in names:
            path = ROOT / name.replace(".", "/")
            assert path.is_dir() or path.with_suffix(".py").is_file(), name


def test_what_counts_as_an_import():
    source = """
from typing import TYPE_CHECKING
import iout_marl.files as files
from iout_marl import errors
from iout_marl.errors import InputError
if TYPE_CHECKING:
    from trainers import Trainer
if __name__ == "__main__":
    from iout_marl.words import main
def late():
    from trainers import train
try:
    import iout_marl.words
finally:
    pass
"""
    known = {"iout_marl", "iout_marl.errors", "iout_marl.files", "iout_marl.words", "trainers"}
    assert imports(source, known) == {
        ("iout_marl.errors", True),
        ("iout_marl.files", True),
        ("iout_marl.words", True),
        ("trainers", False),
    }


def test_faults_would_be_found():
    graph = {
        "iout_marl.world.world": {("iout_marl.cli_bound", False), ("iout_marl.parts", True)},
        "iout_marl.parts": {("iout_marl.world.world", True)},
        "iout_marl.cli_bound": {("iout_marl.world.world", True)},
    }
    assert upward(graph) == {
        ("iout_marl.world.world", "iout_marl.cli_bound"),
        ("iout_marl.parts", "iout_marl.world.world"),
    }
    assert {"iout_marl.world.world", "iout_marl.parts"} <= circles(graph)
    with pytest.raises(AssertionError, match="has no layer"):
        layer("iout_marl.elsewhere")
