"""A batch is the same arrays with a leading axis: nested named tuples of arrays, seen by one row or all together."""

from __future__ import annotations

from typing import TypeVar

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
    """Numba cannot loop over the fields of a named tuple, so write them out, as one would by hand."""
    if not isinstance(tree, types.NamedTuple):
        return None
    fields = ", ".join(
        f"row(tree.{name}, i)" if isinstance(kind, types.NamedTuple) else f"tree.{name}[i]"
        for name, kind in zip(tree.fields, tree.types, strict=True)
    )
    scope = {"row": row, "Tree": tree.instance_class}
    exec(f"def row_in_kernels(tree, i):\n    return Tree({fields})", scope)
    return scope["row_in_kernels"]
