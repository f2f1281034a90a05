"""A URDF's XML as elements: a document type, whose entities may unfold to gigabytes, is refused at once."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from truepose.bounded import read_input
from truepose.errors import InputError
from truepose.wording import cut


class _Tree(ElementTree.TreeBuilder):
    """Elements as they come; a document type and xacro are refused."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        """Entities are declared there: they may stand for gigabytes, and for other files."""
        raise InputError(
            f"{self._path}: found <!DOCTYPE {cut(name, 40)}>, expected a URDF without a document type"
        )

    def start(self, tag: str, attrs: dict[str, str], /) -> ElementTree.Element:
        if "/xacro}" in tag:
            raise InputError(
                f"{self._path}: found xacro (<xacro:{cut(tag.rpartition('}')[2], 40)}>), expected the URDF that is made of it: "
                "xacro robot.urdf.xacro > robot.urdf"
            )
        return super().start(tag, attrs)


def parse_own_xml(text: str) -> ElementTree.Element:
    """Return the root element of a text that truepose itself wrote. Raises ElementTree.ParseError for broken XML."""
    return ElementTree.fromstring(text)


def read_urdf(path: Path) -> ElementTree.Element:
    """Return the element ``robot``. Raises InputError for a missing file, broken XML, and xacro."""
    try:
        data = read_input(path)
    except OSError as exc:
        raise InputError(f"{path}: cannot read the URDF: {exc.strerror or exc}") from None
    return parse_urdf(data, path)


def parse_urdf(data: bytes, path: Path) -> ElementTree.Element:
    """Return the element ``robot`` of what a file holds. Raises InputError as ``read_urdf``."""
    try:
        parser = ElementTree.XMLParser(target=_Tree(path))
        parser.feed(data)
        root: ElementTree.Element = parser.close()
    except (ElementTree.ParseError, ValueError, LookupError) as exc:
        raise InputError(f"{path}: cannot read the URDF: broken XML: {cut(str(exc))}") from None
    if root.tag != "robot":
        raise InputError(f"{path}: found <{cut(root.tag)}>, expected <robot>")
    return root
