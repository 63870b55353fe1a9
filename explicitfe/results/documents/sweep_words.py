"""Names of a sweep's columns as people read them: ``points.tip.up_mm`` is "tip: up", in mm."""

from __future__ import annotations

from collections.abc import Sequence

from explicitfe.results.documents.units_of_keys import words_and_unit

# What a measure is of: its first part -> how it is called, with the name of the place where it has one.
OWNERS = {
    "points": "{}",
    "grooves": "groove at the {}",
    "contact": "contact with the {}",
    "load": "load {}",
    "constriction": "constriction",
    "highest": "highest point",
    "body": "body",
    "palatogram": "palatogram",
    "leak": "leak",
    "airway": "airway",
}
# Tables of a scenario that stand for themselves: what is in them needs no owner.
PLAIN_TABLES = {"model", "analysis", "record"}
SPECIAL_WORDS = {"time to 90": "time to 90 % of the way", "min J": "smallest volume ratio J"}


def measure_in_words(name: str) -> tuple[str, str]:
    """A measure in words, and its unit."""
    *owners, last = name.split(".")
    words, unit = words_and_unit(last)
    words = SPECIAL_WORDS.get(words, words)
    if not owners:
        return words, unit
    owner = OWNERS.get(owners[0], owners[0])
    places = owners[1:]
    if "{}" in owner and places:
        owner = owner.format(places[0].replace("_", " "))
        places = places[1:]
    inner = " ".join(place.replace("_", " ") for place in places if place != "cells")
    return f"{owner}{f', {inner}' if inner else ''}: {words}", unit


def factors_in_words(keys: Sequence[str]) -> list[tuple[str, str]]:
    """Keys of a scenario in words, with their units; keys that would be called the same keep their names."""
    short = [_factor_in_words(key) for key in keys]
    words = [name for name, _ in short]
    return [(name if words.count(name) == 1 else key, unit) for key, (name, unit) in zip(keys, short, strict=True)]


def _factor_in_words(key: str) -> tuple[str, str]:
    *owners, last = key.split(".")
    words, unit = words_and_unit(last)
    owner = owners[-1] if owners and owners[-1] not in PLAIN_TABLES else ""
    return f"{owner.replace('_', ' ')} {words}".strip(), unit
