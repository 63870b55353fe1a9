"""Whether a mesh fits into memory: checked before it is built."""

from __future__ import annotations

from explicitfe.platform.errors import InputError
from explicitfe.platform.host.memory import available_bytes, in_words

# A larger mesh takes too long to compute; up to here every array of numbers can be indexed with 32 bits.
MOST_ELEMENTS = 5e6
# At the highest point, while a model is built: 4.1 kB with 300 000 elements, 5.0 kB with 70 000, in a tongue and in a specimen.
BUILDING_BYTES_PER_ELEMENT = 5e3


def check_size(elements: float, what: str, advice: str) -> None:
    """Refuse a mesh that is too large, in general or for the free memory of this machine.

    Parameters
    ----------
    elements : approximate number of elements.
    what : beginning of the message, such as "model: this specimen".
    advice : its end: what to change.

    Raises
    ------
    InputError : with the size of the mesh and the limit.
    """
    if not elements <= MOST_ELEMENTS:
        raise InputError(f"{what} would have about {elements:.2g} elements; at most {MOST_ELEMENTS:.0e} are possible; {advice}.")
    needed, available = elements * BUILDING_BYTES_PER_ELEMENT, available_bytes()
    if needed > available:
        raise InputError(
            f"{what} would have about {elements:.2g} elements and need {in_words(needed)} of memory, but only "
            f"{in_words(available)} are free; {advice}."
        )
