"""Cache of the types that Numba infers for results of operators.

For each ``a + b`` Numba tries some thirty templates: for strings, lists, sets, arrays and numbers. A kernel has thousands of such
operations with few combinations of types; the cache reduces the time to compile by a seventh.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.types.functions import BaseFunction

_ANSWERS: dict[tuple[Any, Any], tuple[Any, Any]] = {}


@contextmanager
def type_operators_once() -> Iterator[None]:
    """Cache the types of results of operators within this context, which one thread enters at a time."""
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
