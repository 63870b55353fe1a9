"""Limits on parsed files of users: types of values, sizes, nesting and characters."""

from __future__ import annotations

import re

from explicitfe.platform.errors import InputError, shortened

MOST_LEVELS = 32  # of tables and lists inside each other: schemas have six
LONGEST_KEY_CHARACTERS = 200
LONGEST_TEXT_CHARACTERS = 20_000  # of one value: a question of ten pages
LARGEST_WHOLE_NUMBER = 2**63 - 1  # in 64 bits, as TOML has it
# Not accepted in text: control characters except tab and line end, characters that change the direction of the following text
# (a terminal or a report would show a title in another order than it was written), surrogates and non-characters.
_NOT_TEXT = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]")


def check_plain(data: object, where: object) -> None:
    """Refuse what no key can mean, whatever its schema: see the constants above, and dates.

    Parameters
    ----------
    data : parsed TOML or JSON.
    where : begins the sentence, as text: the file, or the option.

    Raises
    ------
    InputError : with the key.
    """
    waiting: list[tuple[object, tuple[str, ...]]] = [(data, ())]
    while waiting:  # no recursion: what is checked may be nested deeply
        value, path = waiting.pop()
        if len(path) > MOST_LEVELS:
            raise _fault(where, path, f"tables and lists are nested more than {MOST_LEVELS} levels deep; remove some levels")
        if isinstance(value, dict):
            for key in value:
                _check_key(key, where, path)
            waiting += [(inner, (*path, key)) for key, inner in reversed(value.items())]
        elif isinstance(value, list):
            waiting += [(inner, (*path, str(number))) for number, inner in reversed(list(enumerate(value, 1)))]
        elif isinstance(value, str):
            _check_text(value, where, path)
        elif isinstance(value, int):
            if abs(value) > LARGEST_WHOLE_NUMBER:
                raise _fault(where, path, "the whole number has more than 64 bits; write fewer digits")
        elif value is not None and not isinstance(value, float):
            raise _fault(where, path, f"{value} is a date or a time, which no key accepts; put it in quotes if it is text")


def _check_key(key: str, where: object, path: tuple[str, ...]) -> None:
    if len(key) > LONGEST_KEY_CHARACTERS:
        raise _fault(where, path, f'the key "{shortened(key)}" is too long; the limit is {LONGEST_KEY_CHARACTERS} characters')
    if _NOT_TEXT.search(key):
        raise _fault(where, path, f"the key {key!a} contains a control character; remove it")


def _check_text(text: str, where: object, path: tuple[str, ...]) -> None:
    if len(text) > LONGEST_TEXT_CHARACTERS:
        raise _fault(where, path, f"the text has {len(text)} characters; the limit is {LONGEST_TEXT_CHARACTERS}")
    odd = _NOT_TEXT.search(text)
    if odd:
        raise _fault(where, path, f"character {odd.start() + 1} of the text is a control character, {odd[0]!a}; remove it")


def _fault(where: object, path: tuple[str, ...], sentence: str) -> InputError:
    place = f"{shortened('.'.join(path))}: " if path else ""
    return InputError(f"{where}: {place}{sentence}.")
