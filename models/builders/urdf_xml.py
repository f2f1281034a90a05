"""A URDF's XML as elements, within limits: entities that unfold, endless nesting and endless lists are refused at once."""

from __future__ import annotations

from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from truepose.bounded import MIB, read_at_most
from truepose.errors import InputError
from truepose.wording import cut

URDF_MOST: Final = 50 * MIB
"""Bytes of a URDF: 50 MiB; shapes stand in files of their own."""
DEPTH_MOST: Final = 100
"""Elements inside each other; a URDF has about six."""
ELEMENTS_MOST: Final = 500_000
"""Elements of a URDF; a humanoid's has a few thousand."""
TAG_MOST: Final = MIB
"""Bytes of one tag with its attributes: 1 MiB."""


class _Tree(ElementTree.TreeBuilder):
    """Elements as they come, counted."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path, self._depth, self._count = path, 0, 0

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        """Entities are declared there: they may stand for gigabytes, and for other files."""
        raise InputError(
            f"{self._path}: found <!DOCTYPE {cut(name, 40)}>, expected a URDF without a document type"
        )

    def start(self, tag: str, attrs: dict[str, str], /) -> ElementTree.Element:
        self._depth, self._count = self._depth + 1, self._count + 1
        if "/xacro}" in tag:
            raise InputError(
                f"{self._path}: found xacro (<xacro:{cut(tag.rpartition('}')[2], 40)}>), expected the URDF that is made of it: "
                "xacro robot.urdf.xacro > robot.urdf"
            )
        if self._depth > DEPTH_MOST:
            raise InputError(
                f"{self._path}: found more than {DEPTH_MOST} elements inside each other, expected a URDF"
            )
        if self._count > ELEMENTS_MOST:
            raise InputError(f"{self._path}: found more than {ELEMENTS_MOST} elements, expected at most that")
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ElementTree.Element:
        self._depth -= 1
        return super().end(tag)


def parse_own_xml(text: str) -> ElementTree.Element:
    """Return the root element of a text that truepose itself wrote. Raises ElementTree.ParseError for broken XML."""
    return ElementTree.fromstring(text)


def read_urdf(path: Path) -> ElementTree.Element:
    """Return the element ``robot``. Raises InputError for a missing file, broken XML, xacro, and what is beyond the limits."""
    try:
        data = read_at_most(path, URDF_MOST)
    except OSError as exc:
        raise InputError(f"{path}: cannot read the URDF: {exc.strerror or exc}") from None
    return parse_urdf(data, path)


def parse_urdf(data: bytes, path: Path) -> ElementTree.Element:
    """Return the element ``robot`` of what a file holds. Raises InputError as ``read_urdf``."""
    try:
        _check_tags(data, path)
        parser = ElementTree.XMLParser(target=_Tree(path))
        parser.feed(data)
        root: ElementTree.Element = parser.close()
    except (ElementTree.ParseError, ValueError, LookupError) as exc:
        raise InputError(f"{path}: cannot read the URDF: broken XML: {cut(str(exc))}") from None
    if root.tag != "robot":
        raise InputError(f"{path}: found <{cut(root.tag)}>, expected <robot>")
    return root


def _check_tags(data: bytes, path: Path) -> None:
    """Refuse a tag without end: one with a million attributes takes the parser longer than all the rest."""
    at = 0
    while at < len(data):
        end = data.find(b">", at)
        end = len(data) if end < 0 else end
        if end - at > TAG_MOST:
            raise InputError(
                f"{path}: cannot read the URDF: found a tag of more than {TAG_MOST // MIB} MiB, expected a URDF"
            )
        at = end + 1
