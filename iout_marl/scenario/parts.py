"""Fields of a scenario that name a part: its settings are those of a registered kind.

A part's settings are written as a mapping with a `kind`, or, where there is nothing else to say, as
the kind alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar, Literal, get_args

from pydantic import (
    BaseModel,
    GetCoreSchemaHandler,
    PydanticUserError,
    SerializationInfo,
    create_model,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, core_schema

from iout_marl.errors import InputError
from iout_marl.outside import bring_in, brought_in, source_of
from iout_marl.registry import Entry, on_change, registries, registry_of
from iout_marl.scenario.fields import Section
from iout_marl.scenario.places import KeyPath
from iout_marl.whole import short

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)

#: How pydantic names a field without an annotation.
_WITHOUT_TYPE = re.compile(r"(`|Field ')(?P<key>\w+)(`|'| = )")

#: Sections that hold parts, beside settings of parts; those within others come first.
holders: list[type[BaseModel]] = []
#: Roles of which a part has come or gone since schemas were built.
_changed_roles: set[str] = set()


class _SettingsClass(ModelMetaclass):
    """Says of a class of settings that pydantic does not take what is wrong with it, in a line."""

    def __new__(cls, name: str, bases: Any, members: dict[str, Any], **more: Any) -> Any:
        try:
            return super().__new__(cls, name, bases, members, **more)
        except PydanticUserError as error:
            who = members.get("__qualname__", name).rpartition("<locals>.")[2]
            key = _WITHOUT_TYPE.search(error.message)
            if error.code != "model-field-missing-annotation" or key is None:
                raise InputError(f"{who}: {error.message}") from None
            value = members[key["key"]]
            said = f"{key['key']}: {type(value).__name__} = {short(value)}"
            raise InputError(f"{who}: {key['key']} lacks its type, such as {said}") from None


class Settings(Section, metaclass=_SettingsClass):
    """Settings of a part; each kind has its own.

    Attributes:
        entry: what is registered of the kind.
    """

    entry: ClassVar[Entry[Any]]

    kind: str = ""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """The keys of its kind."""

    @property
    def part(self) -> Any:
        """A part with these settings, before it belongs to a world: what it states of itself."""
        return self.entry.item(self)

    def __reduce__(self) -> tuple[Any, ...]:
        entry = self.entry
        sources = (*brought_in(), source_of(entry.module)) if entry.is_outside else ()
        return _unpickled, (entry.role, self.model_dump(round_trip=True), sources)


@cache
def settings_model(entry: Entry[Any]) -> type[Settings]:
    """The settings of a registered part: those that it declares, and its kind."""
    declared: type[Settings] = entry.item.Settings
    model = create_model(
        f"{entry.item.__name__}Settings",
        __base__=declared,
        __module__=entry.module,
        __doc__=declared.__doc__ or entry.item.__doc__,
        kind=(Literal[entry.kind], entry.kind),  # type: ignore[arg-type]
    )
    model.entry = entry
    return model


def settings_of(role: str, data: dict[str, Any]) -> Settings:
    """A registered part's settings.

    Args:
        role: of the part.
        data: its `kind`, and keys of that kind.

    Raises:
        InputError: no such kind.
        pydantic.ValidationError: the settings do not fit.
    """
    bring_up_to_date()
    return settings_model(registry_of(role)[data["kind"]]).model_validate(data)


def settings_of_kind(role: str, kind: str) -> Settings:
    """Those of a kind that has no key beside it, or a default for each.

    Raises:
        InputError: no such kind.
        pydantic.ValidationError: it has keys without a default.
    """
    return _settings_of_entry(registry_of(role)[kind])


@cache
def _settings_of_entry(entry: Entry[Any]) -> Settings:
    return settings_model(entry).model_validate({"kind": entry.kind})


def _unpickled(role: str, data: dict[str, Any], sources: tuple[str, ...]) -> Settings:
    """Settings from another process, whose parts from outside may not be here yet."""
    for source in sources:
        if data["kind"] not in registry_of(role) and source != "__main__":
            bring_in(source)
    return settings_of(role, data)


def outside_parts(section: BaseModel) -> Iterator[Entry[Any]]:
    """What of a section, or a scenario, comes from outside."""
    if isinstance(section, Settings) and section.entry.is_outside:
        yield section.entry
    yield from (part.entry for _, part in parts_in(section) if part.entry.is_outside)


@dataclass(frozen=True)
class PartOf:
    """Annotates a field that holds the settings of a part.

    Attributes:
        role: of the part.
        is_word: where it has no other key, it is shown as its kind alone.
        default: the kind of a mapping that names none; empty where one must be named.
        by_name: the kind that a word with a capital letter is the `name` of; empty for none.
    """

    role: str
    is_word: bool = False
    default: str = ""
    by_name: str = ""

    def models(self) -> tuple[type[Settings], ...]:
        """The settings of every kind."""
        return tuple(settings_model(entry) for entry in registry_of(self.role))

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        choices = {model.entry.kind: handler.generate_schema(model) for model in self.models()}
        # Written by what it is, though its kind may have been registered anew meanwhile.
        union = core_schema.tagged_union_schema(
            choices,
            "kind",
            from_attributes=True,
            serialization=core_schema.plain_serializer_function_ser_schema(
                _to_word if self.is_word else _to_mapping, info_arg=True
            ),
        )
        return core_schema.no_info_before_validator_function(self.completed, union)

    def completed(self, value: Any) -> Any:
        """A mapping for a word, and the kind that holds for a mapping that names none."""
        if isinstance(value, str):
            if self.by_name and value[:1].isupper():
                return {"kind": self.by_name, "name": value}
            return {"kind": value}
        if self.default and isinstance(value, Mapping) and "kind" not in value:
            return {"kind": self.default, **value}
        return value


def _to_mapping(value: Settings, info: SerializationInfo) -> Any:
    return value.model_dump(mode=info.mode, context=info.context)


def _to_word(value: Settings, info: SerializationInfo) -> Any:
    return value.kind if len(type(value).model_fields) == 1 else _to_mapping(value, info)


def part_of(field: FieldInfo) -> PartOf | None:
    """What part a field holds, if it does."""
    return next((found for found in field.metadata if isinstance(found, PartOf)), None)


def parts_in(section: BaseModel, path: KeyPath = ()) -> Iterator[tuple[KeyPath, Settings]]:
    """The settings of every part of a scenario, and where they stand; parts of parts follow."""
    # As they lie there: asked for by name, fields take several times as long.
    for name, value in section.__dict__.items():
        found: list[tuple[KeyPath, BaseModel]] = []
        if isinstance(value, BaseModel):
            found = [((*path, name), value)]
        elif isinstance(value, tuple):
            items = enumerate(value)
            found = [((*path, name, i), item) for i, item in items if isinstance(item, BaseModel)]
        for here, item in found:
            if isinstance(item, Settings):
                yield here, item
            yield from parts_in(item, here)


def bring_up_to_date() -> None:
    """Build schemas anew into which a part belongs that has come or gone since they were built."""
    if not _changed_roles:
        return
    roles = frozenset(_changed_roles)
    _changed_roles.clear()
    models = [settings_model(e) for registry in registries() for e in registry if _is_part(e.item)]
    is_needed = any(model.__pydantic_complete__ for model in holders)
    anew: set[type[BaseModel]] = set()
    for model in (*models, *holders):
        if any(
            (found.role in roles or not anew.isdisjoint(found.models()))
            if isinstance(found, PartOf)
            else found in anew
            for field in model.model_fields.values()
            for found in (*field.metadata, *_within(field.annotation))
        ):
            anew.add(model)
        if model.__pydantic_complete__ or is_needed:
            # What is built by itself is not built again within whatever holds it.
            model.model_rebuild(force=model in anew)


def _within(annotation: Any) -> Iterator[Any]:
    """A type, those within it, and what each of them is annotated with."""
    yield annotation
    yield from getattr(annotation, "__metadata__", ())
    for inner in get_args(annotation):
        yield from _within(inner)


def _is_part(item: Any) -> bool:
    return isinstance(getattr(item, "Settings", None), type)


on_change.append(_changed_roles.add)
