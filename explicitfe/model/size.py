"""Whether a mesh can be held in the memory that there is: asked before it is built."""

from __future__ import annotations

from explicitfe.errors import InputError
from explicitfe.host.memory import available_bytes, in_words

# Nobody would wait for a larger mesh, and no array of its numbers is counted in more than 32 bits.
MOST_ELEMENTS = 5e6
# At the highest point, while a model is built: 4.1 kB with 300 000 elements, 5.0 kB with 70 000, in a tongue and in a specimen.
BUILDING_BYTES_PER_ELEMENT = 5e3


def check_size(elements: float, what: str, advice: str) -> None:
    """Refuse a mesh of about so many elements if it is too large for anybody, or for this machine now.

    Parameters
    ----------
    what : begins the sentence, such as "model: this specimen".
    advice : ends it: what to change.

    Raises
    ------
    InputError : says how large it would be, and what there is.
    """
    if not elements <= MOST_ELEMENTS:
        raise InputError(f"{what} would have about {elements:.2g} elements, and {MOST_ELEMENTS:.0e} are possible; {advice}.")
    needed, available = elements * BUILDING_BYTES_PER_ELEMENT, available_bytes()
    if needed > available:
        raise InputError(
            f"{what} would have about {elements:.2g} elements, which need {in_words(needed)} of memory, and "
            f"{in_words(available)} are free here; {advice}."
        )
