"""Arrays that a compiled kernel uses without counting its references to them.

Numba counts a reference wherever an array, or a tuple with one in it, is handed on, by an atomic addition;
in kernels that hand on the arrays of a batch for each craft that came to half of their time. Whoever borrows
an array keeps the one that owns the memory alive until the end: an argument of a kernel lives as long as the
call, and what a kernel makes for itself goes to :data:`keep` in its last line.
"""

from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


def _borrow(typingctx: Any, array: Any) -> Any:  # noqa: ARG001  # Numba's signature
    if not isinstance(array, types.Array):
        return None

    def codegen(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        struct = context.make_array(signature.args[0])(context, builder, value=values[0])
        struct.meminfo = cgutils.get_null_value(struct.meminfo.type)
        struct.parent = cgutils.get_null_value(struct.parent.type)
        return struct._getvalue()

    return array(array), codegen


def _keep(typingctx: Any, owners: Any) -> Any:  # noqa: ARG001  # Numba's signature
    def codegen(context: Any, *_: Any) -> Any:
        return context.get_dummy_value()

    return types.void(owners), codegen


#: ``borrow(array)`` in a kernel is the same array, whose references are not counted.
borrow: Any = intrinsic(_borrow)
#: ``keep(owners)`` does nothing with an array or a tuple of some, which therefore live until there.
keep: Any = intrinsic(_keep)
