"""Verbs that do not exist, and those that do the same."""

from __future__ import annotations

from typing import Any

from typer.core import TyperGroup

_MEANT = {
    "reduce": ("clean", "preprocess", "settle", "segment"),
    "identify": ("fit", "train", "learn", "calibrate", "model", "estimate"),
    "simulate": ("predict", "forward", "sim"),
    "score": ("validate", "evaluate", "test", "check", "compare"),
    "invert": ("inverse", "compensate", "solve"),
    "plan": ("design", "excite", "excitation"),
    "run": ("measure", "acquire", "record"),
    "drive": ("control", "track", "position", "move"),
    "resume": ("continue", "restart"),
    "runs": ("list", "ls", "show", "history"),
    "export": ("codegen", "compile", "deploy"),
    "fleet": ("batch", "many"),
    "study": ("reproduce", "paper", "benchmark"),
    "inspect": ("look", "defects", "pictures"),
    "head": ("wires",),
    "console": ("gui", "ui", "lab", "serve", "web"),
    "demo": ("example", "tutorial", "quickstart"),
    "--help": ("help",),
    "--version": ("version",),
}
MEANT = {name: verb for verb, names in _MEANT.items() for name in names}
"""The verb for each name that others give it."""


class Verbs(TyperGroup):
    """The verbs; an unknown name leads to a hint."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        name = args[0]
        if name in MEANT and name not in self.commands:
            ctx.fail(f"there is no command {name}; did you mean {MEANT[name]}?")
        return super().resolve_command(ctx, args)
