"""YAML text as plain values, each with the place where it stands.

YAML 1.2, in which `1e-3` is a number and `yes` is a word. Tags and keys that are no words mean
nothing in the files of this package. Whatever a text holds, reading it takes a second or two:
values, nesting and bytes have limits, and nothing is built from a text but numbers, words, lists
and mappings.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NoReturn

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    DocumentStartEvent,
    MappingEndEvent,
    MappingStartEvent,
    ScalarEvent,
    SequenceEndEvent,
    SequenceStartEvent,
)
from ruamel.yaml.nodes import ScalarNode

from iout_marl.errors import InputError
from iout_marl.scenario.places import Places, show_value

#: More than any scenario or study has; aliases of aliases would multiply without end.
MAX_BYTES, MAX_VALUES, MAX_DEPTH = 1_000_000, 25_000, 50

_TAG = "tag:yaml.org,2002:"
_WORD = f"{_TAG}str"
_COLLECTION_TAGS = {MappingStartEvent: f"{_TAG}map", SequenceStartEvent: f"{_TAG}seq"}


def read_yaml(text: str, name: str, *, is_file: bool = True) -> tuple[Any, Places]:
    """What a YAML text says: None, booleans, numbers, words, lists and mappings by words.

    Args:
        text: the text.
        name: what to call it: a file, or an override.
        is_file: whether places are lines of it.

    Raises:
        InputError: it is no YAML, or no plain values.
    """
    if len(text) > MAX_BYTES:
        raise InputError(f"{name}: has more than {MAX_BYTES:,} characters")
    reader = _Reader(text, name, is_file=is_file)
    tree = reader.tree()
    return reader.plain(tree), reader.places(tree)


@dataclass(slots=True)
class _Node:
    """A value with its line (from 1): a scalar, a list of nodes, or nodes and lines by key."""

    line: int
    value: Any
    size: int = 1
    depth: int = 0
    is_open: bool = False


@dataclass(slots=True)
class _Frame:
    """A list or a mapping whose end has not come yet."""

    node: _Node
    key: str | None = None
    key_line: int = 0
    is_merge: bool = False
    merged: list[_Node] = field(default_factory=list)


class _Reader:
    def __init__(self, text: str, name: str, *, is_file: bool) -> None:
        self._text, self._name, self._is_file = text, name, is_file
        self._yaml = YAML(typ="safe", pure=True)
        self._by_text: dict[str, Any] = {}
        construct = self._yaml.constructor
        self._scalars = {
            f"{_TAG}null": lambda _: None,
            f"{_TAG}bool": construct.construct_yaml_bool,
            f"{_TAG}int": construct.construct_yaml_int,
            f"{_TAG}float": construct.construct_yaml_float,
        }

    def tree(self) -> _Node:
        """The text's value."""
        root = _Node(1, None)
        frames: list[_Frame] = []
        anchors: dict[str, _Node] = {}
        documents = count = 0
        for event in self._events():
            line = event.start_mark.line + 1
            if isinstance(event, DocumentStartEvent):
                documents += 1
                if documents > 1:
                    self._refuse(line, "a second document begins here")
            if isinstance(event, MappingEndEvent | SequenceEndEvent):
                node = self._closed(frames.pop())
            elif isinstance(event, AliasEvent):
                node = self._aliased(anchors, event.anchor, line)
            elif isinstance(event, MappingStartEvent | SequenceStartEvent):
                self._begin(event, frames, anchors, line)
                continue
            elif isinstance(event, ScalarEvent):
                if frames and self._takes_key(frames[-1], event, line):
                    continue
                node = _Node(line, self._scalar(event, line))
                if event.anchor:
                    anchors[event.anchor] = node
            else:
                continue
            count += 1
            if count > MAX_VALUES:
                self._refuse_size(line)
            if frames:
                self._put(frames[-1], node, line)
            else:
                root = node
        return root

    def _events(self) -> Iterator[Any]:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of what is odd, but allowed
                yield from self._yaml.parse(self._text)
        except InputError:
            raise
        except MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            problem = (error.problem or error.context or "malformed").splitlines()[0]
            self._refuse(mark.line + 1 if mark else None, problem)
        except YAMLError as error:
            self._refuse(None, str(error).strip().splitlines()[0])
        except Exception as error:
            self._refuse(None, str(error))

    def _begin(
        self, event: Any, frames: list[_Frame], anchors: dict[str, _Node], line: int
    ) -> None:
        if event.tag not in (None, "!", _COLLECTION_TAGS[type(event)]):
            self._refuse_tag(event.tag, line)
        is_mapping = isinstance(event, MappingStartEvent)
        top = frames[-1] if frames else None
        if top is not None and isinstance(top.node.value, dict) and top.key is None:
            self._refuse_key("a mapping" if is_mapping else "a list", line)
        if len(frames) >= MAX_DEPTH:
            self._refuse_depth(line)
        node = _Node(line, {} if is_mapping else [], is_open=True)
        if event.anchor:
            anchors[event.anchor] = node
        frames.append(_Frame(node))

    def _takes_key(self, frame: _Frame, event: Any, line: int) -> bool:
        """Whether the scalar is a key of the mapping; that it is then kept."""
        mapping = frame.node.value
        if not isinstance(mapping, dict) or frame.key is not None:
            return False
        key = self._scalar(event, line)
        if not isinstance(key, str):
            self._refuse_key(show_value(key), line)
        frame.is_merge = key == "<<" and event.style is None and event.tag is None
        if key in mapping and not frame.is_merge:
            self._refuse(line, f'found duplicate key "{show_value(key)[1:-1]}"')
        frame.key, frame.key_line = key, line
        return True

    def _put(self, frame: _Frame, node: _Node, line: int) -> None:
        parent = frame.node
        if isinstance(parent.value, list):
            parent.value.append(node)
        elif frame.is_merge:
            merged = node.value if isinstance(node.value, list) else [node]
            if not all(isinstance(part.value, dict) for part in merged):
                self._refuse(line, "only mappings can be merged by <<")
            # Their keys have no line of their own here: that of the merge is theirs.
            frame.merged += (_Node(frame.key_line, part.value) for part in merged)
            frame.key = None
            return
        else:
            parent.value[frame.key] = (frame.key_line, node)
            frame.key = None
        self._grow(parent, node, line)

    def _grow(self, parent: _Node, node: _Node, line: int) -> None:
        parent.size += node.size
        parent.depth = max(parent.depth, node.depth + 1)
        if parent.size > MAX_VALUES:
            self._refuse_size(line)
        if parent.depth > MAX_DEPTH:
            self._refuse_depth(line)

    def _closed(self, frame: _Frame) -> _Node:
        node = frame.node
        node.is_open = False
        for part in frame.merged:
            for key, (_, value) in part.value.items():
                if key not in node.value:
                    node.value[key] = (part.line, value)
                    self._grow(node, value, part.line)
        return node

    def _aliased(self, anchors: dict[str, _Node], anchor: str, line: int) -> _Node:
        if anchor not in anchors:
            self._refuse(line, f"found undefined alias {show_value(anchor)}")
        node = anchors[anchor]
        if node.is_open:
            self._refuse_depth(line)
        return node

    def _scalar(self, event: Any, line: int) -> Any:
        value: str = event.value
        tag = event.tag
        if tag is None and event.style is None:
            if value not in self._by_text:
                resolved = self._yaml.resolver.resolve(ScalarNode, value, (True, False))
                self._by_text[value] = self._built(value, str(resolved), line)
            return self._by_text[value]
        if tag in (None, "!", _WORD):
            return value
        if tag not in self._scalars:
            self._refuse_tag(tag, line)
        return self._built(value, tag, line)

    def _built(self, value: str, tag: str, line: int) -> Any:
        if tag not in self._scalars:
            return value  # a word, or what looks like a date, say
        try:
            return self._scalars[tag](ScalarNode(tag, value))
        except (ValueError, KeyError, IndexError, OverflowError):
            self._refuse(line, f"{show_value(value)} cannot be read as {tag.removeprefix(_TAG)}")

    def plain(self, node: _Node) -> Any:
        """A node as plain values."""
        if isinstance(node.value, dict):
            return {key: self.plain(value) for key, (_, value) in node.value.items()}
        if isinstance(node.value, list):
            return [self.plain(value) for value in node.value]
        return node.value

    def places(self, node: _Node) -> Places:
        """Where a node and all within it stand."""
        return self._places(node, node.line)

    def _places(self, node: _Node, line: int) -> Places:
        places = Places(self._name)
        if self._is_file:
            places = Places(f"{self._name}:{line}", file=self._name)
        if isinstance(node.value, dict):
            for key, (key_line, value) in node.value.items():
                places.inside[key] = self._places(value, key_line)
        elif isinstance(node.value, list):
            for i, value in enumerate(node.value):
                places.inside[i] = self._places(value, value.line)
        return places

    def _refuse_tag(self, tag: str, line: int) -> NoReturn:
        shown = tag.replace(_TAG, "!!")
        self._refuse(line, f"the tag {show_value(shown)[1:-1]} has no meaning here")

    def _refuse_key(self, key: str, line: int) -> NoReturn:
        where = f"{self._name}:{line}" if self._is_file else self._name
        raise InputError(f"{where}: {key} is no key: keys are words")

    def _refuse_depth(self, line: int) -> NoReturn:
        self._refuse(line, "nested too deeply, or within itself")

    def _refuse_size(self, line: int) -> NoReturn:
        self._refuse(line, f"more than {MAX_VALUES:,} values")

    def _refuse(self, line: int | None, problem: str) -> NoReturn:
        where = f"{self._name}:{line}" if self._is_file and line is not None else self._name
        raise InputError(f"{where}: broken YAML: {problem}")
