"""Registries: what can be named in a file or on a command line, and who has brought it.

A registry holds the entries of one role, by their kinds. What comes with this package is
registered without a version; what scenarios name and comes from outside states one.
"""

from __future__ import annotations

import functools
import importlib
import inspect
import re
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from iout_marl.errors import InputError, did_you_mean
from iout_marl.whole import short

Item = TypeVar("Item", bound=Callable[..., Any])
Registered = TypeVar("Registered", bound=Callable[..., Any])

_WORD = re.compile(r"[a-z][a-z0-9_]*")
#: Modules whose entries are part of this package.
_OWN = ("iout_marl", "trainers")
#: Called with its role whenever an entry comes or goes.
on_change: list[Callable[[str], None]] = []
#: Every registry, by role.
_REGISTRIES: dict[str, Registry[Any]] = {}


@dataclass(frozen=True)
class Entry(Generic[Item]):
    """What is registered.

    Attributes:
        role: of what it is one.
        kind: how it is named.
        item: the class or the function.
        version: of what comes from outside; changes whenever the same settings would lead to
            other results. None for what comes with this package.
        module: where it was defined.
    """

    role: str
    kind: str
    item: Item
    version: int | str | None
    module: str

    @property
    def is_outside(self) -> bool:
        """Whether somebody else has brought it."""
        return self.version is not None or not is_own(self.module)

    def fault(self, message: str) -> InputError:
        """An error that says which entry is at fault."""
        return InputError(f"{self.role} {self.kind!r}: {message}")

    @contextmanager
    def blamed(self) -> Iterator[None]:
        """Says of what an entry from outside raises meanwhile that it has, and where.

        Raises:
            InputError: in its place.
        """
        if not self.is_outside:
            yield
            return
        with blamed(f"{self.role} {self.kind!r}", self.item):
            yield


@contextmanager
def blamed(name: str, item: Any) -> Iterator[None]:
    """Says of what an item from outside raises meanwhile that it has, and where.

    Args:
        name: what to call it.
        item: the class or the function.

    Raises:
        InputError: in place of other errors.
    """
    try:
        yield
    except (InputError, MemoryError):
        raise
    except Exception as error:
        lacking = _lacking(item, error)
        if lacking:
            raise InputError(f"{name}: must have {lacking}") from error
        where = _place_in(item, error)
        raise InputError(f"{name}: raises {type(error).__name__}: {error}{where}") from error


def _lacking(item: Any, error: Exception) -> str:
    """What a base class leaves to be written, where the error is that it is not there."""
    *_, (frame, _) = traceback.walk_tb(error.__traceback__)
    asked_by = frame.f_globals.get("__name__", "")
    if not inspect.isclass(item) or not is_own(asked_by):
        return ""
    if isinstance(error, NotImplementedError):
        name = frame.f_code.co_name
        return name if not str(error) and hasattr(item, name) else ""
    if not isinstance(error, AttributeError) or not isinstance(error.obj, item):
        return ""
    # But what the class of all parts declares is made by its methods.
    bases = [base for base in item.__mro__[1:] if is_own(base.__module__)][:-1]
    return next((n for base in bases for n in base.__annotations__ if n == error.name), "")


def is_own(module: str) -> bool:
    """Whether a module is part of this package."""
    return module.partition(".")[0] in _OWN


def _place_in(item: Any, error: BaseException) -> str:
    """The file and the line where an error has arisen, of the item's own file if it is there."""
    frames = list(traceback.extract_tb(error.__traceback__))
    try:
        own = inspect.getfile(item)
    except (OSError, TypeError):  # typed at a prompt
        own = ""
    frames = [frame for frame in frames if frame.filename == own] or frames
    return f" ({frames[-1].filename}:{frames[-1].lineno})"


