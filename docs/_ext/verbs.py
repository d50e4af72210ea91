"""The command line's own help as a page: ``.. verbs:: minorloop`` lists every verb of a package."""

from __future__ import annotations

from typing import Any, ClassVar

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


def flat(group: Any) -> list[tuple[str, Any]]:
    """Return the verbs of a group by name, and those of groups in it by both names."""
    found = []
    for name, verb in group.commands.items():
        inner = [(f"{name} {each}", part) for each, part in flat(verb)] if _is_group(verb) else []
        found += inner or [(name, verb)]
    return found


def _is_group(verb: Any) -> bool:
    return hasattr(verb, "commands")


class Verbs(SphinxDirective):
    """A section for each verb, with its arguments and options as the command line has them."""

    required_arguments: ClassVar[int] = 1

    def run(self) -> list[nodes.Node]:
        import typer.main

        from minorloop.cli import app

        group: Any = typer.main.get_command(app)
        return [
            self.section(name, verb)
            for name, verb in flat(group)
            if verb.callback.__module__.split(".")[0] == self.arguments[0]
        ]

    def section(self, name: str, verb: Any) -> nodes.section:
        title = f"minorloop {name}"
        found = nodes.section(ids=[nodes.make_id(title)], names=[title])
        found += nodes.title("", "", nodes.literal("", title))
        found += nodes.paragraph("", verb.help.split("\n\n")[0].replace("\n", " "))
        items = nodes.definition_list(classes=["options"])
        for parameter in verb.params:
            items += self.item(parameter, verb)
        found += items
        return found

    def item(self, parameter: Any, verb: Any) -> nodes.definition_list_item:
        record = parameter.get_help_record(verb.make_context(verb.name, [], resilient_parsing=True))
        names, text = record or (parameter.name, parameter.help or "")
        term = nodes.term("", "", nodes.literal("", " ".join(names.split())))
        body = nodes.definition("", nodes.paragraph("", text))
        return nodes.definition_list_item("", term, body)


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_directive("verbs", Verbs)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
