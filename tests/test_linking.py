"""Kernels enter kernels that were compiled apart from them, and nothing else than what they mean to."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import config

from activeslam_gym.compilation import kernel
from activeslam_gym.linking import NO_ENTRY, enter, entry_of


class Pair(NamedTuple):
    """Two arrays, as kernels take them."""

    left: np.ndarray
    right: np.ndarray


@kernel
def add_scaled(scale: float, pair: Pair, out: np.ndarray) -> None:
    """out += scale (left - right)."""
    if scale == 0.0:
        raise ValueError("nothing to add")
    for i in range(out.shape[0]):
        out[i] += scale * (pair.left[i] - pair.right[i])


@kernel
def add_twice(scale: float, pair: Pair, out: np.ndarray, entry: Any) -> None:
    """Enters `add_scaled` for the whole and for its second half."""
    enter(entry, (scale, pair, out))
    half = out.shape[0] // 2
    enter(entry, (scale, Pair(pair.left[half:], pair.right[half:]), out[half:]))


@kernel
def total(values: np.ndarray) -> float:
    """A kernel that returns something."""
    return values.sum()


def arguments(scale: float = 2.0) -> tuple[float, Pair, np.ndarray]:
    """Of both kernels."""
    return scale, Pair(np.arange(4.0), np.ones(4)), np.zeros(4)


def test_a_kernel_enters_another() -> None:
    with_these = arguments()
    add_twice(*with_these, entry_of(add_scaled, *with_these))
    np.testing.assert_array_equal(with_these[2], 2.0 * np.array([-1.0, 0.0, 2.0, 4.0]))


def test_an_error_comes_back() -> None:
    with pytest.raises(ValueError, match="nothing to add"):
        add_twice(*arguments(scale=0.0), entry_of(add_scaled, *arguments()))


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="types are Python's")  # type: ignore[attr-defined]
def test_an_entry_for_other_types_is_not_entered() -> None:
    scale, pair, out = arguments()
    for entry in (NO_ENTRY, entry_of(add_scaled, scale, pair, out.astype(np.float32))):
        with pytest.raises(TypeError, match="made for arguments of other types"):
            add_twice(scale, pair, out, entry)
    np.testing.assert_array_equal(out, 0.0)


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="types are Python's")  # type: ignore[attr-defined]
def test_a_kernel_that_returns_something_has_no_entry() -> None:
    with pytest.raises(TypeError, match="kernel must return nothing, total returns float64"):
        entry_of(total, np.ones(3))