class Registry(Generic[Item]):
    """The entries of one role.

    Args:
        role: of what they are: `reward`, say.
        base: the class that all of them extend; None where functions are registered.
        in_scenarios: whether scenarios name them. Entries from outside then state a version, and
            schemas follow what is registered.
    """

    def __init__(
        self, role: str, base: type[Any] | None = None, *, in_scenarios: bool = True
    ) -> None:
        self.role = role
        self.base = base
        self.in_scenarios = in_scenarios
        self._entries: dict[str, Entry[Item]] = {}
        #: What `base` leaves to be written by all that extend it.
        self.required = [
            name
            for of in (base.__mro__ if base is not None else ())
            for name, member in vars(of).items()
            if getattr(member, "__isabstractmethod__", False)
        ]
        _REGISTRIES[role] = self

    def register(
        self, kind: str, *, version: int | str | None = None
    ) -> Callable[[Registered], Registered]:
        """Decorates what is to be known as a kind.

        Args:
            kind: a word of lower-case letters, digits and underscores.
            version: a whole number or a text. What scenarios name and comes from outside of this
                package must state one, which is part of the hash of every scenario that names it.

        Raises:
            InputError: the kind is no word or taken, there is no version, or what is
                decorated is of another role or lacks what its base class leaves to be written.
        """

        def take(item: Registered) -> Registered:
            self._check(kind, version, item)
            module = getattr(item, "__module__", "") or ""
            self._entries[kind] = Entry(self.role, kind, item, version, module)  # type: ignore[arg-type]
            self._changed()
            return item

        return take

    def unregister(self, kind: str) -> None:
        """Forget a kind, which must be there."""
        del self._entries[kind]
        self._changed()

    def __getitem__(self, kind: str) -> Entry[Item]:
        """The entry of a kind.

        Raises:
            InputError: there is none.
        """
        if kind not in self._entries:
            near = did_you_mean(kind, self.kinds)
            raise InputError(f"unknown {self.role} {short(kind)}{near}")
        return self._entries[kind]

    def __contains__(self, kind: object) -> bool:
        return kind in self._entries

    def __iter__(self) -> Iterator[Entry[Item]]:
        return iter(self._entries.values())

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds, in the order in which they were registered."""
        return tuple(self._entries)

    def _check(self, kind: str, version: object, item: Any) -> None:
        name = getattr(item, "__qualname__", short(item))
        if not isinstance(kind, str) or not _WORD.fullmatch(kind):
            raise InputError(
                f"{self.role} {short(kind)}: a kind is a word of lower-case letters, digits and "
                "underscores"
            )
        if self.base is not None and not (inspect.isclass(item) and issubclass(item, self.base)):
            raise InputError(
                f"{self.role} {kind!r}: {name} must be a class that extends {self.base.__name__}"
            )
        other = self._entries.get(kind)
        # Of one name in one module it is the same, defined again: a notebook's cell, say.
        if other and (other.module, other.item.__qualname__) != (item.__module__, name):
            raise InputError(
                f"{self.role} {kind!r}: {item.__module__}.{name} has the name of "
                f"{other.module}.{other.item.__qualname__}: two parts of one kind"
            )
        if version is None and not is_own(item.__module__) and self.in_scenarios:
            raise InputError(
                f'{self.role} {kind!r}: {name} must state a version: register("{kind}", version=1)'
            )
        if version is not None and (
            isinstance(version, bool) or not isinstance(version, int | str)
        ):
            raise InputError(
                f"{self.role} {kind!r}: version must be a whole number or a text, "
                f"not {short(version)}"
            )
        lacking = [
            each
            for each in self.required
            if getattr(getattr(item, each), "__isabstractmethod__", False)
        ]
        if lacking:
            raise InputError(f"{self.role} {kind!r}: must have {', '.join(lacking)}")

    def _changed(self) -> None:
        for act in on_change if self.in_scenarios else ():
            act(self.role)


def registry_of(role: str) -> Registry[Any]:
    """The registry of a role, which must be one."""
    _load_built_in()
    return _REGISTRIES[role]


def registries() -> tuple[Registry[Any], ...]:
    """All of them."""
    _load_built_in()
    return tuple(_REGISTRIES.values())


@functools.cache
def _load_built_in() -> None:
    """Import the parts that come with the package: scenarios know them by their kinds alone."""
    importlib.import_module("iout_marl.parts")
