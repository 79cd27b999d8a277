"""Files of a graph: none is both read and written, and none is written twice."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations
from os.path import exists  # unlike Path's, False where a name is too long or a folder is closed
from pathlib import Path
from typing import TYPE_CHECKING

from streamkit.element.base import Element
from streamkit.element.property_owner import check_attributes
from streamkit.errors import PropertyError
from streamkit.output.file import is_special
from streamkit.output.names import FileNames, is_network, local_path

if TYPE_CHECKING:
    from streamkit.graph.graph import Graph


@dataclass(frozen=True, slots=True)
class FileOfElement:
    """A file that a property names."""

    element: Element
    location: str
    is_written: bool

    def is_same(self, other: FileOfElement) -> bool:
        """Whether both name one file: by path, through links, or by a number's or time's place."""
        mine, its = local_path(self.location), local_path(other.location)
        if exists(mine) and exists(its):
            return mine.samefile(its)
        my_names, its_names = FileNames(self.location), FileNames(other.location)
        return my_names.matches(its_names.path(0, 0)) or its_names.matches(my_names.path(0, 0))


def check_files(graph: Graph) -> None:
    """Checks the properties of elements, and the files they name.

    Raises:
        FileConflict: an element refuses its properties, a file that it writes is also that of another, or it
            may write none.
    """
    for element in list(graph.elements):
        try:
            check_attributes(element)
            element.check_properties()
        except PropertyError as error:
            raise FileConflict(element, str(error)) from error
    files = list(named_files(list(graph.elements)))
    for file in files:
        home = graph.homes.get(file.element)
        if file.is_written and home is not None and home.sandbox:
            name = file.element.name
            rule = "a bin with sandbox=true writes no file"
            raise FileConflict(file.element, f"location={file.location}: {rule}; put {name} outside of it")
    for first, second in combinations(files, 2):
        writer, other = (second, first) if second.is_written else (first, second)
        if writer.is_written and writer.element is not other.element and writer.is_same(other):
            verb = "written" if other.is_written else "read"
            raise FileConflict(
                writer.element,
                f"{writer.element.name} must not write {writer.location}: it is {verb} by "
                f"{other.element.name} (location={other.location}); name another file",
            )


def user_of(file: Path, elements: Iterable[Element]) -> str:
    """Name of the element that reads or writes a file; "" if none does."""
    for known in named_files(elements):
        if known.is_same(FileOfElement(known.element, str(file), is_written=True)):
            return known.element.name
    return ""


class FileConflict(PropertyError):
    """A file that an element must not write; names the element."""

    def __init__(self, element: Element, text: str) -> None:
        super().__init__(text)
        self.element = element


def named_files(elements: Iterable[Element]) -> Iterator[FileOfElement]:
    """The files that properties of elements name, but for devices, pipes and URLs."""
    for element in elements:
        for declaration in element.properties.values():
            location = vars(element).get(declaration.attribute) if declaration.file else None
            if location and not is_network(location) and not is_special(Path(location)):
                yield FileOfElement(element, location, declaration.file == "write")
