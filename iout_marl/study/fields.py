"""What studies and their results are made of: texts that can be shown, numbers that add up."""

from __future__ import annotations

import unicodedata
from typing import Annotated, TypeAlias

from pydantic import AfterValidator, Field

from iout_marl.scenario.fields import invalid

#: Figures beyond it come from no study; the fourth power of one still fits into a float.
LARGEST = 1e50
#: Letters of a name, a heading or a message.
LONGEST = 1_000

#: Unicode's categories of what has no look: control characters, half characters, line ends.
_UNSEEN = ("Cc", "Cs", "Zl", "Zp")


def _is_seen(character: str) -> bool:
    # The last two are no characters, and no XML may hold them.
    return unicodedata.category(character) not in _UNSEEN and character not in "\ufffe\uffff"


def show(text: str) -> str:
    """A text of unknown origin as a `Line`: what cannot be shown is spelt out, as `\\x1b`."""
    return "".join(c if _is_seen(c) else repr(c)[1:-1] for c in text)


def _check_text(text: str, allowed: str = "\n\t") -> str:
    strange = next((c for c in text if not (c in allowed or _is_seen(c))), None)
    if strange is not None:
        raise invalid((), f"must not hold the control character {strange!r}")
    return text


def _check_line(text: str) -> str:
    return _check_text(text, allowed="")


def _check_words(text: str) -> str:
    if len(text) > LONGEST:
        raise invalid((), f"must have at most {LONGEST:,} characters, not {len(text):,}")
    return _check_line(text)


#: A text of one line, of any length.
Line: TypeAlias = Annotated[str, AfterValidator(_check_line)]
#: A name, a heading, a message: a line that is not too long.
Words: TypeAlias = Annotated[str, AfterValidator(_check_words)]
#: A text that may have several lines.
Text: TypeAlias = Annotated[str, AfterValidator(_check_text)]

Number: TypeAlias = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
NotNegative: TypeAlias = Annotated[float, Field(ge=0, le=LARGEST)]
#: What is divided by.
Positive: TypeAlias = Annotated[float, Field(ge=1 / LARGEST, le=LARGEST)]
Whole: TypeAlias = Annotated[int, Field(ge=0, le=10**18)]
Counted: TypeAlias = Annotated[int, Field(ge=1, le=10**18)]
