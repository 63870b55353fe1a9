"""Digits of numbers in messages."""

from __future__ import annotations

LEAST_DIGITS, MOST_DIGITS = 4, 17


def distinct(one: float, other: float) -> tuple[str, str]:
    """Two numbers with as many digits as show that they differ, and two digits of their difference where these suffice."""
    for digits in range(LEAST_DIGITS, MOST_DIGITS + 1):
        texts = f"{one:#.{digits}g}", f"{other:#.{digits}g}"
        if one == other or abs(float(texts[0]) - float(texts[1])) >= 10.0 ** (1 - digits) * max(abs(one), abs(other)):
            break
    return texts
