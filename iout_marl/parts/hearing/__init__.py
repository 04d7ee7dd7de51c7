"""Hearing: which nodes an AUV hears in a slot besides the one that it has chosen."""

from iout_marl.parts.hearing.base import Call, Heard, Hearing, hearings

__all__ = ["Call", "Heard", "Hearing", "hearings"]
