"""That no kernel is called from Python which has nothing there to call: it would end the process."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("drillenv", "controllers", "training", "benchmarks", "tests")
WITHOUT_WRAPPER = ("INNER", "INLINED", "ALLOCATING", "MERGED")


def decorators(function):
    return " ".join(ast.unparse(each) for each in function.decorator_list)


def modules():
    """Each module's dotted name with its syntax tree."""
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield ".".join(path.relative_to(ROOT).with_suffix("").parts), ast.parse(path.read_text(encoding="utf-8"))


def functions(tree):
    return [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]


def called_from_python(node, names, within=False):
    """Calls of ``names`` outside of compiled functions, as lines."""
    for child in ast.iter_child_nodes(node):
        compiled = within or (isinstance(child, ast.FunctionDef) and "jit" in decorators(child))
        if not compiled and isinstance(child, ast.Call) and isinstance(child.func, ast.Name) and child.func.id in names:
            yield child.lineno, child.func.id
        yield from called_from_python(child, names, compiled)


@pytest.mark.slow
def test_kernels_without_a_wrapper_are_called_by_kernels_only():
    trees = dict(modules())
    inner = {
        (module, each.name)
        for module, tree in trees.items()
        for each in functions(tree)
        if any(word in decorators(each) for word in WITHOUT_WRAPPER)
    }
    assert len(inner) > 100  # else the words above have changed
    wrong = []
    for module, tree in trees.items():
        names = {name for owner, name in inner if owner == module}
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom):
                names |= {each.asname or each.name for each in node.names if (node.module, each.name) in inner}
        wrong += [f"{module}, line {line}: {name}" for line, name in called_from_python(tree, names)]
    assert wrong == []
