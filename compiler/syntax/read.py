"""Table-driven parser: in each state the table gives the meaning of a word and the complete rule, and the builder makes the nodes.

One loop reads words, shifts and reduces. For a large file this is the longest stage, and it handles each word.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .errors import TooDeep
from .lex import BRACKET, NAMED, NEXT, NUMBER, SIGN, STRING, Accepted, goes_on, junction, refuse_hidden, signs_of
from .refused import Refused, Unreadable
from .table import END, ParserTable, Rule
from .word import Word, word_of

MAXIMUM_NESTING = 100  # brackets within brackets
_CLOSING = {"RPAR": False, "RSQB": False, "RBRACE": True}

Make = Callable[[list[Any]], Any]


class Reader:
    """Parser with a table. `builder` has a method for each rule that makes a node."""

    def __init__(self, table: ParserTable, builder: object) -> None:
        self.table = table
        self.fixed = signs_of(table.fixed)
        self.usual = {text: names[0] for text, names in self.fixed.items()}
        self.accepted: list[Accepted | None] = [None] * len(table.actions)
        self.reductions = [(rule.origin, rule.size, _maker(rule, builder)) for rule in table.rules]
        self.open: list[Word] = []  # brackets that are open

    def read(self, text: str, start: str, seen: list[Word] | None = None) -> Any:
        """Return the result of rule `start` for the text. `seen` collects its words. Raises `Unreadable` and `Refused`."""
        actions, follows, reductions = self.table.actions, self.table.follows, self.reductions
        accepted, usual, following = self.accepted, self.usual, NEXT.match
        state, complete = self.table.starts[start]
        states, values = [state], list[Any]()
        self.open = []
        position, length = 0, len(text)
        word = word_of(END, "", 0, 0)
        while True:
            # ---------------------------------------------------------- the next word
            found = following(text, position)
            assert found is not None
            begin = found.end(1)
            here = accepted[state] or self._accept(state)
            if begin > position and here.ends and text.find("\n", position, begin) >= 0 and self._ends(text, begin):
                kind = "_NL"
                word = word_of(kind, text[position:begin], position, begin)
                position = begin
            elif begin == length:
                kind = END
                word = word_of(END, "", word.start_pos, word.end_pos)
            else:
                index = found.lastindex or 1
                said, position = found[index], found.end()
                if index == NAMED:
                    kind = here.words.get(said) or ("NAME" if here.names or said not in usual else usual[said])
                elif index == SIGN:
                    kind = here.words.get(said) or usual.get(said, "COMPARE")
                elif index == NUMBER:
                    kind = "NUMBER"
                    if not here.numbers:
                        kind, position = junction(text, begin, position, here)
                        said = text[begin:position]
                elif index == STRING:
                    kind = "STRING"
                    refuse_hidden(text, begin, position)
                elif index == BRACKET:
                    kind = here.words.get(said) or usual[said]
                else:
                    raise Unreadable(begin, None, set(here.all), self.open)
                word = word_of(kind, said, begin, position)
                if index == BRACKET or kind == "NEST" or said == "{" or said == "}":
                    self._bracket(word)
            if seen is not None and kind != END:
                seen.append(word)
            # ---------------------------------------------------------- what it completes
            while (action := actions[state].get(kind)) is not None and action < 0:
                origin, size, make = reductions[~action]
                if make is None:  # the rule passes on its part
                    del states[-1]
                elif size:
                    values[-size:] = (make(values[-size:]),)
                    del states[-size:]
                else:
                    values.append(make([]))
                state = follows[states[-1]][origin]
                states.append(state)
                if state == complete and kind == END:
                    return values[-1]
            if action is None:
                raise Unreadable(word.start_pos, word, self._acceptable(states), self.open)
            state = action
            states.append(state)
            values.append(word)

    def _accept(self, state: int) -> Accepted:
        self.accepted[state] = found = Accepted(self.table.actions[state], self.fixed)
        return found

    def _ends(self, text: str, end: int) -> bool:
        """Return True if a line break before a place ends a statement: outside of ( ) and [ ]."""
        return not (self.open and self.open[-1].type != "LBRACE") and not goes_on(text, end)

    def _bracket(self, word: Word) -> None:
        closes = _CLOSING.get(word.type)
        if closes is None:
            self.open.append(word)
            if len(self.open) > MAXIMUM_NESTING:
                raise Refused(TooDeep, word.start_pos, word.end_pos, limit=MAXIMUM_NESTING)
        elif self.open and closes == (self.open[-1].type == "LBRACE"):
            self.open.pop()

    def _acceptable(self, states: list[int]) -> set[str]:
        """Terminals with which the text could continue. Some that complete a rule are left out, as they do not fit the text before."""
        return {kind for kind in self.table.actions[states[-1]] if self._fits(states[:], kind)}

    def _fits(self, states: list[int], kind: str) -> bool:
        while (action := self.table.actions[states[-1]].get(kind)) is not None and action < 0:
            rule = self.table.rules[~action]
            del states[len(states) - rule.size :]
            states.append(self.table.follows[states[-1]][rule.origin])
            if kind == END and states[-1] in (complete for _, complete in self.table.starts.values()):
                return True
        return action is not None


def _maker(rule: Rule, builder: object) -> Make | None:
    """Function that combines the parts of a rule; None if the rule only passes on its single part."""
    make: Make | None = (
        getattr(builder, rule.name) if rule.name and not (rule.single and not hasattr(builder, rule.name)) else None
    )
    taken = rule.taken
    if rule.single and rule.size == 1 and taken is None:
        return None
    if taken is None:
        return make or list
    if not rule.after and not any(opened or nones for _, opened, nones in taken):
        return _choosing([place for place, _, _ in taken], make, rule.single)
    return _shaping(taken, rule.after, make, rule.single)


def _choosing(places: list[int], make: Make | None, single: bool) -> Make:
    """Select some of the parts."""
    if len(places) == 1:
        (place,) = places
        if single:
            return lambda parts: parts[place]
        if make is None:
            return lambda parts: [parts[place]]
        return lambda parts: make([parts[place]])
    if make is None:
        return lambda parts: [parts[i] for i in places]
    return lambda parts: make([parts[i] for i in places])


def _shaping(taken: tuple[tuple[int, bool, int], ...], after: int, make: Make | None, single: bool) -> Make:
    """Open lists of parts, and insert None for missing optional parts."""

    def shaped(parts: list[Any]) -> Any:
        found: list[Any] = []
        for place, opened, nones in taken:
            if nones:
                found += [None] * nones
            if not opened:
                found.append(parts[place])
            elif found:
                found += parts[place]
            else:  # a list that grows at its end is not copied each time
                found = parts[place]
        if after:
            found += [None] * after
        if single and len(found) == 1:
            return found[0]
        return found if make is None else make(found)

    return shaped
