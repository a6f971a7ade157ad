"""Groups of things that are joined in pairs."""

from __future__ import annotations

from typing import TypeVar

Thing = TypeVar("Thing")


class Groups(dict[Thing, Thing]):
    """For each thing another of its group, nearer to the one that stands for the group, or that one itself."""

    def of(self, thing: Thing) -> Thing:
        """Return what stands for the group of a thing; a new thing is a group of its own."""
        above = self.setdefault(thing, thing)
        while above != self[above]:
            self[above] = self[self[above]]
            above = self[above]
        return above

    def join(self, thing: Thing, other: Thing) -> None:
        """Join the groups of two things: what stands for that of the other, stands for both."""
        self[self.of(thing)] = self.of(other)
