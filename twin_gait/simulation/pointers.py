"""Plain pointers for compiled code.

numba counts references to an array whenever a function is handed one; a pointer is a number. The caller
keeps the array alive.
"""

from __future__ import annotations

from typing import Any

from numba.core import types
from numba.extending import intrinsic
from numba.np.arrayobj import np_cfarray


def _pointer_to(kind: Any) -> Any:
    def typing(context: Any, address: Any) -> Any:
        def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

        return types.CPointer(kind)(types.intp), lower  # type: ignore[attr-defined]

    return intrinsic(typing)


# Pointer to the first element of an array, from its address.
float_pointer = _pointer_to(types.float64)
integer_pointer = _pointer_to(types.int64)


def _shifted(context: Any, pointer: Any, places: Any) -> Any:

    def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.gep(arguments[0], [arguments[1]])

    return pointer(pointer, types.intp), lower


# Pointer so many places further on.
shifted = intrinsic(_shifted)


def _array_at(context: Any, pointer: Any, shape: Any) -> Any:
    return types.Array(pointer.dtype, len(shape), "C")(pointer, shape), np_cfarray


# Array over numbers at a pointer; unlike numba's carray it may be made where no references are counted.
array_at = intrinsic(_array_at)
