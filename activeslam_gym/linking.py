"""Kernels that call kernels compiled apart from them, perhaps by another process: by address, as a linker would.

What a kernel calls in the ordinary way is compiled into it. Two large kernels that call each other by an entry instead
can be compiled side by side.
"""

from __future__ import annotations

import hashlib
from typing import Any

from numba import config, typeof, types
from numba.core import cgutils
from numba.extending import intrinsic

NO_ENTRY = (0, 0)
"""In the place of an entry that is not used."""


def entry_of(kernel: Any, *arguments: Any) -> Any:
    """What `enter` needs in order to call ``kernel`` with ``arguments`` of these types; compiles it if need be.

    A pair of numbers that holds in this process and its forks: address, and fingerprint of the types.

    Raises:
        TypeError: ``kernel`` returns something.
    """
    if config.DISABLE_JIT:  # type: ignore[attr-defined]
        return kernel
    kinds = tuple(typeof(argument) for argument in arguments)
    kernel.compile(kinds)
    compiled = kernel.overloads[kinds]
    if compiled.signature.return_type != types.none:
        raise TypeError(
            f"kernel must return nothing, {compiled.fndesc.qualname} returns {compiled.signature.return_type}"
        )
    return compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name), _fingerprint(kinds)


def _fingerprint(kinds: tuple[types.Type, ...]) -> int:
    """A number (56 bits) by which a caller and what it calls agree on the types of the arguments."""
    return int.from_bytes(hashlib.sha256(str(kinds).encode()).digest()[:7], "little")


def enter(entry: Any, arguments: tuple[Any, ...]) -> None:
    """Call, in a kernel, the kernel that ``entry`` is of (see `entry_of`); it returns nothing.

    Raises:
        TypeError: ``arguments`` are not of the types that the entry was made for.
    """
    entry(*arguments)


if not config.DISABLE_JIT:  # type: ignore[attr-defined]

    @intrinsic  # type: ignore[no-redef]
    def enter(typing_context, entry, arguments):  # type: ignore[no-untyped-def]  # noqa: F811
        """As above: a call in Numba's own convention, so that what is raised there is raised here."""
        kinds = arguments.types

        def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
            address, fingerprint = cgutils.unpack_tuple(builder, values[0])
            convention = context.call_conv
            expected = context.get_constant(types.int64, _fingerprint(kinds))
            with builder.if_then(builder.icmp_signed("!=", fingerprint, expected), likely=False):
                message = "the entry was made for arguments of other types"
                convention.return_user_exc(builder, TypeError, (message,))
            called = builder.inttoptr(address, convention.get_function_type(types.none, kinds).as_pointer())
            passed = cgutils.unpack_tuple(builder, values[1])
            status, _ = convention.call_function(builder, called, types.none, kinds, passed)
            with builder.if_then(status.is_error, likely=False):
                convention.return_status_propagate(builder, status)
            return context.get_dummy_value()

        return types.none(entry, arguments), generate
