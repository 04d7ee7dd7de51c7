"""Files of data that scenarios name: found, read whole, known by their contents.

A setting of type `DataFile` is written as a path, or as a path with the digest that its contents
must have:

    file: loss.csv
    file: {path: loss.csv, sha256: 9f86d0…}

A path counts from the folder of the scenario file in which it stands, one of an override or of
Python from the working folder; where nothing is there, it names a file that comes with the
package. What is read goes along with the scenario wherever it is sent, and is in its hash by the
digest alone.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import BaseModel, GetCoreSchemaHandler, SerializationInfo
from pydantic_core import CoreSchema, core_schema

from iout_marl.errors import InputError, did_you_mean
from iout_marl.files import note_input, reason
from iout_marl.scenario.places import show_file, show_value
from iout_marl.scenario.sources import MAX_NAME, bundled_root, expanded, first_file, quoted

#: Folder of the bundled files of data, below the bundled scenarios.
DATA = "data"
#: Files that are larger are not read.
MAX_BYTES = 64 * 2**20
#: By this key, the context of a serialisation holds what writes the path of a file; None leaves
#: the path out.
PATH_OF = "path_of"
_SHA256 = "[0-9a-f]{64}"


class DataFile:
    """A file of data with its contents. Two are equal where their contents are.

    Attributes:
        path: where it was found, absolute; of a bundled file its name alone.
        contents: its bytes.
    """

    def __init__(self, path: str, contents: bytes) -> None:
        self.path = path
        self.contents = contents

    @classmethod
    def read(cls, path: str, beside: Path | None = None) -> DataFile:
        """Read a file.

        Args:
            path: as it is written: absolute, from the folder of `beside`, or a bundled file's.
            beside: the file that names it; None for the working folder.

        Raises:
            InputError: there is none, it cannot be read, or it is too large.
        """
        given = expanded(path)
        folder = beside.parent if beside else Path()
        bundled = bundled_root() / DATA
        found = first_file([folder / given, bundled / given]) if path else ""
        if not isinstance(found, Path):
            raise InputError(f"{path}: {found}" if found else _missing(path, folder, bundled))
        try:
            with found.open("rb") as file:
                note_input(file.fileno())
                contents = file.read(MAX_BYTES + 1)
        except OSError as error:
            raise InputError(f"{show_file(found)}: cannot be read: {reason(error)}") from None
        if len(contents) > MAX_BYTES:
            most = f"{MAX_BYTES // 2**20} MiB"
            raise InputError(f"{show_file(found)}: is larger than {most}; thin it out")
        place, root = found.resolve(), bundled.resolve()
        is_bundled = place.is_relative_to(root)
        return cls(place.relative_to(root).as_posix() if is_bundled else str(place), contents)

    @classmethod
    def from_value(cls, value: Any, beside: Path | None = None) -> DataFile:
        """What a scenario has written.

        Args:
            value: a path, `{path: …, sha256: …}`, or a file that was read.
            beside: the file in which it is written; None for the working folder.

        Raises:
            InputError: it is none of them, or as by `read`, or the contents are others.
        """
        if isinstance(value, cls):
            return value
        written = value if isinstance(value, Mapping) else {"path": value}
        path, digest = written.get("path"), written.get("sha256")
        if not isinstance(path, str) or not written.keys() <= {"path", "sha256"}:
            raise InputError(
                "must be the path of a file, or {path: …, sha256: …}, not " + show_value(value)
            )
        if digest is not None and not (isinstance(digest, str) and re.fullmatch(_SHA256, digest)):
            raise InputError(f"sha256: must be 64 hexadecimal digits, not {show_value(digest)}")
        file = cls.read(path, beside)
        if digest not in (None, file.sha256):
            raise InputError(
                f"{path}: has other contents than when this was written: its SHA-256 begins with "
                f"{file.sha256[:12]}, not {digest[:12]}"
            )
        return file

    @cached_property
    def sha256(self) -> str:
        """The digest of its contents, in hexadecimal."""
        return hashlib.sha256(self.contents).hexdigest()

    @property
    def name(self) -> str:
        """Its name, without a folder."""
        return Path(self.path).name

    @property
    def name_of_copy(self) -> str:
        """What a copy of it is called, which no other contents share; a copy of a copy the same."""
        mark = f"data-{self.sha256[:12]}-"
        return mark + self.name.removeprefix(mark)[-100:]

    def fault(self, message: str) -> InputError:
        """An error that names the file."""
        return InputError(f"{show_file(Path(self.path))}: {message}")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, DataFile) and self.sha256 == other.sha256

    def __hash__(self) -> int:
        return hash(self.sha256)

    def __repr__(self) -> str:
        return f"{self.path} (SHA-256 {self.sha256[:12]}…)"

    def __reduce__(self) -> tuple[Any, ...]:
        return DataFile, (self.path, self.contents)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(
            cls.from_value,
            serialization=core_schema.plain_serializer_function_ser_schema(
                cls._written, info_arg=True, when_used="json"
            ),
        )

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: Any, handler: Any) -> dict[str, Any]:
        digest = {"type": "string", "pattern": f"^{_SHA256}$"}
        path = {"type": "string", "format": "path"}
        mapping = {
            "type": "object",
            "properties": {"path": path, "sha256": digest},
            "required": ["path"],
            "additionalProperties": False,
        }
        return {"anyOf": [path, mapping]}

    def _written(self, info: SerializationInfo) -> dict[str, str]:
        write = (info.context or {}).get(PATH_OF, lambda file: file.path)
        return {**({"path": write(self)} if write else {}), "sha256": self.sha256}


def _missing(path: str, folder: Path, bundled: Path) -> str:
    """What is said of a file that there is not."""
    if not path:
        return "must be the path of a file, not an empty text"
    given = folder / expanded(path)
    try:
        known = [other.name for other in given.parent.iterdir() if other.is_file()]
    except (OSError, ValueError):
        known = []
    known += [other.name for other in bundled.glob("*.*")]
    near = did_you_mean(given.name[:MAX_NAME], known, or_list=False)
    return f"no file {quoted(path)} in {show_file(folder)}, nor among the bundled ones{near}"


def data_files(value: Any) -> Iterator[DataFile]:
    """All files of data in a scenario, or a section of it."""
    if isinstance(value, DataFile):
        yield value
        return
    inside: Iterable[Any] = ()
    if isinstance(value, BaseModel):
        inside = (getattr(value, name) for name in type(value).model_fields)
    elif isinstance(value, Mapping):
        inside = value.values()
    elif isinstance(value, tuple | list):
        inside = value
    for each in inside:
        yield from data_files(each)


#: Writes the path of a file.
PathOf = Callable[[DataFile], str]
