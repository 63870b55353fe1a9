"""Types of arithmetic that Numba has inferred once.

For each ``a + b`` Numba asks all that may know of a sum: of strings, lists, sets, arrays and numbers. For the same types the
answer is the same, and a kernel adds numbers and lanes some thousand times: asking once saves a seventh of the compilation.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.types.functions import BaseFunction

_ANSWERS: dict[tuple[Any, Any], tuple[Any, Any]] = {}


@contextmanager
def type_operators_once() -> Iterator[None]:
    """Remember the types of results of operators. To be entered by one thread at a time, as Numba compiles."""
    infer = BaseFunction.get_call_type

    def infer_once(self: Any, context: Any, args: Any, kws: Any) -> Any:
        if getattr(self.key[0], "__module__", None) != "_operator":
            return infer(self, context, args, kws)
        key = self.key[0], args
        if key not in _ANSWERS:
            signature = infer(self, context, args, kws)
            _ANSWERS[key] = signature, self._impl_keys[signature.args]
        signature, implementation = _ANSWERS[key]
        self._impl_keys[signature.args] = implementation
        return signature

    BaseFunction.get_call_type = infer_once
    try:
        yield
    finally:
        BaseFunction.get_call_type = infer
