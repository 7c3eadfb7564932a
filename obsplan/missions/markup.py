"""Read XML that a stranger wrote: no document type, no entities, and bounds on depth and size."""

import io
from pathlib import Path
from typing import TYPE_CHECKING

from obsplan.types import ObsplanError

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_DEEPEST = 60  # elements within each other; mission files have about ten
_MOST = 1_000_000  # elements; several for each of 200 000 vertices


def parse_xml(content: bytes, path: Path) -> "Element":
    """Parse XML and give its root, tags without namespaces: many files have a wrong one, or none.

    Raises
    ------
    ObsplanError
        Not well-formed, too deep, too many elements, or with a document type or entities.
    """
    from xml.etree.ElementTree import ParseError

    from defusedxml.common import DefusedXmlException
    from defusedxml.ElementTree import iterparse

    bare = io.BytesIO(content.lstrip())  # scripts leave blanks before the declaration
    events = iterparse(bare, ("start", "end"), forbid_dtd=True)
    try:
        _, root = next(events)
        root.tag = root.tag.rpartition("}")[2]
        depth, count = 1, 1
        for event, element in events:
            if event == "end":
                depth -= 1
                continue
            depth, count = depth + 1, count + 1
            if depth > _DEEPEST:
                raise ObsplanError(f"{path} is nested too deeply to be a mission: export it again")
            if count > _MOST:
                raise ObsplanError(
                    f"{path} has more than {_MOST} elements: export the mission alone"
                )
            element.tag = element.tag.rpartition("}")[2]
    except DefusedXmlException as error:
        raise ObsplanError(
            f"{path} has a document type or entities, which are not read for safety: export it "
            "again without"
        ) from error
    except (ParseError, ValueError, LookupError) as error:  # the last two: encodings
        raise ObsplanError(
            f"{path} is not valid XML ({error}): it may be cut short, export it again"
        ) from error
    return root


def text_of(element: "Element", tag: str) -> str | None:
    """Text of the first child with a tag, blanks joined; None if there is none."""
    text = element.findtext(tag)
    return " ".join(text.split()) or None if text else None
