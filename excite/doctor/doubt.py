"""What a mistake in a log leaves in doubt: quantities that effects of a diagnosis are told by."""

from __future__ import annotations

from enum import Enum


class Doubt(Enum):
    """A quantity that is known only about once a mistake was undone as far as the data tell, or not at all.

    A mistake says which it leaves in doubt, an effect which it is measured by; neither knows of the other.
    """

    POSITION = "where a joint's zero is"
    GRAVITY = "where gravity points"
    CLOCK = "how long a second of the stamps is"
    DELAY = "how late forces are beside positions"
    SIZE = "how large forces are"

    @property
    def of_bodies(self) -> bool:
        """Whether bodies that were taken as given would have to answer for it.

        Weights and inertias stand beside all of these but a delay: a zero that is some degrees off, gravity, clock
        or unit that are known about leave forces of the bodies' own kind everywhere, which a shift of a joint, a
        load or a gain is then called. Bodies that are identified along take them up.
        """
        return self is not Doubt.DELAY
