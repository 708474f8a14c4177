"""Prints docs/reference/python.md: what the module `harmzone` offers, of its sources and stubs.

Usage: python_reference.py > docs/reference/python.md
"""

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent / "python" / "harmzone"
Documented = ast.Module | ast.ClassDef | ast.FunctionDef


def main() -> None:
    """Prints the page."""
    print(page(), end="")


def page() -> str:
    """All public names, by the order of `__all__`."""
    front = ast.parse((PACKAGE / "__init__.py").read_text())
    # The stub comes last: what a module wraps is told by the module.
    files = [*sorted(PACKAGE.glob("_[a-z]*.py")), PACKAGE / "_native.pyi"]
    places: dict[str, Documented] = {}
    for file in files:
        for node in ast.parse(file.read_text()).body:
            if isinstance(node, (ast.ClassDef, ast.FunctionDef)):
                places.setdefault(node.name, node)
    out = ["# The module harmzone", "", *_doc(front), "Of its sources and stubs, by `make reference`.", ""]
    for name in _exported(front):
        if name in places:
            out += _entry(places[name])
    return "\n".join(out).rstrip() + "\n"


def _exported(front: ast.Module) -> list[str]:
    for node in front.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return ast.literal_eval(node.value)
    raise ValueError("the package has no __all__")


def _entry(node: Documented) -> Iterator[str]:
    if isinstance(node, ast.FunctionDef):
        yield from (f"## {node.name}", "", *_signature(node), *_doc(node))
        return
    assert isinstance(node, ast.ClassDef)
    yield from (f"## {node.name}", "", *_doc(node))
    for inner in node.body:
        if isinstance(inner, ast.AnnAssign):
            yield from (f"- `{ast.unparse(inner)}`", "")
        if isinstance(inner, ast.FunctionDef) and (
            not inner.name.startswith("_") or inner.name in ("__new__", "__init__")
        ):
            yield from (f"### {node.name}.{inner.name.strip('_')}", "", *_signature(inner), *_doc(inner))


def _signature(node: ast.FunctionDef) -> list[str]:
    returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    is_property = any(ast.unparse(name) == "property" for name in node.decorator_list)
    text = f"{node.name}{returns}" if is_property else f"{node.name}({ast.unparse(node.args)}){returns}"
    return ["```python", text, "```", ""]


def _doc(node: Documented) -> list[str]:
    return [*(ast.get_docstring(node) or "").splitlines(), ""]


if __name__ == "__main__":
    main()
