"""A batch is the same arrays with a leading axis: nested named tuples of arrays, seen by one row or all together."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numba import types
from numba.extending import overload

Tree = TypeVar("Tree", bound=tuple)


def batched(tree: Tree, count: int) -> Tree:
    """``count`` rows of zeros of everything in ``tree``, a nested named tuple of arrays."""
    return type(tree)(
        *(batched(x, count) if isinstance(x, tuple) else np.zeros((count, *x.shape), x.dtype) for x in tree)
    )


def row(tree, i):  # type: ignore[no-untyped-def]  # Numba compares the signature with the overload's
    """Row ``i`` of everything in ``tree``, as views; in kernels and outside."""
    return type(tree)(*(row(x, i) if isinstance(x, tuple) else x[i] for x in tree))


@overload(row)
def _row_in_kernels(tree, i):  # type: ignore[no-untyped-def]
    """Numba cannot loop over the fields of a named tuple, so write them out, as one would by hand.

    In one function: each call that hands on a tuple counts the references of all its arrays, which is slow to compile.
    """
    if not isinstance(tree, types.NamedTuple):
        return None
    lines: list[str] = []
    scope: dict[str, Any] = {}
    result = _write_row(tree, "tree", lines, scope)
    body = "".join(f"    {line}\n" for line in [*lines, f"return {result}"])
    exec(f"def row_in_kernels(tree, i):\n{body}", scope)
    return scope["row_in_kernels"]


def _write_row(kind: types.NamedTuple, name: str, lines: list[str], scope: dict[str, Any]) -> str:
    """Add the ``lines`` that make row i of the named tuple ``name``, and its class to ``scope``; the row's name."""
    fields = []
    for field, inner in zip(kind.fields, kind.types, strict=True):
        if isinstance(inner, types.NamedTuple):
            lines.append(f"{name}_{field} = {name}.{field}")
            fields.append(_write_row(inner, f"{name}_{field}", lines, scope))
        else:
            fields.append(f"{name}.{field}[i]")
    scope[f"{name}_class"] = kind.instance_class
    lines.append(f"{name}_row = {name}_class({', '.join(fields)})")
    return f"{name}_row"
