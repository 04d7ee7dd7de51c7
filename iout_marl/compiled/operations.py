"""What the source of compiled slots calls; it needs Numba."""

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import intrinsic

__all__ = ["larger", "select", "smaller"]


def _kind(typing: Any, *given: Any) -> Any:
    """The type of a result."""
    unliteral: Any = types.unliteral
    return typing.unify_types(*map(unliteral, given))


@intrinsic
def select(typing: Any, flag: Any, first: Any, second: Any) -> Any:
    """The first where the flag is set, else the second: without a branch."""
    kind = _kind(typing, first, second)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        flag, first, second = args
        first = context.cast(builder, first, signature.args[1], kind)
        second = context.cast(builder, second, signature.args[2], kind)
        bit = context.cast(builder, flag, signature.args[0], types.boolean)
        return builder.select(bit, first, second)

    return kind(flag, first, second), generate


def _of_two(sign: str) -> Any:
    """The first of two numbers where it compares so with the second, else the second."""

    def implementation(typing: Any, first: Any, second: Any) -> Any:
        kind = _kind(typing, first, second)

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            one, other = (
                context.cast(builder, value, own, kind)
                for value, own in zip(args, signature.args, strict=True)
            )
            if isinstance(kind, types.Float):
                bit = builder.fcmp_ordered(sign, one, other)
            else:
                bit = builder.icmp_signed(sign, one, other)
            return builder.select(bit, one, other)

        return kind(first, second), generate

    return implementation


larger = intrinsic(_of_two(">"))
smaller = intrinsic(_of_two("<"))
