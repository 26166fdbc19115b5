"""For mkdocstrings: our docstrings say `name: meaning` in plain paragraphs, some with indented second lines.

Google's style would take such a paragraph for a box with a title; here its lines are joined to one margin before that.
Tables follow their introduction at once, where Markdown wants a blank line.
"""

import re

import griffe

_SECTIONS = {"Args", "Arguments", "Attributes", "Example", "Examples", "Raises", "Returns", "Yields", "Note", "Warning"}


class PlainFields(griffe.Extension):
    """Unindents what follows a line `name: meaning`, where name begins no section; sets tables apart."""

    def on_object(self, *, obj: griffe.Object, **_: object) -> None:
        if obj.docstring is not None:
            obj.docstring.value = plain(obj.docstring.value)


def plain(text: str) -> str:
    lines, joining = [], False
    for line in text.split("\n"):
        indented = line.startswith("    ")
        if joining and indented:
            line = line.strip()
        elif not indented:
            match = re.match(r"(\w[\w\s,-]*): \S", line)
            joining = match is not None and match[1] not in _SECTIONS
        if line.startswith("|") and lines and lines[-1] and not lines[-1].startswith("|"):
            lines.append("")
        lines.append(line)
    return "\n".join(lines)
