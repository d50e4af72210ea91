"""Completion in a shell: names of addresses, studies and patterns, and words with colons."""

import os
from collections.abc import Callable, Iterable

_VARIABLE = "_MINORLOOP_COMPLETE"
"""Set by the script of a shell that asks for completions."""
_before = ""
"""The part of the present word up to its last colon, which bash neither passes nor replaces."""


def one_of(names: Iterable[str] | Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Return the completion of an option that takes one of some names.

    ``names``: the names, or what returns them and is called only when a shell asks for completions.
    """

    def complete(incomplete: str) -> list[str]:
        known = names() if callable(names) else names
        found = [each for each in known if each.startswith(_before + incomplete)]
        return [each.removeprefix(_before) for each in found if each != _before]

    return complete


def addresses() -> list[str]:
    """Return the addresses of actuators; of a scheme with names of its own, what is before them."""
    from minorloop.connect import addresses

    return [each.removesuffix("NAME") for each in addresses()]


def join_words() -> None:
    """Undo in the environment how bash splits words such as ``--actuator=twin:ipmc``."""
    global _before
    _before = ""
    if os.environ.get(_VARIABLE) != "complete_bash":
        return
    words = os.environ.get("COMP_WORDS", "").split("\n")
    current = int(os.environ.get("COMP_CWORD", "0"))
    words += [""] * (current + 1 - len(words))
    joined = words[:1]
    for index in range(1, current + 1):
        word = words[index]
        if ":" in (word, words[index - 1]):
            joined[-1] += word
        elif word != "=" or index == current:
            joined.append(word)
    typed = "" if words[current] in (":", "=") else words[current]
    _before = joined.pop().removesuffix(typed).removesuffix("=")
    os.environ["COMP_WORDS"] = "\n".join([*joined, typed])
    os.environ["COMP_CWORD"] = str(len(joined))
